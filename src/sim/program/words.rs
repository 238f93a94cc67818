//! Keywords of program statements, long and short forms (Software Reference, "Program commands"; QRG p. 56).
//!
//! One table serves the parser, `LIST` and the binary commands. The rows of a statement follow each other: its long word
//! first, its short word last.

use crate::map::Generation;
use crate::sim::board::axes::AxisMode;
use crate::sim::program::item::{Data, Item, Joint, Mode, PlcSwitch, Time, Transform};

/// The statement that a keyword of a program begins.
#[derive(Debug, Clone)]
pub enum Keyword {
    /// A statement that is its word alone.
    Alone(Item),
    /// A statement with one number.
    Number(fn(Data) -> Item),
    /// A statement with a condition in parentheses.
    Condition(fn(Box<str>) -> Item),
    /// `CIRCLE`; 1 or 2 follows.
    Circle,
    /// `SPLINE`; 1 or 2 follows.
    Spline,
    /// `CC`; 0, 1 or 2 follows.
    CutterCompensation,
    /// `CMD`.
    Command,
    /// `SEND`.
    Send,
    /// `DISPLAY`.
    Display,
    /// `ADDRESS`.
    Address,
    /// `END`; `IF` or `WHILE` follows.
    End,
    /// `READ`.
    Read,
    /// `ABS`, `INC`, `FRAX`.
    Axes(AxisMode),
    /// `HOME`, or `HOMEZ` with `true`; without motors after it, the word is the on-line command.
    Home(bool),
    /// `ENABLE` and the like; `PLC` follows.
    Plc(PlcSwitch),
    /// `LOCK`, or `UNLOCK` with `false`.
    Lock(bool),
    /// `SETPHASE`.
    SetPhase,
}

use Keyword as K;

/// The words of every board.
static WORDS: &[(&str, Keyword)] = &[
    ("LINEAR", K::Alone(Item::Mode(Mode::Linear))),
    ("LIN", K::Alone(Item::Mode(Mode::Linear))),
    ("RAPID", K::Alone(Item::Mode(Mode::Rapid))),
    ("RPD", K::Alone(Item::Mode(Mode::Rapid))),
    ("CIRCLE", K::Circle),
    ("CIR", K::Circle),
    ("SPLINE", K::Spline),
    ("PVT", K::Number(Item::Pvt)),
    ("NORMAL", K::Alone(Item::Normal)),
    ("NORM", K::Alone(Item::Normal)),
    ("NRM", K::Alone(Item::Normal)),
    ("PSET", K::Alone(Item::Pset)),
    ("STOP", K::Alone(Item::Stop)),
    ("BLOCKSTART", K::Alone(Item::BlockStart)),
    ("BSTART", K::Alone(Item::BlockStart)),
    ("BLOCKSTOP", K::Alone(Item::BlockStop)),
    ("BSTOP", K::Alone(Item::BlockStop)),
    ("CC", K::CutterCompensation),
    ("CCR", K::Number(Item::CutterRadius)),
    ("TSELECT", K::Number(Item::Select)),
    ("TSEL", K::Number(Item::Select)),
    ("TINIT", K::Alone(Item::Identity)),
    ("ADIS", K::Number(|first| Item::Transform(Transform::AbsoluteDisplacement, first))),
    ("AROT", K::Number(|first| Item::Transform(Transform::AbsoluteRotation, first))),
    ("IDIS", K::Number(|first| Item::Transform(Transform::IncrementalDisplacement, first))),
    ("IROT", K::Number(|first| Item::Transform(Transform::IncrementalRotation, first))),
    ("WAIT", K::Alone(Item::Wait)),
    ("TA", K::Number(|time| Item::Time(Time::Acceleration, time))),
    ("TS", K::Number(|time| Item::Time(Time::SCurve, time))),
    ("TM", K::Number(|time| Item::Time(Time::Move, time))),
    ("DWELL", K::Number(Item::Dwell)),
    ("DWE", K::Number(Item::Dwell)),
    ("DELAY", K::Number(Item::Delay)),
    ("DLY", K::Number(Item::Delay)),
    ("CALL", K::Number(Item::Call)),
    ("COMMAND", K::Command),
    ("CMD", K::Command),
    ("SEND", K::Send),
    ("DISPLAY", K::Display),
    ("DISP", K::Display),
    ("ADDRESS", K::Address),
    ("ADR", K::Address),
    ("IF", K::Condition(Item::If)),
    ("AND", K::Condition(|condition| Item::Also(Joint::And, condition))),
    ("OR", K::Condition(|condition| Item::Also(Joint::Or, condition))),
    ("END", K::End),
    ("ELSE", K::Alone(Item::Else)),
    ("ENDIF", K::Alone(Item::EndIf)),
    ("ENDI", K::Alone(Item::EndIf)),
    ("WHILE", K::Condition(Item::While)),
    ("ENDWHILE", K::Alone(Item::EndWhile)),
    ("ENDW", K::Alone(Item::EndWhile)),
    ("GOTO", K::Number(Item::Goto)),
    ("GOSUB", K::Number(Item::Gosub)),
    ("RETURN", K::Alone(Item::Return)),
    ("RET", K::Alone(Item::Return)),
    ("READ", K::Read),
    ("ABS", K::Axes(AxisMode::Absolute)),
    ("INC", K::Axes(AxisMode::Incremental)),
    ("FRAX", K::Axes(AxisMode::Feedrate)),
    ("HOME", K::Home(false)),
    ("HM", K::Home(false)),
    ("HOMEZ", K::Home(true)),
    ("HMZ", K::Home(true)),
    ("ENABLE", K::Plc(PlcSwitch::Enable)),
    ("ENA", K::Plc(PlcSwitch::Enable)),
    ("DISABLE", K::Plc(PlcSwitch::Disable)),
    ("DIS", K::Plc(PlcSwitch::Disable)),
];

/// The words that Turbo has on top.
static TURBO: &[(&str, Keyword)] = &[
    ("PAUSE", K::Plc(PlcSwitch::Pause)),
    ("PAU", K::Plc(PlcSwitch::Pause)),
    ("RESUME", K::Plc(PlcSwitch::Resume)),
    ("RES", K::Plc(PlcSwitch::Resume)),
    ("LOCK", K::Lock(true)),
    ("UNLOCK", K::Lock(false)),
    ("SETPHASE", K::SetPhase),
];

/// The tables of the boards of a generation.
#[must_use]
pub fn tables(generation: Generation) -> &'static [&'static [(&'static str, Keyword)]] {
    static PMAC_TABLES: &[&[(&str, Keyword)]] = &[WORDS];
    static TURBO_TABLES: &[&[(&str, Keyword)]] = &[WORDS, TURBO];
    match generation {
        Generation::Pmac => PMAC_TABLES,
        Generation::Turbo => TURBO_TABLES,
    }
}

/// The items that may stand behind `END` and a blank, as in files that sites load into their boards.
pub static ENDED: &[(&str, Item)] = &[("IF", Item::EndIf), ("WHILE", Item::EndWhile)];

/// The long or the short word of the keyword that `is_meant` accepts.
pub fn name(long: bool, is_meant: impl Fn(&Keyword) -> bool) -> &'static str {
    let mut names = WORDS.iter().chain(TURBO).filter(|(_, keyword)| is_meant(keyword)).map(|(name, _)| *name);
    let name = if long { names.next() } else { names.last() };
    name.unwrap_or_default()
}

/// The word of a statement that consists of a word alone, or of a word and one number.
#[must_use]
pub fn name_of(item: &Item, long: bool) -> &'static str {
    name(long, |keyword| match keyword {
        Keyword::Alone(own) => own == item,
        Keyword::Number(make) => item.number().is_some_and(|number| make(number.clone()) == *item),
        _ => false,
    })
}
