//! Executes one command line, command by command, with the addressed motor and coordinate system.
//!
//! The interpreter executes the commands of a line from left to right as it parses them. The first error ends the line:
//! the commands to its left are done, the rest is not parsed. But before the first command acts, the interpreter looks
//! for a word that is no command, as far as the first command with operands. `#n` and `&n` stay in force for later lines.
//! PMAC and PMAC2 have one such pair for all ports, so the ports share one [`Interpreter`]; on Turbo each port has its own
//! ([`super::ports`]).

mod assign;
mod buffers;
mod coordinate;
mod entry;
mod list;
mod memory;
mod motor;
mod station;
mod system;
mod turbo;

use crate::map::Generation;
use crate::sim::board::Board;
use crate::sim::board::axes::{AxisMode, is_axis};
use crate::sim::board::error::CommandError;
use crate::sim::board::variables::VariableKind;
use crate::sim::language::reply::{LONGEST_LINE, Outcome, Reply};
use crate::sim::language::scanner::Scanner;
use crate::sim::language::words::{self, Word};
use crate::sim::language::{axis, expression, m_definition};
use crate::sim::program::Programs;
use crate::sim::program::item::Item;
use crate::sim::program::parse::numbers;
use crate::sim::program::words as statements;

/// The addressed motor, coordinate system, group of motors and card.
#[derive(Debug, Clone, Default)]
pub struct Interpreter {
    pub(super) motor: usize,
    pub(super) cs: usize,
    group: usize,
    card: u8,
}

/// One command line in progress.
pub(super) struct Line<'a, 'b> {
    pub(super) interpreter: &'a mut Interpreter,
    pub(super) board: &'a mut Board,
    pub(super) programs: &'a mut Programs,
    pub(super) scanner: Scanner<'b>,
    pub(super) lines: Vec<String>,
    /// The items of the program line being entered.
    pub(super) items: Vec<Item>,
}

impl Interpreter {
    /// Motor 1, coordinate system 1, card 0.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Addresses the 0-based motor and coordinate system.
    #[must_use]
    pub fn addressing(motor: usize, cs: usize) -> Self {
        Self { motor, cs, ..Self::default() }
    }

    /// The addressed motor, 0-based.
    #[must_use]
    pub const fn motor(&self) -> usize {
        self.motor
    }

    /// The addressed coordinate system, 0-based.
    #[must_use]
    pub const fn coordinate_system(&self) -> usize {
        self.cs
    }

    /// Returns to `#1 &1 @0`, as after power-up and reset.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// Executes one line, given without its end-of-line character. An empty line is valid and answers nothing.
    ///
    /// A line with a character above 127 is ERR004, a line longer than 255 characters ERR003; the board starts neither.
    pub fn execute(&mut self, board: &mut Board, programs: &mut Programs, line: &[u8]) -> Reply {
        if !line.is_ascii() {
            return Reply { lines: Vec::new(), error: Some(CommandError::CHARACTER) };
        }
        if line.len() > LONGEST_LINE {
            return Reply { lines: Vec::new(), error: Some(CommandError::SYNTAX) };
        }
        let scanner = Scanner::new(line);
        let mut line =
            Line { interpreter: self, board, programs, scanner, lines: Vec::new(), items: Vec::new() };
        let result = line.run();
        // Store the program items to the left of an error.
        let error = line.store_items().and(result).err();
        Reply { lines: line.lines, error }
    }

    /// Executes a control character that is a command by itself (1 is ^A). `None` for any other character: it does
    /// nothing, or belongs to the port's line editing (backspace, enter, ^I, ^N, ^Y).
    ///
    /// `Some` with lines is a report; most characters answer nothing.
    pub fn control(&mut self, board: &mut Board, programs: &mut Programs, character: u8) -> Option<Reply> {
        if character == crate::sim::language::control::TAKE {
            let line = crate::sim::language::control::dpram_line(board)?;
            return Some(self.execute(board, programs, &line));
        }
        crate::sim::language::control::execute(board, programs, self.group, character)
    }
}

impl Line<'_, '_> {
    fn run(&mut self) -> Outcome {
        if self.bare_constant()? {
            return Ok(());
        }
        if !self.programs.store.takes_text() {
            self.check_words()?;
        }
        while self.scanner.peek().is_some() {
            self.command()?;
        }
        Ok(())
    }

    /// A line of just a constant assigns P0, or an entry of a table that is not full (User Manual p. 150).
    fn bare_constant(&mut self) -> Result<bool, CommandError> {
        if !self.scanner.at_constant() {
            return Ok(false);
        }
        let value = self.scanner.constant()?;
        if self.scanner.peek().is_some() {
            return Err(CommandError::SYNTAX);
        }
        if !self.table_entry(value) {
            self.board.assign(VariableKind::P, 0, 0, value);
        }
        Ok(true)
    }

    /// The error for a word that is no command, or needs a buffer, before any command of the line acts: the `R` of a
    /// misspelt word starts no program. The text after a command with operands is checked in its turn.
    fn check_words(&self) -> Outcome {
        let generation = self.board.family().generation;
        let mut ahead = self.scanner.clone();
        loop {
            match word(&mut ahead, generation) {
                Some(Word::Foreign) => return Err(CommandError::SYNTAX),
                Some(Word::Program) => return Err(CommandError::NO_OPEN_BUFFER),
                Some(word) if word.has_operands() => return Ok(()),
                Some(_) => continue,
                None => {}
            }
            match ahead.next_character() {
                None | Some(b'$') => return Ok(()),
                Some(mark @ (b'=' | b'(' | b'>')) => self.skip_operand(&mut ahead, mark),
                Some(letter @ (b'C'..=b'E' | b'G' | b'L' | b'N' | b'T'..=b'U' | b'W'..=b'Y')) => {
                    if ahead.at_constant() || ahead.peek() == Some(b'(') {
                        return Err(CommandError::NO_OPEN_BUFFER);
                    }
                    if ahead.peek() != Some(b'=') || !is_axis(letter) {
                        return Err(CommandError::SYNTAX);
                    }
                }
                Some(_) => {}
            }
        }
    }

    /// Skips the value or the definition behind `mark`. A wrong one stays where it is.
    fn skip_operand(&self, scanner: &mut Scanner, mark: u8) {
        let family = self.board.family();
        let mut behind = scanner.clone();
        let is_skipped = if mark != b'>' {
            behind.take(b'*') || expression::check(&mut behind, self.board).is_ok()
        } else {
            matches!(m_definition::definition(&mut behind, family), Ok(Some(_)))
                || axis::definition(&mut behind, 0, family.generation).is_ok()
        };
        if is_skipped {
            *scanner = behind;
        }
    }

    fn command(&mut self) -> Outcome {
        if self.program_statement()? {
            return Ok(());
        }
        // `$` before a hex digit begins a number, and no command begins with a number.
        if self.scanner.at_constant() && self.scanner.peek() == Some(b'$') {
            return Err(CommandError::SYNTAX);
        }
        if let Some(word) = word(&mut self.scanner, self.board.family().generation) {
            return self.word(word);
        }
        match self.scanner.next_character() {
            Some(b'#') => self.address_motor(),
            Some(b'&') => self.address_coordinate_system(),
            Some(b'@') => self.address_card(),
            Some(b'J') => self.jog(),
            Some(b'K') => self.letter(|line| line.board.kill(line.interpreter.motor)),
            Some(b'O') => self.open_loop(),
            Some(b'F') => self.letter(Self::report_following_error),
            Some(b'H') => self.letter(|line| {
                line.board.feed_hold(line.interpreter.cs);
                Ok(())
            }),
            Some(b'R') => self.letter(|line| line.programs.run(line.board, line.interpreter.cs)),
            Some(b'S') => self.letter(|line| line.programs.step(line.board, line.interpreter.cs)),
            Some(b'B') => self.point_to_program(),
            Some(b'/') => {
                self.programs.stop_after_move(self.board, self.interpreter.cs);
                Ok(())
            }
            Some(b'\\') => {
                self.programs.program_hold(self.board, self.interpreter.cs);
                Ok(())
            }
            Some(b'%') => self.feedrate_override(),
            Some(letter @ (b'I' | b'P' | b'Q' | b'M')) => self.variable(letter),
            Some(axis) if is_axis(axis) => self.axis(axis),
            // D, E, G, L, N, T: letters of program statements.
            Some(letter) if letter.is_ascii_uppercase() => self.letter(|_| Err(CommandError::SYNTAX)),
            _ => Err(CommandError::SYNTAX),
        }
    }

    fn word(&mut self, word: Word) -> Outcome {
        match word {
            Word::Status(which) => self.status(which),
            Word::ResetMotor => self.board.reset_motor(self.interpreter.motor),
            Word::AbsolutePosition => self.board.absolute_position(self.interpreter.motor),
            Word::Home => self.letter(|line| line.board.home(line.interpreter.motor)),
            Word::HomeZero => self.letter(|line| line.board.home_zero(line.interpreter.motor)),
            Word::Absolute => self.axis_mode(AxisMode::Absolute),
            Word::Incremental => self.axis_mode(AxisMode::Incremental),
            Word::FeedrateAxes => self.axis_mode(AxisMode::Feedrate),
            Word::Undefine => self.undefine(),
            Word::Read(form) => self.read_memory(form),
            Word::Write(space) => self.write_memory(space),
            Word::Reset => self.reset_board(false),
            Word::FactoryReset => self.reset_board(true),
            Word::Define => self.define(),
            Word::Delete => self.delete(),
            Word::Gather => self.gather(),
            Word::EndGather => self.board.end_gather(),
            Word::End if self.scanner.take_text(b"GATHER") => self.board.end_gather(),
            Word::End => Err(CommandError::SYNTAX),
            Word::Version | Word::Type | Word::Date | Word::Checksum | Word::Size => self.identity(word),
            Word::Part | Word::Vendor | Word::Processor => self.card(word),
            // No manual seen gives the form: 0 is a board without a serial number chip.
            Word::Serial => self.answer("0"),
            Word::Today | Word::Time => self.clock(word),
            Word::Station => self.station(),
            Word::StationTransfer(write) => self.station_transfer(write),
            // No motor here is commutated.
            Word::SetPhase => numbers(&mut self.scanner, 1, self.board.family().motors).map(|_| ()),
            Word::EnableMotors => self.letter(Self::enable_motors),
            Word::Lock(lock) => self.lock(lock),
            Word::MoveTime => self.move_time(),
            Word::Auxiliary => self.auxiliary(),
            Word::AuxiliaryTransfer => self.auxiliary_transfer(),
            Word::Save => self.save(),
            Word::Password => self.password(),
            Word::Program => Err(CommandError::NO_OPEN_BUFFER),
            Word::Buffer(command) => self.buffer_command(command),
            Word::Foreign => Err(CommandError::SYNTAX),
        }
    }

    /// A letter that is a command alone and a program statement with a number or expression (`F` reports the following
    /// error, `F5` is a feedrate). The statement needs an open buffer.
    pub(super) fn letter(&mut self, command: impl FnOnce(&mut Self) -> Outcome) -> Outcome {
        if self.at_argument() { Err(CommandError::NO_OPEN_BUFFER) } else { command(self) }
    }

    /// Whether a constant or an opening parenthesis follows.
    pub(super) fn at_argument(&mut self) -> bool {
        self.scanner.at_constant() || self.scanner.peek() == Some(b'(')
    }

    pub(super) fn answer(&mut self, text: impl Into<String>) -> Outcome {
        self.lines.push(text.into());
        Ok(())
    }

    fn address_motor(&mut self) -> Outcome {
        let motors = self.board.family().motors;
        let groups = motors / self.board.identity.tables.group;
        if groups > 1 && self.scanner.take(b'#') {
            return self.address_group(groups);
        }
        let Some(motor) = self.address(motors)? else {
            return self.answer((self.interpreter.motor + 1).to_string());
        };
        if self.scanner.take_tight(b"->") {
            return self.axis_definition(motor);
        }
        self.interpreter.motor = motor;
        Ok(())
    }

    /// `##n` chooses the group of motors that ^B, ^F, ^P and ^V report at this port, from 0; `##` reports the group.
    fn address_group(&mut self, groups: usize) -> Outcome {
        if !self.scanner.peek().is_some_and(|c| c.is_ascii_digit()) {
            return self.answer(self.interpreter.group.to_string());
        }
        match self.scanner.integer()? {
            group if group < groups => {
                self.interpreter.group = group;
                Ok(())
            }
            _ => Err(CommandError::SYNTAX),
        }
    }

    fn address_coordinate_system(&mut self) -> Outcome {
        let count = self.board.family().coordinate_systems;
        let Some(cs) = self.address(count)? else {
            return self.answer((self.interpreter.cs + 1).to_string());
        };
        // The rest of the line goes to another rotary buffer.
        self.store_items()?;
        self.interpreter.cs = cs;
        Ok(())
    }

    /// The number after `#` or `&`, made 0-based; `None` without one.
    fn address(&mut self, count: usize) -> Result<Option<usize>, CommandError> {
        if !self.scanner.peek().is_some_and(|c| c.is_ascii_digit()) {
            return Ok(None);
        }
        match self.scanner.integer()? {
            number if (1..=count).contains(&number) => Ok(Some(number - 1)),
            _ => Err(CommandError::SYNTAX),
        }
    }

    /// `@n`: the card of a serial chain. The simulator has one card, so it only stores and reports the number.
    fn address_card(&mut self) -> Outcome {
        match self.scanner.peek() {
            Some(digit) if digit.is_ascii_hexdigit() => {
                self.scanner.next_character();
                self.interpreter.card = char::from(digit).to_digit(16).unwrap_or(0) as u8;
                Ok(())
            }
            Some(b'@') => {
                self.scanner.next_character();
                Ok(())
            }
            _ => self.answer(format!("{:X}", self.interpreter.card)),
        }
    }
}

/// Takes the word at the scanner. A longer word of a program statement there takes precedence.
fn word(scanner: &mut Scanner, generation: Generation) -> Option<Word> {
    let mut statement = scanner.clone();
    let is_statement = statement.keyword(statements::tables(generation)).is_some();
    let word = scanner.keyword(words::tables(generation));
    if is_statement && !scanner.up_to(&statement).is_empty() {
        *scanner = statement;
        return Some(Word::Program);
    }
    word
}
