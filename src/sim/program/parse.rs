//! Parses program text to [`Item`]s, one at a time, with an open buffer (Software Reference, "Program commands").
//!
//! The parser leaves all other words to the on-line interpreter: on-line commands that need no buffer work while one is
//! open.

use crate::map::Generation;
use crate::sim::board::Board;
use crate::sim::board::axes::AxisMode;
use crate::sim::board::error::CommandError;
use crate::sim::board::variables::VariableKind;
use crate::sim::language::axis::parse_list;
use crate::sim::language::expression::{check, check_condition, check_number};
use crate::sim::language::lock;
use crate::sim::language::scanner::Scanner;
use crate::sim::language::station;
use crate::sim::program::item::{AXES, Data, Item, Mark, Message, Mode, Operator};
use crate::sim::program::message::PORT_LETTERS;
use crate::sim::program::words::{ENDED, Keyword, tables};

/// The kind of buffer that is open; each rejects some statements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BufferKind {
    /// A fixed motion program.
    Motion,
    /// A rotary motion program: no branch, loop or label.
    Rotary,
    /// A PLC program: no motion.
    Plc,
}

type Parsed<T> = Result<T, CommandError>;

/// The highest label.
const LAST_LABEL: usize = 262_143;

/// Parses the program statement at the scanner. `None` without one; the scanner has not moved then.
///
/// # Errors
/// ERR003 for a statement that is wrong or that this kind of buffer does not allow.
pub fn item(scanner: &mut Scanner, board: &Board, kind: BufferKind) -> Parsed<Option<Item>> {
    let mut reader = Reader { scanner: scanner.clone(), board };
    let item = reader.item()?;
    if let Some(item) = &item {
        if !allowed(item, kind) {
            return Err(CommandError::SYNTAX);
        }
        *scanner = reader.scanner;
    }
    Ok(item)
}

fn allowed(item: &Item, kind: BufferKind) -> bool {
    let flow = matches!(item, Item::If(_) | Item::Else | Item::EndIf | Item::While(_) | Item::EndWhile);
    // In all files seen only PLCs have conditions on lines of their own. A board may end its listing of a PLC with
    // RETURN.
    let only_plcs = matches!(item, Item::Also(..));
    let ends = matches!(item, Item::Return);
    let general = matches!(
        item,
        Item::Assign(..)
            | Item::Plc(..)
            | Item::Compiled(..)
            | Item::Station(_)
            | Item::Lock(_)
            | Item::Command(..)
            | Item::Send(..)
            | Item::Display(_)
            | Item::Address(..)
            | Item::SetPhase(_)
    );
    let later = matches!(item, Item::Assign(_, _, operator, _) if *operator != Operator::Assign);
    let branch = matches!(
        item,
        Item::Goto(_) | Item::Gosub(_) | Item::Label(_) | Item::Return | Item::Read(_) | Item::Wait
    );
    match kind {
        BufferKind::Motion => !only_plcs && !matches!(item, Item::Address(..)),
        BufferKind::Rotary => !flow && !branch && !only_plcs && !matches!(item, Item::Address(..)),
        BufferKind::Plc => flow || only_plcs || ends || general && !later,
    }
}

struct Reader<'a, 'b> {
    scanner: Scanner<'a>,
    board: &'b Board,
}

impl Reader<'_, '_> {
    fn item(&mut self) -> Parsed<Option<Item>> {
        if let Some(keyword) = self.scanner.keyword(tables(self.board.family().generation)) {
            return self.keyword(keyword);
        }
        if let Some(transfer) = station::transfer(&mut self.scanner, self.board)? {
            return Ok(Some(Item::Station(transfer)));
        }
        let Some(letter) = self.scanner.next_character() else { return Ok(None) };
        if let Some(kind) = VariableKind::from_letter(letter)
            && let Some(item) = self.assignment(kind)?
        {
            return Ok(Some(item));
        }
        // `O5` is the on-line command.
        if !self.at_data() || !letter.is_ascii_uppercase() || letter == b'O' {
            return Ok(None);
        }
        if letter == b'N' {
            let label = self.scanner.integer()?;
            return if label <= LAST_LABEL {
                Ok(Some(Item::Label(label as u32)))
            } else {
                Err(CommandError::SYNTAX)
            };
        }
        // `M5->` and `J-` are on-line commands, executed at once.
        let mut ahead = self.scanner.clone();
        if letter == b'M' && ahead.integer().is_ok() && ahead.take_tight(b"->") {
            return Ok(None);
        }
        let data = self.data()?;
        Ok(Some(match letter {
            b'D'..=b'T' => Item::Letter(letter, data),
            _ => {
                let axis = AXES.iter().position(|&a| a == letter).ok_or(CommandError::SYNTAX)?;
                let mark = if self.scanner.take(b':') {
                    Some((Mark::Velocity, self.data()?))
                } else if self.scanner.take(b'^') {
                    Some((Mark::Trigger, self.data()?))
                } else {
                    None
                };
                Item::Axis(axis, data, mark)
            }
        }))
    }

    fn keyword(&mut self, keyword: Keyword) -> Parsed<Option<Item>> {
        Ok(Some(match keyword {
            Keyword::Alone(item) => item,
            Keyword::Number(item) => item(self.data()?),
            Keyword::Condition(item) => item(self.condition()?),
            Keyword::Circle => Item::Mode(self.one_of([Mode::Circle1, Mode::Circle2])?),
            Keyword::Spline => Item::Mode(self.one_of([Mode::Spline1, Mode::Spline2])?),
            Keyword::CutterCompensation => match self.scanner.integer()? {
                side @ 0..=2 => Item::CutterCompensation(side as u8),
                _ => return Err(CommandError::SYNTAX),
            },
            Keyword::Command => Item::Command(self.port_letter(), self.message(true)?),
            // No page seen has `SEND^x` for PMAC.
            Keyword::Send => Item::Send(self.port_letter(), self.message(self.is_turbo())?),
            Keyword::Display => Item::Display(String::from_utf8_lossy(self.scanner.rest()).into()),
            Keyword::Address => self.address()?,
            // `END GATHER` is an on-line command.
            Keyword::End => return Ok(self.scanner.keyword(&[ENDED])),
            Keyword::Read => self.read()?,
            Keyword::Axes(mode) => {
                let list = parse_list(&mut self.scanner)?;
                if mode == AxisMode::Feedrate && list.as_ref().is_some_and(|list| list.contains(&'R')) {
                    return Err(CommandError::SYNTAX);
                }
                Item::Axes(mode, list.map(Into::into))
            }
            Keyword::Home(zero) => {
                if !self.scanner.at_unsigned() {
                    return Ok(None);
                }
                Item::Home { zero, motors: self.motors()? }
            }
            Keyword::SetPhase => Item::SetPhase(self.motors()?),
            Keyword::Lock(lock) => Item::Lock(lock::operands(&mut self.scanner, self.board, lock)?),
            Keyword::Plc(switch) => {
                if !self.scanner.take_text(b"PLC") {
                    return Err(CommandError::SYNTAX);
                }
                let compiled = self.scanner.take_tight(b"C");
                let plcs = numbers(&mut self.scanner, 0, 31)? as u32;
                if compiled { Item::Compiled(switch, plcs) } else { Item::Plc(switch, plcs) }
            }
        }))
    }

    /// `5=…`, `5==…`, `(expression)|=…` after I, P, Q or M. `None`, with the scanner unmoved, if it is no assignment.
    fn assignment(&mut self, kind: VariableKind) -> Parsed<Option<Item>> {
        let mut ahead = self.scanner.clone();
        let number = match ahead.peek() {
            Some(b'(') => {
                ahead.next_character();
                let Ok(text) = expression(&mut ahead, self.board) else { return Ok(None) };
                if !ahead.take(b')') {
                    return Ok(None);
                }
                text
            }
            Some(b'0'..=b'9') => Data::Constant(match ahead.integer() {
                Ok(number) => number as f64,
                Err(_) => return Ok(None),
            }),
            _ => return Ok(None),
        };
        let later: &[(&[u8], Operator)] = &[
            (b"==", Operator::AssignLater),
            (b"|=", Operator::Or),
            (b"^=", Operator::Xor),
            (b"&=", Operator::And),
        ];
        let operator = match later.iter().find(|(text, _)| ahead.take_text(text)) {
            Some(_) if kind != VariableKind::M => return Err(CommandError::SYNTAX),
            Some((_, operator)) => *operator,
            None if ahead.take(b'=') => Operator::Assign,
            None => return Ok(None),
        };
        if let Data::Constant(number) = number {
            check_number(number, self.board)?;
        }
        let value = expression(&mut ahead, self.board)?;
        self.scanner = ahead;
        Ok(Some(Item::Assign(kind, number, operator, value)))
    }

    /// A list of motors, bit n-1 for motor n.
    fn motors(&mut self) -> Parsed<u32> {
        let motors = numbers(&mut self.scanner, 1, self.board.family().motors)?;
        Ok((motors >> 1) as u32)
    }

    fn at_data(&mut self) -> bool {
        self.scanner.at_constant() || self.scanner.peek() == Some(b'(')
    }

    /// A constant, or an expression in parentheses.
    fn data(&mut self) -> Parsed<Data> {
        if self.scanner.at_constant() {
            return self.scanner.constant().map(Data::Constant);
        }
        self.scanner.expect(b'(')?;
        let data = expression(&mut self.scanner, self.board)?;
        self.scanner.expect(b')')?;
        Ok(data)
    }

    fn condition(&mut self) -> Parsed<Box<str>> {
        self.scanner.expect(b'(')?;
        let start = self.scanner.clone();
        check_condition(&mut self.scanner, self.board)?;
        let text = squeezed(start.up_to(&self.scanner));
        self.scanner.expect(b')')?;
        Ok(text)
    }

    /// The letter of a port behind `CMD` or `SEND`, which Turbo boards know.
    fn port_letter(&mut self) -> Option<u8> {
        let has_letters = self.is_turbo();
        PORT_LETTERS.iter().copied().find(|&letter| has_letters && self.scanner.take(letter))
    }

    fn is_turbo(&self) -> bool {
        self.board.family().generation == Generation::Turbo
    }

    /// A text in quotes, or `^K` and the like, from `^@` (NUL) to `^_` (Turbo Software Reference p. 471).
    fn message(&mut self, takes_characters: bool) -> Parsed<Message> {
        if self.scanner.take(b'^') {
            let letter =
                self.scanner.next_character().filter(|c| takes_characters && (b'@'..=b'_').contains(c));
            return letter.map(|letter| Message::Character(letter & 0x1F)).ok_or(CommandError::SYNTAX);
        }
        self.scanner.expect(b'"')?;
        let text = self.scanner.until(b'"').ok_or(CommandError::SYNTAX)?;
        Ok(Message::Text(String::from_utf8_lossy(text).into()))
    }

    fn address(&mut self) -> Parsed<Item> {
        let family = self.board.family();
        let mut one = |mark: u8, count: usize| -> Parsed<Option<usize>> {
            if !self.scanner.take(mark) {
                return Ok(None);
            }
            match self.scanner.integer()? {
                number if (1..=count).contains(&number) => Ok(Some(number - 1)),
                _ => Err(CommandError::SYNTAX),
            }
        };
        let motor = one(b'#', family.motors)?;
        let cs = one(b'&', family.coordinate_systems)?;
        if motor.is_none() && cs.is_none() { Err(CommandError::SYNTAX) } else { Ok(Item::Address(motor, cs)) }
    }

    fn read(&mut self) -> Parsed<Item> {
        self.scanner.expect(b'(')?;
        let mut letters = Vec::new();
        loop {
            let letter = self.scanner.next_character().filter(u8::is_ascii_uppercase);
            letters.push(letter.filter(|c| !b"NO".contains(c)).ok_or(CommandError::SYNTAX)?);
            if self.scanner.take(b')') {
                return Ok(Item::Read(letters.into()));
            }
            self.scanner.expect(b',')?;
        }
    }

    fn one_of(&mut self, modes: [Mode; 2]) -> Parsed<Mode> {
        match self.scanner.integer()? {
            1 => Ok(modes[0]),
            2 => Ok(modes[1]),
            _ => Err(CommandError::SYNTAX),
        }
    }
}

/// The expression at the scanner: a constant, or its text.
fn expression(scanner: &mut Scanner, board: &Board) -> Parsed<Data> {
    let start = scanner.clone();
    check(scanner, board)?;
    let text = start.up_to(scanner);
    let mut constant = Scanner::new(text);
    match constant.constant() {
        Ok(value) if constant.peek().is_none() => Ok(Data::Constant(value)),
        _ => Ok(Data::Expression(squeezed(text))),
    }
}

/// Text as a buffer stores it: capitals, and no blanks but the blank that ends a hex number: `$F AND`.
fn squeezed(text: &[u8]) -> Box<str> {
    let mut squeezed = String::new();
    for word in String::from_utf8_lossy(text).split_ascii_whitespace() {
        let before = squeezed.trim_end_matches(|c: char| c.is_ascii_hexdigit());
        let ends_in_hex = before.len() < squeezed.len() && before.ends_with('$');
        if ends_in_hex && word.starts_with(|c: char| c.is_ascii_hexdigit()) {
            squeezed.push(' ');
        }
        squeezed += &word.to_ascii_uppercase();
    }
    squeezed.into()
}

/// `1,3` or `1..8`, as bits.
///
/// # Errors
/// ERR003 for numbers outside `first` to `last`.
pub fn numbers(scanner: &mut Scanner, first: usize, last: usize) -> Parsed<u64> {
    let mut bits = 0;
    loop {
        let from = scanner.integer()?;
        let to = if scanner.take_text(b"..") { scanner.integer()? } else { from };
        if from < first || to > last || from > to {
            return Err(CommandError::SYNTAX);
        }
        bits |= (from..=to).fold(0, |bits, number| bits | 1 << number);
        if !scanner.take(b',') {
            return Ok(bits);
        }
    }
}
