//! The combined effect of a line's commands.

use std::fmt::Write as _;
use std::time::Duration;

use super::LINE_MAX;
use super::command::{Does, Effect, Kind, Needs, Token, is_rotary};
use super::deadlines::{limit, slow};
use super::lexer::tokens;
use super::number::Numbers;
use super::password::password_at;
use super::settings::Settings;
use super::while_open::WhileOpen;
use crate::format::Text;
use crate::map::{Motors, Systems};

/// The command that resets the board, and so ends everything.
const RESET: &str = "$$$";
/// The most characters of the text that lists a line's ending commands.
const ENDS_MAX: usize = 120;

/// What a line means, as far as its text tells. A command that names no motor or coordinate system goes to the
/// addressed one, which only the board knows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Meaning {
    /// The motors that the line names and moves. `J/` and `K`, which stop a motor, do not count.
    pub moves: Motors,
    /// The line can do more than ask for or set variables, address, and save.
    pub may_move: bool,
    /// The line can start a motion program.
    pub may_start_program: bool,
    /// The line starts PLC programs, or opens a rotary buffer: their lines may move motors.
    pub lets_programs_move: bool,
    /// A command of the line stops motors or programs.
    pub stops: bool,
    /// The coordinate systems that the line names and whose programs it starts.
    pub starts: Systems,
    /// The coordinate systems that the line names and points at a program.
    pub points_elsewhere: Systems,
    /// The coordinate systems that the line names and whose programs it ends, or that it points at their rotary
    /// buffers.
    pub aborts: Systems,
    /// The coordinate systems whose rotary buffers the line deletes or empties.
    pub takes_away: Systems,
    /// The coordinate systems whose rotary buffers the line empties if they are open.
    pub clears: Systems,
    /// The motors that still jog when the board has carried out the line, until a command stops them.
    pub jogs: Jogs,
    /// The motors that may jog although the board has refused the line: the board carries out the commands before the
    /// refused one. The daemon does not know which one that was, so every jog counts except the last command's.
    pub jogs_if_refused: Jogs,
    /// What the line ends.
    pub ends: LineEnds,
    /// The line's final effect on the program buffers.
    pub buffer: Option<Effect>,
    /// The line only closes the open buffers.
    pub is_close: bool,
    /// How the board treats the line while a program buffer is open.
    pub while_open: WhileOpen,
    /// The I-variables that the line sets.
    pub settings: Settings,
    /// The line resets the board.
    pub resets: bool,
    /// The line saves the board's settings.
    pub saves: bool,
    /// The line points M-variables elsewhere.
    pub defines_m: bool,
    /// The line has a `$`, and so may change the board's memory by an address.
    pub has_address: bool,
    /// The line only asks for variables.
    pub only_asks_for_variables: bool,
    /// How many values of I-, P- and Q-variables the line asks for by number; 0 if it does more than that.
    pub asks_for_values: u32,
    /// The line sets or gives the password.
    pub has_password: bool,
    /// A command of the line goes to the addressed motor or coordinate system, which the line has not named before.
    pub goes_by_address: bool,
    /// The line addresses a coordinate system.
    pub addresses_system: bool,
    /// The line begins with that address.
    pub begins_with_system: bool,
    /// The line ends with that address.
    pub ends_with_system: bool,
    /// The time that the slowest command may take, and the number of values in the ranges.
    slow: Duration,
    values: u32,
}

/// Motors that jog without an end.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Jogs {
    /// The motors that the line names.
    pub motors: Motors,
    /// The line also jogs a motor that an earlier line has addressed.
    pub unnamed: bool,
}

impl Jogs {
    /// The jogs of both.
    #[must_use]
    pub const fn or(self, other: Self) -> Self {
        Self { motors: self.motors.and(other.motors), unnamed: self.unnamed || other.unnamed }
    }

    /// Whether any motor jogs on.
    #[must_use]
    pub const fn any(self) -> bool {
        !self.motors.is_empty() || self.unnamed
    }
}

/// What a line ends: programs, motions, a gather, or an open buffer. A line that names no coordinate system or motor
/// counts for all of them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LineEnds {
    /// The commands that end them: `&1Q`.
    pub what: Text<ENDS_MAX>,
    /// A command of the line names neither motor nor coordinate system, and goes to the addressed one.
    pub unnamed: bool,
    /// The coordinate systems whose programs end.
    pub systems: Systems,
    /// The motors that stop, or are sent elsewhere.
    pub motors: Motors,
    /// The coordinate systems whose rotary buffers the line deletes.
    pub rotary: Systems,
    /// A gather, and its buffer.
    pub gather: bool,
    /// The program buffer that is open.
    pub buffer: bool,
}

impl LineEnds {
    /// Everything, by `what`.
    #[must_use]
    pub fn all(what: &str) -> Self {
        let (what, systems) = (what.into(), Systems::ALL);
        Self {
            what,
            unnamed: false,
            systems,
            motors: Motors::ALL,
            rotary: systems,
            gather: true,
            buffer: true,
        }
    }

    /// Adds the command `said`, addressed by `sign` and `number`; returns the number's bit, or all bits without a
    /// number.
    fn add_addressed(&mut self, sign: char, number: Option<u32>, said: &[u8]) -> u32 {
        let Some(number) = number else {
            self.unnamed = true;
            self.add(format_args!(""), said);
            return u32::MAX;
        };
        let bit = Motors::of(number as usize).bits();
        if bit != 0 {
            self.add(format_args!("{sign}{number}"), said);
        }
        bit
    }

    /// Adds the command `said`, addressed by `address`.
    fn add(&mut self, address: std::fmt::Arguments<'_>, said: &[u8]) {
        let blank = if self.what.is_empty() { "" } else { " " };
        // The text leaves out characters that have no room.
        let _ = write!(self.what, "{blank}{address}");
        let letters = said.iter().filter(|byte| **byte != b' ').map(u8::to_ascii_uppercase);
        letters.for_each(|letter| self.what.write_char(char::from(letter)).unwrap_or_default());
    }
}

impl Meaning {
    /// The meaning of `line`. Allocates no memory.
    #[must_use]
    pub fn of(line: impl AsRef<[u8]>) -> Self {
        let line = line.as_ref();
        let mut reading = Reading { line, ..Reading::default() };
        tokens(line).for_each(|token| reading.take(&token));
        let mut meaning = reading.meaning;
        meaning.moves.add(moves_without_blanks(line));
        meaning.is_close = reading.count == 1 && meaning.buffer == Some(Effect::Closes);
        meaning.only_asks_for_variables = reading.count > 0 && reading.variables == reading.count;
        let are_values = meaning.only_asks_for_variables && reading.value_questions == reading.count;
        meaning.asks_for_values = if are_values { reading.values } else { 0 };
        meaning.has_address = line.contains(&b'$');
        meaning.has_password = password_at(line).is_some();
        if meaning.resets {
            meaning.ends = LineEnds::all(RESET);
            meaning.takes_away = Systems::ALL;
            // No buffer is open after a reset.
            meaning.buffer = Some(Effect::Closes);
        }
        meaning
    }

    /// What the line ends; `None` if it ends nothing.
    #[must_use]
    pub fn ends(&self) -> Option<LineEnds> {
        Some(self.ends).filter(|ends| !ends.what.is_empty())
    }

    /// The motors that may jog on, whether the board carries out or refuses the line.
    #[must_use]
    pub const fn possible_jogs(&self) -> Jogs {
        self.jogs.or(self.jogs_if_refused)
    }

    /// How long the board may take for the line, if a plain line may take `plain`.
    #[must_use]
    pub fn deadline(&self, plain: Duration) -> Duration {
        limit(self.slow, self.resets, self.values, plain)
    }

    /// Whether the line opens a program buffer for text.
    #[must_use]
    pub const fn opens(&self) -> bool {
        matches!(self.buffer, Some(Effect::Opens(_)))
    }
}

/// The motors that `line` names and moves on a board that also ignores blanks between letters: `#1 H M` homes there
/// (Software Reference p. 17: blanks are ignored). The daemon guards a held motor on both kinds of boards.
fn moves_without_blanks(line: &[u8]) -> Motors {
    let mut words = line.split(|byte| *byte == b' ').filter(|word| !word.is_empty());
    let is_letter = |byte: Option<&u8>| byte.is_some_and(u8::is_ascii_alphabetic);
    let mut before = words.next().unwrap_or_default();
    let is_parted = words.any(|word| {
        let before = std::mem::replace(&mut before, word);
        is_letter(before.last()) && is_letter(word.first())
    });
    if !is_parted {
        return Motors::NONE;
    }
    let mut packed = Text::<LINE_MAX>::default();
    for byte in line.iter().filter(|byte| **byte != b' ') {
        let _ = packed.write_char(char::from(*byte));
    }
    let mut reading = Reading { line: packed.as_bytes(), ..Reading::default() };
    tokens(packed.as_bytes()).for_each(|token| reading.take(&token));
    reading.meaning.moves
}

/// The state of reading a line.
#[derive(Default)]
struct Reading<'a> {
    line: &'a [u8],
    meaning: Meaning,
    /// How many commands the line has had, and how many of them ask for variables.
    count: usize,
    variables: usize,
    /// How many ask for values, not of M-variables.
    value_questions: usize,
    /// How many values the questions are about.
    values: u32,
    /// The motor that the line addresses by its number, and all motors that may be addressed.
    motor: Option<u32>,
    motors: Motors,
    system: Option<u32>,
    systems: Systems,
    /// The addressed coordinate system points at a program.
    points_elsewhere: bool,
    /// Whether the line has opened the rotary buffers (`true`) or another buffer (`false`) before.
    opened_rotary: Option<bool>,
    /// The jogs of the last command.
    last: Jogs,
}

impl Reading<'_> {
    fn take(&mut self, token: &Token) {
        let Token { kind, span } = token;
        let (kind, said) = (*kind, &self.line[span.clone()]);
        let meaning = &mut self.meaning;
        meaning.jogs_if_refused = meaning.jogs_if_refused.or(std::mem::take(&mut self.last));
        meaning.may_move |= kind.may_move();
        let starts = |byte: &u8| b"RS>$".contains(&byte.to_ascii_uppercase());
        meaning.may_start_program |= kind.may_move() && kind != Kind::Quoted && said.iter().any(starts);
        meaning.goes_by_address |= match kind {
            // `#` asks which motor is addressed.
            _ if matches!(said, b"#" | b"&") => false,
            Kind::AxisOf(_) | Kind::DefinesAxis(_) => false,
            _ => match kind.needs() {
                Needs::Nothing => false,
                Needs::Motor => self.motor.is_none(),
                Needs::System => self.system.is_none(),
            },
        };
        meaning.begins_with_system |= self.count == 0 && matches!(kind, Kind::System(_));
        meaning.ends_with_system = matches!(kind, Kind::System(_));
        meaning.slow = meaning.slow.max(slow(kind));
        meaning.while_open.add(self.line, token);
        self.count += 1;
        match kind {
            Kind::Motor(number) | Kind::AxisOf(number) | Kind::DefinesAxis(number) => {
                (self.motor, self.motors) = (Some(number), Motors::of(number as usize));
            }
            Kind::System(number) => {
                (self.system, self.systems) = (Some(number), Systems::of(number as usize));
                self.points_elsewhere = false;
                meaning.addresses_system = true;
            }
            Kind::Group(Needs::Motor, number) => self.motors.add(Motors::of(number as usize)),
            Kind::Group(Needs::System, number) => self.may_address(number),
            Kind::Variables(letter, numbers, does) => self.variables(letter, numbers, does, said),
            Kind::Moves(Needs::Motor, letter) => self.moves_motor(letter, said),
            Kind::Moves(_, letter) => self.moves_system(letter, said),
            Kind::Resets => meaning.resets = true,
            Kind::Saves => meaning.saves = true,
            Kind::StartsPlcs => meaning.lets_programs_move = true,
            Kind::Unknown => meaning.defines_m |= said.ends_with(b"->"),
            Kind::EndsGather | Kind::DeletesGather => {
                let what = if kind == Kind::EndsGather { "ENDGATHER" } else { "DELETE GATHER" };
                meaning.ends.gather = true;
                meaning.ends.add(format_args!("{what}"), b"");
            }
            Kind::DeletesRotary => {
                let systems = self.all_systems();
                self.meaning.takes_away.add(systems);
                self.meaning.ends.rotary.add(systems);
                self.meaning.ends.add(format_args!("DELETE ROT"), b"");
            }
            // CLEAR empties the open buffer, which this line may have opened itself.
            Kind::Clears => match self.opened_rotary {
                Some(true) => self.meaning.takes_away.add(self.all_systems()),
                Some(false) => {}
                None => self.meaning.clears.add(self.all_systems()),
            },
            Kind::Buffer(effect) => self.buffer(effect, said),
            _ => {}
        }
    }

    fn variables(&mut self, letter: u8, numbers: Numbers, does: Does, said: &[u8]) {
        let meaning = &mut self.meaning;
        meaning.values = meaning.values.saturating_add(numbers.in_range());
        match does {
            Does::Asks | Does::AsksPlace => {
                self.variables += usize::from(numbers != Numbers::Unknown);
                self.value_questions += usize::from(does == Does::Asks && letter != b'M');
                self.values = self.values.saturating_add(numbers.in_range().max(1));
            }
            Does::Defines => meaning.defines_m = true,
            Does::Sets { value, .. } => {
                if letter == b'I' {
                    meaning.settings.add(numbers, value);
                }
                // In `P1=5 &2` the `&` is most likely an operator.
                for operand in said.split(|byte| *byte == b'&').skip(1) {
                    let digits = operand.trim_ascii_start().iter().take_while(|byte| byte.is_ascii_digit());
                    let number = digits.fold(0_u32, |number, digit| {
                        number.saturating_mul(10).saturating_add(u32::from(digit - b'0'))
                    });
                    self.may_address(number);
                }
            }
        }
    }

    /// The board may take `number` for the address of a coordinate system, or for an operand.
    fn may_address(&mut self, number: u32) {
        self.systems.add(Systems::of(number as usize));
        self.points_elsewhere = false;
        self.meaning.addresses_system |= number > 0;
    }

    fn buffer(&mut self, effect: Effect, said: &[u8]) {
        let meaning = &mut self.meaning;
        meaning.buffer = Some(effect);
        let is_rotary = match effect {
            Effect::Opens(name) => is_rotary(&name),
            Effect::OpensBinary => false,
            Effect::Closes => {
                meaning.ends.buffer = true;
                meaning.ends.add(format_args!(""), said);
                return;
            }
        };
        meaning.lets_programs_move |= is_rotary || effect == Effect::OpensBinary;
        self.opened_rotary.get_or_insert(is_rotary);
    }

    fn moves_motor(&mut self, letter: u8, said: &[u8]) {
        let Self { meaning, motor, motors, .. } = self;
        let moves = !b"/K!".contains(&letter);
        meaning.stops |= b"/K".contains(&letter);
        meaning.moves.add(if moves { *motors } else { Motors::NONE });
        // For a move that names no motor only the board knows the motor.
        if letter != b'!' && (motor.is_some() || !moves) {
            let bits = meaning.ends.add_addressed('#', *motor, said);
            meaning.ends.motors.add(Motors::from_bits(bits));
        }
        if b"+-".contains(&letter) {
            self.last = Jogs { motors: *motors, unnamed: motor.is_none() };
            meaning.jogs = meaning.jogs.or(self.last);
        } else if b"/=:^KO".contains(&letter) {
            // A command that may go to another motor ends no jog, nor does one that may be a statement of a program,
            // as HOME1.
            match motor {
                Some(_) if motors.len() == 1 => meaning.jogs.motors.remove(*motors),
                None if motors.is_empty() => meaning.jogs.unnamed = false,
                _ => {}
            }
        }
    }

    fn moves_system(&mut self, letter: u8, said: &[u8]) {
        let Self { meaning, systems, system, .. } = self;
        meaning.stops |= b"AHQ/\\".contains(&letter);
        match letter {
            b'B' => {
                let program =
                    said[1..].iter().filter(|byte| **byte != b' ').take_while(|byte| **byte != b'.');
                self.points_elsewhere = program.into_iter().any(|digit| *digit != b'0');
                let pointed =
                    if self.points_elsewhere { &mut meaning.points_elsewhere } else { &mut meaning.aborts };
                pointed.add(*systems);
            }
            b'R' | b'S' if !self.points_elsewhere => meaning.starts.add(*systems),
            b'A' | b'Q' => meaning.aborts.add(*systems),
            _ => {}
        }
        if b"AQS/\\".contains(&letter) {
            let bits = meaning.ends.add_addressed('&', *system, said);
            meaning.ends.systems.add(Systems::from_bits(bits));
        }
    }

    /// The coordinate systems of a command that names none itself.
    fn all_systems(&self) -> Systems {
        if self.system.is_some() { self.systems } else { Systems::ALL }
    }
}
