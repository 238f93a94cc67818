//! Keywords of program statements, long and short forms (Software Reference, "Program commands"; QRG p. 56).

use crate::sim::board::axes::AxisMode;
use crate::sim::program::item::{Joint, Mode, PlcSwitch, Time, Transform};

/// What a keyword of a program begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Keyword {
    /// A mode without number.
    Mode(Mode),
    /// `CIRCLE`; 1 or 2 follows.
    Circle,
    /// `SPLINE`; 1 or 2 follows.
    Spline,
    /// `PVT`.
    Pvt,
    /// `NORMAL`.
    Normal,
    /// `PSET`.
    Pset,
    /// `STOP`.
    Stop,
    /// `BLOCKSTART`.
    BlockStart,
    /// `BLOCKSTOP`.
    BlockStop,
    /// `CC`; 0, 1 or 2 follows.
    CutterCompensation,
    /// `CCR`.
    CutterRadius,
    /// `TSELECT`.
    Select,
    /// `TINIT`.
    Identity,
    /// `ADIS` and the like.
    Transform(Transform),
    /// `WAIT`.
    Wait,
    /// `TA`, `TS`, `TM`.
    Time(Time),
    /// `DWELL`.
    Dwell,
    /// `DELAY`.
    Delay,
    /// `CALL`.
    Call,
    /// `CMD`.
    Command,
    /// `SEND`.
    Send,
    /// `DISPLAY`.
    Display,
    /// `ADDRESS`.
    Address,
    /// `IF`.
    If,
    /// `AND`, `OR`.
    Also(Joint),
    /// `END`; `IF` or `WHILE` follows.
    End,
    /// `ELSE`.
    Else,
    /// `ENDIF`.
    EndIf,
    /// `WHILE`.
    While,
    /// `ENDWHILE`.
    EndWhile,
    /// `GOTO`.
    Goto,
    /// `GOSUB`.
    Gosub,
    /// `RETURN`.
    Return,
    /// `READ`.
    Read,
    /// `ABS`, `INC`, `FRAX`.
    Axes(AxisMode),
    /// `HOME`, or `HOMEZ` with `true`; motors follow, or it is the on-line command.
    Home(bool),
    /// `ENABLE` and the like; `PLC` follows.
    Plc(PlcSwitch),
    /// `LOCK`, or `UNLOCK` with `false`, of Turbo alone.
    Lock(bool),
    /// `SETPHASE`, of Turbo alone.
    SetPhase,
}

use Keyword as K;

/// The table.
pub const WORDS: &[(&str, Keyword)] = &[
    ("LINEAR", K::Mode(Mode::Linear)),
    ("LIN", K::Mode(Mode::Linear)),
    ("RAPID", K::Mode(Mode::Rapid)),
    ("RPD", K::Mode(Mode::Rapid)),
    ("CIRCLE", K::Circle),
    ("CIR", K::Circle),
    ("SPLINE", K::Spline),
    ("PVT", K::Pvt),
    ("NORMAL", K::Normal),
    ("NORM", K::Normal),
    ("NRM", K::Normal),
    ("PSET", K::Pset),
    ("STOP", K::Stop),
    ("BLOCKSTART", K::BlockStart),
    ("BSTART", K::BlockStart),
    ("BLOCKSTOP", K::BlockStop),
    ("BSTOP", K::BlockStop),
    ("CC", K::CutterCompensation),
    ("CCR", K::CutterRadius),
    ("TSELECT", K::Select),
    ("TSEL", K::Select),
    ("TINIT", K::Identity),
    ("ADIS", K::Transform(Transform::AbsoluteDisplacement)),
    ("AROT", K::Transform(Transform::AbsoluteRotation)),
    ("IDIS", K::Transform(Transform::IncrementalDisplacement)),
    ("IROT", K::Transform(Transform::IncrementalRotation)),
    ("WAIT", K::Wait),
    ("TA", K::Time(Time::Acceleration)),
    ("TS", K::Time(Time::SCurve)),
    ("TM", K::Time(Time::Move)),
    ("DWELL", K::Dwell),
    ("DWE", K::Dwell),
    ("DELAY", K::Delay),
    ("DLY", K::Delay),
    ("CALL", K::Call),
    ("COMMAND", K::Command),
    ("CMD", K::Command),
    ("SEND", K::Send),
    ("DISPLAY", K::Display),
    ("DISP", K::Display),
    ("ADDRESS", K::Address),
    ("ADR", K::Address),
    ("IF", K::If),
    ("AND", K::Also(Joint::And)),
    ("OR", K::Also(Joint::Or)),
    ("END", K::End),
    ("ELSE", K::Else),
    ("ENDIF", K::EndIf),
    ("ENDI", K::EndIf),
    ("WHILE", K::While),
    ("ENDWHILE", K::EndWhile),
    ("ENDW", K::EndWhile),
    ("GOTO", K::Goto),
    ("GOSUB", K::Gosub),
    ("RETURN", K::Return),
    ("RET", K::Return),
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
    ("PAUSE", K::Plc(PlcSwitch::Pause)),
    ("PAU", K::Plc(PlcSwitch::Pause)),
    ("RESUME", K::Plc(PlcSwitch::Resume)),
    ("RES", K::Plc(PlcSwitch::Resume)),
    ("LOCK", K::Lock(true)),
    ("UNLOCK", K::Lock(false)),
    ("SETPHASE", K::SetPhase),
];

/// What may stand behind `END` and a blank, as in files that sites load into their boards.
pub const ENDED: &[(&str, Keyword)] = &[("IF", K::EndIf), ("WHILE", K::EndWhile)];
