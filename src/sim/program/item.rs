//! The internal form of program lines: one [`Item`] per command, one [`Line`] per text line.
//!
//! Text, DPRAM words and `LIST` all use this form. Numbers are constants, or expressions kept as text; the board
//! evaluates these when it calculates the line. An item takes one long word of its buffer, an expression one more for
//! each operand (User Manual, "Motion programs").

use crate::sim::board::Board;
use crate::sim::board::axes::AxisMode;
use crate::sim::board::macro_stations::Transfer;
use crate::sim::board::variables::VariableKind;
use crate::sim::language::expression::evaluate;
use crate::sim::language::lock::Lock;
use crate::sim::language::scanner::Scanner;

/// The axis letters in the order of their registers.
pub const AXES: [u8; 9] = *b"ABCUVWXYZ";

/// A number of a program.
#[derive(Debug, Clone, PartialEq)]
pub enum Data {
    /// As typed.
    Constant(f64),
    /// The text between the parentheses.
    Expression(Box<str>),
}

impl Data {
    /// Its present value. An expression that cannot be evaluated (a variable number out of range) is 0.
    #[must_use]
    pub fn value(&self, board: &Board, cs: usize) -> f64 {
        match self {
            Self::Constant(value) => *value,
            Self::Expression(text) => evaluate(&mut Scanner::new(text.as_bytes()), board, cs).unwrap_or(0.0),
        }
    }

    fn words(&self) -> usize {
        match self {
            Self::Constant(_) => 0,
            Self::Expression(text) => text.bytes().filter(|c| b"+-*/%&|^<>=~(".contains(c)).count() + 1,
        }
    }
}

/// A move mode, shown in bits 4, 1, 0 of PSTATUS.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Mode {
    /// Blended straight moves.
    #[default]
    Linear,
    /// Jog-like moves.
    Rapid,
    /// Clockwise arcs.
    Circle1,
    /// Counter-clockwise arcs.
    Circle2,
    /// Splines with one segment time.
    Spline1,
    /// Splines whose segment time may change.
    Spline2,
    /// Position, velocity, time.
    Pvt,
}

impl Mode {
    /// PSTATUS bits 4, 1 and 0.
    #[must_use]
    pub const fn status(self) -> u32 {
        match self {
            Self::Linear => 0,
            Self::Rapid => 0b0_0010,
            Self::Circle1 => 0b0_0001,
            Self::Circle2 => 0b0_0011,
            Self::Spline1 | Self::Spline2 => 0b1_0001,
            Self::Pvt => 0b1_0010,
        }
    }
}

/// A mark that may follow an axis and its position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    /// `:`, the end velocity of a PVT move.
    Velocity,
    /// `^`, the distance after a trigger in a RAPID move.
    Trigger,
}

/// A modal time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Time {
    /// `TA`.
    Acceleration,
    /// `TS`.
    SCurve,
    /// `TM`.
    Move,
}

/// How a transformation changes the selected matrix.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transform {
    /// `ADIS`: displacement.
    AbsoluteDisplacement,
    /// `AROT`: rotation and scale.
    AbsoluteRotation,
    /// `IDIS`: a displacement on top of the present one.
    IncrementalDisplacement,
    /// `IROT`: a rotation on top of the present one.
    IncrementalRotation,
}

/// How to assign a variable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Operator {
    /// `=`: when the line is calculated.
    Assign,
    /// `==`: at the start of the next move.
    AssignLater,
    /// `|=`, likewise.
    Or,
    /// `^=`, likewise.
    Xor,
    /// `&=`, likewise.
    And,
}

/// The effect of a command on PLC programs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PlcSwitch {
    /// `ENABLE`: the program begins at its top.
    Enable,
    /// `DISABLE`.
    Disable,
    /// `PAUSE` (Turbo): the PLC program stops at its present line.
    Pause,
    /// `RESUME` (Turbo): a paused PLC program goes on from the line at which it stopped.
    Resume,
}

/// How a line with a condition of its own joins the condition above it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Joint {
    /// `AND`.
    And,
    /// `OR`.
    Or,
}

/// The operand of `CMD` and `SEND`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Message {
    /// `"text"`.
    Text(Box<str>),
    /// `^x`: the character's code.
    Character(u8),
}

/// One command of a program.
#[derive(Debug, Clone, PartialEq)]
pub enum Item {
    /// `LINEAR`, `RAPID`, `CIRCLEn`, `SPLINEn`.
    Mode(Mode),
    /// `PVT` and its time.
    Pvt(Data),
    /// An axis (index into [`AXES`]) and its position or distance.
    Axis(usize, Data, Option<(Mark, Data)>),
    /// Another letter with a number.
    Letter(u8, Data),
    /// `TA`, `TS`, `TM`.
    Time(Time, Data),
    /// `DWELL`.
    Dwell(Data),
    /// `DELAY`.
    Delay(Data),
    /// `CALL`.
    Call(Data),
    /// `GOTO`.
    Goto(Data),
    /// `GOSUB`.
    Gosub(Data),
    /// `N`.
    Label(u32),
    /// `RETURN`.
    Return,
    /// `NORMAL`; its vector follows.
    Normal,
    /// `PSET`; its axes follow.
    Pset,
    /// `ABS`, `INC`, `FRAX`; no list means all axes.
    Axes(AxisMode, Option<Box<[char]>>),
    /// `HOME` (or `HOMEZ`) and its motors, bit n-1 for motor n.
    Home {
        /// `HOMEZ`.
        zero: bool,
        /// The motors.
        motors: u32,
    },
    /// `ENABLE PLC` and the like; bit n for PLC n.
    Plc(PlcSwitch, u32),
    /// `ENABLE PLCC` and the like; bit n for compiled PLC n.
    Compiled(PlcSwitch, u32),
    /// `STOP`.
    Stop,
    /// `BLOCKSTART`.
    BlockStart,
    /// `BLOCKSTOP`.
    BlockStop,
    /// `WAIT`.
    Wait,
    /// `CC0`, `CC1`, `CC2`.
    CutterCompensation(u8),
    /// `CCR`.
    CutterRadius(Data),
    /// `TSELECT`.
    Select(Data),
    /// `TINIT`.
    Identity,
    /// `ADIS`, `AROT`, `IDIS`, `IROT` and the number of their first Q-variable.
    Transform(Transform, Data),
    /// An assignment: variable, its number, value.
    Assign(VariableKind, Data, Operator, Data),
    /// `IF` and the condition between its parentheses.
    If(Box<str>),
    /// `AND`, or `OR`, and a condition that goes on from the line of an `IF` or `WHILE`.
    Also(Joint, Box<str>),
    /// `ELSE`.
    Else,
    /// `ENDIF`.
    EndIf,
    /// `WHILE` and the condition between its parentheses.
    While(Box<str>),
    /// `ENDWHILE`.
    EndWhile,
    /// `READ` and its letters.
    Read(Box<[u8]>),
    /// `CMD`, and the letter of the port that its answer goes to.
    Command(Option<u8>, Message),
    /// `SEND`, and the letter of its port.
    Send(Option<u8>, Message),
    /// `DISPLAY` and its text.
    Display(Box<str>),
    /// `ADDRESS#m&n`, 0-based.
    Address(Option<usize>, Option<usize>),
    /// `MSR` or `MSW`.
    Station(Transfer),
    /// `LOCK` or `UNLOCK`.
    Lock(Lock),
    /// `SETPHASE` and its motors, bit n-1 for motor n.
    SetPhase(u32),
}

impl Item {
    /// The item's long words in its buffer.
    #[must_use]
    pub fn words(&self) -> usize {
        1 + match self {
            Self::Axis(_, position, mark) => {
                position.words() + mark.as_ref().map_or(0, |(_, value)| 1 + value.words())
            }
            Self::Assign(_, number, _, value) => number.words() + value.words(),
            Self::If(text) | Self::While(text) | Self::Also(_, text) => {
                Data::Expression(text.clone()).words()
            }
            Self::Command(_, Message::Text(text))
            | Self::Send(_, Message::Text(text))
            | Self::Display(text) => text.len().div_ceil(6),
            _ => self.number().map_or(0, Data::words),
        }
    }

    /// The number of a statement that consists of its word and one number.
    #[must_use]
    pub fn number(&self) -> Option<&Data> {
        match self {
            Self::Pvt(data)
            | Self::Letter(_, data)
            | Self::Time(_, data)
            | Self::Dwell(data)
            | Self::Delay(data)
            | Self::Call(data)
            | Self::Goto(data)
            | Self::Gosub(data)
            | Self::CutterRadius(data)
            | Self::Select(data)
            | Self::Transform(_, data) => Some(data),
            _ => None,
        }
    }
}

/// One program line: the text up to one carriage return.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Line {
    /// Its commands in order; never empty.
    pub items: Vec<Item>,
    /// Its start in its buffer, in long words.
    pub offset: usize,
}

impl Line {
    /// The line's long words.
    #[must_use]
    pub fn words(&self) -> usize {
        self.items.iter().map(Item::words).sum()
    }
}
