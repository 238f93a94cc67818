//! What the commands of a line come to.

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

/// What resets the board, and so ends everything.
const RESET: &str = "$$$";
/// As much is told of the commands of a line that end something.
const ENDS_MAX: usize = 120;

/// What a line means, as far as its text tells. A command that names no motor or coordinate system goes to what is addressed, which
/// nobody but the board knows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Meaning {
    /// The motors that it names and moves. What stops one, `J/` or `K`, does not count.
    pub moves: Motors,
    /// It can do more than ask for, or set, variables, say whom it addresses, and save.
    pub may_move: bool,
    /// It can start a motion program.
    pub may_start_program: bool,
    /// It starts PLC programs, or opens a rotary buffer, each line of which may move something.
    pub lets_programs_move: bool,
    /// A command of it stops something.
    pub stops: bool,
    /// The coordinate systems that it names and whose programs it starts.
    pub starts: Systems,
    /// Those that it names and points at a program.
    pub points_elsewhere: Systems,
    /// Those that it names and whose programs it ends, or points at their rotary buffers.
    pub aborts: Systems,
    /// Those whose rotary buffers it takes away or empties.
    pub takes_away: Systems,
    /// Those whose rotary buffers it empties if these are open.
    pub clears: Systems,
    /// The motors that jog on when the board has carried it out, until something stops them.
    pub jogs: Jogs,
    /// The motors that may jog on when the board has refused it: what stands before the command that it refused is carried out. Which
    /// command that was nobody knows, so every jog counts, but for the last command.
    pub jogs_if_refused: Jogs,
    /// What it ends.
    pub ends: LineEnds,
    /// What it does to the program buffers in the end.
    pub buffer: Option<Effect>,
    /// It closes what is open, and does nothing else.
    pub is_close: bool,
    /// What becomes of it while a program buffer is open.
    pub while_open: WhileOpen,
    /// The I-variables that it sets.
    pub settings: Settings,
    /// It resets the board.
    pub resets: bool,
    /// It saves the board's settings.
    pub saves: bool,
    /// It points M-variables elsewhere.
    pub defines_m: bool,
    /// It has a `$`, and so may change the board's memory by an address.
    pub has_address: bool,
    /// It asks for variables, and does nothing else.
    pub only_asks_for_variables: bool,
    /// It asks for so many values of I-, P- and Q-variables by their numbers, and does nothing else; 0 where it does more.
    pub asks_for_values: u32,
    /// It sets or gives the password.
    pub has_password: bool,
    /// It goes to the motor or coordinate system that is addressed, and does not name it before.
    pub goes_by_address: bool,
    /// It addresses a coordinate system.
    pub addresses_system: bool,
    /// It begins with that.
    pub begins_with_system: bool,
    /// It ends with that.
    pub ends_with_system: bool,
    /// How long its slowest command may take, and of how many values its ranges are.
    slow: Duration,
    values: u32,
}

/// Motors that jog without an end.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Jogs {
    /// Those that the line names.
    pub motors: Motors,
    /// It jogs a motor, too, that an earlier line has addressed.
    pub unnamed: bool,
}

impl Jogs {
    /// Those of both.
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

/// What a line ends: programs, motions, a gather, or what is open. All coordinate systems and motors where it names none.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LineEnds {
    /// The commands that do it: `&1Q`.
    pub what: Text<ENDS_MAX>,
    /// A command of it names neither motor nor coordinate system, and goes to what is addressed.
    pub unnamed: bool,
    /// The coordinate systems whose programs end.
    pub systems: Systems,
    /// The motors that stop, or are sent elsewhere.
    pub motors: Motors,
    /// The coordinate systems whose rotary buffers are taken away.
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

    /// Adds the command that `said` is, to whom `sign` and `number` address; gives the bit, or all bits where nobody is.
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

    /// Adds the command that `said` is, to whom `address` says.
    fn add(&mut self, address: std::fmt::Arguments<'_>, said: &[u8]) {
        let blank = if self.what.is_empty() { "" } else { " " };
        // What has no room is left out.
        let _ = write!(self.what, "{blank}{address}");
        let letters = said.iter().filter(|byte| **byte != b' ').map(u8::to_ascii_uppercase);
        letters.for_each(|letter| self.what.write_char(char::from(letter)).unwrap_or_default());
    }
}

impl Meaning {
    /// Of `line`. Asks for no memory.
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

    /// What it ends; `None` where that is nothing.
    #[must_use]
    pub fn ends(&self) -> Option<LineEnds> {
        Some(self.ends).filter(|ends| !ends.what.is_empty())
    }

    /// The motors that may jog on, whatever becomes of the line.
    #[must_use]
    pub const fn possible_jogs(&self) -> Jogs {
        self.jogs.or(self.jogs_if_refused)
    }

    /// How long the board may take for the line, where a plain one may take `plain`.
    #[must_use]
    pub fn deadline(&self, plain: Duration) -> Duration {
        limit(self.slow, self.resets, self.values, plain)
    }

    /// Whether it opens a program buffer for text.
    #[must_use]
    pub const fn opens(&self) -> bool {
        matches!(self.buffer, Some(Effect::Opens(_)))
    }
}

/// The motors that `line` names and moves on a board that ignores the blanks between letters, too: `#1 H M` homes there (Software
/// Reference p. 17: blanks are ignored). A held motor is guarded on both.
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

/// How far a line is read.
#[derive(Default)]
struct Reading<'a> {
    line: &'a [u8],
    meaning: Meaning,
    /// How many commands it has had, and how many of them ask for variables.
    count: usize,
    variables: usize,
    /// How many ask for values, not of M-variables.
    value_questions: usize,
    /// How many values the questions are about.
    values: u32,
    /// The motor that is addressed by its number, and all that may be.
    motor: Option<u32>,
    motors: Motors,
    system: Option<u32>,
    systems: Systems,
    /// The coordinate system that is addressed points at a program.
    points_elsewhere: bool,
    /// The line has opened a buffer before, the rotary ones or another.
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
            // `#` asks which is addressed.
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
            // It empties what is open, which this line may have opened itself.
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
                // In `P1=5 &2` it is an operator, most likely.
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

    /// The board may take `number` for the address of a coordinate system, or for something else.
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
        // Of a move that names no motor nobody knows whose it is.
        if letter != b'!' && (motor.is_some() || !moves) {
            let bits = meaning.ends.add_addressed('#', *motor, said);
            meaning.ends.motors.add(Motors::from_bits(bits));
        }
        if b"+-".contains(&letter) {
            self.last = Jogs { motors: *motors, unnamed: motor.is_none() };
            meaning.jogs = meaning.jogs.or(self.last);
        } else if b"/=:^KO".contains(&letter) {
            // What may go to another motor ends no jog, nor does what may be a statement of a program, as HOME1.
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

    /// The coordinate systems that a command means, which names none of them itself.
    fn all_systems(&self) -> Systems {
        if self.system.is_some() { self.systems } else { Systems::ALL }
    }
}
