//! The types and errors of the interface `io.github.pmac-dpram.Board`.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::{BOARD, SERVICE, message::Reply};

/// Whether the data in the segment can be trusted now. The segment holds the number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u32)]
pub enum State {
    /// The daemon is identifying the board.
    #[default]
    Init = 0,
    /// The board updates its data.
    Live = 1,
    /// The board has stopped updating its data.
    Stale = 2,
    /// The daemon is gone or stopping: attach again.
    Dead = 3,
}

impl State {
    /// The state of that number; an unknown one cannot be trusted and counts as dead.
    #[must_use]
    pub const fn from_number(number: u64) -> Self {
        match number {
            0 => Self::Init,
            1 => Self::Live,
            2 => Self::Stale,
            _ => Self::Dead,
        }
    }
}

bitflags::bitflags! {
    /// The automatic functions at work.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
    pub struct Enabled: u32 {
        /// Servo fixed data (I48).
        const SERVO = 1;
        /// Background fixed data (I49).
        const BACKGROUND = 1 << 1;
        /// ASCII communication (I58).
        const ASCII = 1 << 2;
        /// The interrupt that announces a reply (I56).
        const INTERRUPT = 1 << 3;
    }
}

impl Enabled {
    /// The functions' names as `GetInfo` gives them.
    #[must_use]
    pub fn names(self) -> Vec<String> {
        self.iter_names().map(|(name, _)| name.to_ascii_lowercase()).collect()
    }
}

/// The board and the daemon that owns it: the reply of `GetInfo`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct BoardInfo {
    /// The board's name, as in `--name`.
    pub name: String,
    /// The version of pmacd.
    pub version: String,
    /// How the board is reached, as in `--board`.
    pub board: String,
    /// The board's family: `pmac`, `pmac2`, `turbo`, `turbo2`.
    pub family: String,
    /// The answer to `VERSION`, when it is known.
    pub firmware: Option<String>,
    /// The answer to `TYPE`, when it is known.
    pub board_type: Option<String>,
    /// How many motors the board reports.
    pub motors: u32,
    /// The servo cycle in nanoseconds, when it is known.
    pub servo_period_ns: Option<u64>,
    /// Whether the data in the segment can be trusted now.
    pub state: State,
    /// Differs for every start of the daemon.
    pub generation: u64,
    /// The daemon's process.
    pub pid: u32,
    /// The POSIX shared-memory object with the live data, `/pmac0`.
    pub segment: String,
    /// The automatic functions at work: `servo`, `background`, `ascii`, `interrupt`.
    pub enabled: Vec<String>,
    /// Which port command lines go through now.
    #[serde(default)]
    pub command_port: CommandPort,
    /// What became of the last command line.
    #[serde(default)]
    pub command_state: CommandState,
    /// The interrupt controller behind the board's host port, where the daemon serves it.
    #[serde(default)]
    pub host_port: Option<HostPortInfo>,
}

/// A port for command lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u32)]
pub enum CommandPort {
    /// The DPRAM's ASCII buffers.
    #[default]
    Dpram = 0,
    /// The VME mailboxes.
    Mailbox = 1,
}

/// Whether the board answers command lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u32)]
pub enum CommandState {
    /// None was sent since the daemon's start or the last change of the port.
    #[default]
    Unknown = 0,
    /// The last one was answered.
    Answers = 1,
    /// The last one was not.
    Silent = 2,
}

/// The interrupt controller behind a host port.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct HostPortInfo {
    /// `pic8259` or `pmac2`.
    pub controller: String,
    /// The line, 0 to 7.
    pub line: u32,
    /// Interrupts served since the daemon's start.
    pub served: u32,
    /// Of these, how many were old ones: no response was there any more.
    pub old: u32,
    /// Responses whose interrupt never came.
    pub unannounced: u32,
}

/// Which statement of a PMAC program caused a text.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MessageKind {
    /// The response to a `CMD"…"`.
    Cmd,
    /// A `SEND"…"`.
    Send,
}

/// A text that a PMAC program sent by itself: one reply of `Messages`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Message {
    /// CLOCK_MONOTONIC when the text was read, nanoseconds.
    pub time_ns: u64,
    /// The statement that caused it.
    pub kind: MessageKind,
    /// The text.
    pub text: String,
    /// How many texts were dropped before this one because this caller read too slowly.
    pub lost: u64,
}

/// The reply of a method that returns nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Done {}

/// The reply of `Send`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SendReply {
    /// The reply, one element a line.
    pub lines: Vec<String>,
}

/// The reply of `Read`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReadReply {
    /// CLOCK_MONOTONIC of the first read, nanoseconds.
    pub time_ns: u64,
    /// The words, ascending.
    pub words: Vec<u16>,
}

/// The reply of `FeedOverride`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct NotesReply {
    /// What the caller should know of the effect, one sentence each; none when all is as it should be.
    pub notes: Vec<String>,
}

/// The reply of `WatchVariables`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct WatchReply {
    /// How many registers.
    pub watched: usize,
    /// The number of the first table that has them all, as the segment's variable region tells it.
    pub table: u32,
}

/// A register to write: an element of `WriteVariables`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VariableRecord {
    /// `Y:$0700`, `X:$0701`, `D:$0728` or `L:$1005`.
    pub register: String,
    /// Of a Y or X word, the lowest bit to write; 0 when not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub offset: Option<u8>,
    /// Of a Y or X word, how many bits to write: 1, 4, 8, 12, 16, 20 or 24; 24 when not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub width: Option<u8>,
    /// The value; whole for all but `L:`.
    pub value: f64,
}

/// The reply of `RotaryState`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RotaryStateReply {
    /// Commands in the buffer that the board has not taken.
    pub ahead_commands: u32,
    /// Lines in the buffer that the board has not taken wholly.
    pub ahead_lines: u64,
    /// Lines put into the buffer since it was set up.
    pub sent_lines: u64,
    /// The board's internal rotary buffer is full.
    pub busy: bool,
    /// The board's error code, if it reports one.
    pub error: Option<u8>,
    /// How often the buffer was found empty though more lines were to follow.
    pub underruns: u64,
}

/// An error that the service answers.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CallError {
    /// The board refused the line.
    #[error("ERR{code:03}: {meaning}")]
    Board {
        /// The number of `ERRnnn`.
        code: u16,
        /// What the number means.
        meaning: String,
        /// What the board had answered before.
        lines: Vec<String>,
    },
    /// The board did not answer in time.
    #[error(
        "the board did not answer in time{}; the line may or may not have been carried out",
        so_far(lines)
    )]
    TimedOut {
        /// What had come of its reply.
        lines: Vec<String>,
    },
    /// The board does not take commands now.
    #[error("the board does not take commands now: {reason}")]
    Unavailable {
        /// Why, and what to do.
        reason: String,
    },
    /// Too many commands wait already.
    #[error("too many commands wait already; nothing was sent, try again")]
    Busy,
    /// The caller lacks a role.
    #[error("not permitted: this needs the role {role_needed}; ask the administrator for its group")]
    NotPermitted {
        /// The role: observe, operate or engineer.
        role_needed: String,
    },
    /// The line cannot be sent to a board.
    #[error("invalid line: {reason}")]
    InvalidLine {
        /// What is wrong and where.
        reason: String,
    },
    /// It cannot be done; nothing has been written.
    #[error("{reason}")]
    Refused {
        /// Why, and what to do.
        reason: String,
    },
    /// The words lie outside the board's window.
    #[error("the words lie outside the board's window, or there are more than 64")]
    OutOfRange,
    /// A parameter is missing, of the wrong type, or not known.
    #[error("invalid parameter {parameter}{}", and_what(expected))]
    InvalidParameter {
        /// Its name.
        parameter: String,
        /// What it takes.
        expected: String,
    },
    /// There is no such interface.
    #[error("the service has no interface {interface}")]
    InterfaceNotFound {
        /// Its name.
        interface: String,
    },
    /// There is no such method.
    #[error("the service has no method {method}")]
    MethodNotFound {
        /// Its name with that of the interface.
        method: String,
    },
    /// The method streams and was not called so.
    #[error("the method streams its replies: call it with \"more\"")]
    ExpectedMore,
    /// The other side does not follow the protocol.
    #[error("the service answered something that is not understood: {0}")]
    Protocol(String),
}

/// What a parameter takes, where that is known.
fn and_what(expected: &str) -> String {
    if expected.is_empty() { String::new() } else { format!(": {expected}") }
}

/// How much of a reply had come when it was given up.
fn so_far(lines: &[String]) -> String {
    match lines.len() {
        0 => String::new(),
        1 => ": 1 line of its reply had come, its end had not".to_owned(),
        count => format!(": {count} lines of its reply had come, its end had not"),
    }
}

impl CallError {
    /// A parameter is not what it should be.
    #[must_use]
    pub fn invalid(parameter: &str, expected: impl std::fmt::Display) -> Self {
        Self::InvalidParameter { parameter: parameter.to_owned(), expected: expected.to_string() }
    }

    /// The error as a reply.
    #[must_use]
    pub fn to_reply(&self) -> Reply {
        let (interface, name, parameters) = match self {
            Self::Board { code, meaning, lines } => {
                (BOARD, "BoardError", json!({"code": code, "meaning": meaning, "lines": lines}))
            }
            Self::TimedOut { lines } => (BOARD, "TimedOut", json!({"lines": lines})),
            Self::Unavailable { reason } => (BOARD, "Unavailable", json!({"reason": reason})),
            Self::Busy => (BOARD, "Busy", Value::Null),
            Self::NotPermitted { role_needed } => {
                (BOARD, "NotPermitted", json!({"role_needed": role_needed}))
            }
            Self::InvalidLine { reason } => (BOARD, "InvalidLine", json!({"reason": reason})),
            Self::Refused { reason } => (BOARD, "Refused", json!({"reason": reason})),
            Self::OutOfRange => (BOARD, "OutOfRange", Value::Null),
            Self::InvalidParameter { parameter, expected } => {
                (SERVICE, "InvalidParameter", json!({"parameter": parameter, "expected": expected}))
            }
            Self::InterfaceNotFound { interface } => {
                (SERVICE, "InterfaceNotFound", json!({"interface": interface}))
            }
            Self::MethodNotFound { method } => (SERVICE, "MethodNotFound", json!({"method": method})),
            Self::ExpectedMore => (SERVICE, "ExpectedMore", Value::Null),
            // Only a reply of our own that does not serialise; the caller learns at least that.
            Self::Protocol(what) => (BOARD, "Unavailable", json!({"reason": what})),
        };
        let parameters = match parameters {
            Value::Object(map) => map,
            _ => Map::new(),
        };
        Reply { parameters: Some(parameters), continues: None, error: Some(format!("{interface}.{name}")) }
    }

    /// The error that `reply` carries, or `None` when it carries none.
    #[must_use]
    pub fn from_reply(reply: &Reply) -> Option<Self> {
        let full_name = reply.error.as_deref()?;
        let fields = reply.parameters.clone().unwrap_or_default();
        let text = |name: &str| fields.get(name).and_then(Value::as_str).unwrap_or_default().to_owned();
        let lines = || {
            let lines = fields.get("lines").and_then(|lines| serde_json::from_value(lines.clone()).ok());
            lines.unwrap_or_default()
        };
        let (interface, name) = full_name.rsplit_once('.').unwrap_or(("", full_name));
        Some(match (interface, name) {
            (BOARD, "BoardError") => Self::Board {
                code: fields
                    .get("code")
                    .and_then(Value::as_u64)
                    .and_then(|c| u16::try_from(c).ok())
                    .unwrap_or(0),
                meaning: text("meaning"),
                lines: lines(),
            },
            (BOARD, "TimedOut") => Self::TimedOut { lines: lines() },
            (BOARD, "Unavailable") => Self::Unavailable { reason: text("reason") },
            (BOARD, "Busy") => Self::Busy,
            (BOARD, "NotPermitted") => Self::NotPermitted { role_needed: text("role_needed") },
            (BOARD, "InvalidLine") => Self::InvalidLine { reason: text("reason") },
            (BOARD, "Refused") => Self::Refused { reason: text("reason") },
            (BOARD, "OutOfRange") => Self::OutOfRange,
            (SERVICE, "InvalidParameter") => {
                Self::InvalidParameter { parameter: text("parameter"), expected: text("expected") }
            }
            (SERVICE, "InterfaceNotFound") => Self::InterfaceNotFound { interface: text("interface") },
            (SERVICE, "MethodNotFound") => Self::MethodNotFound { method: text("method") },
            (SERVICE, "ExpectedMore") => Self::ExpectedMore,
            _ => Self::Protocol(full_name.to_owned()),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_survive_the_wire() {
        let text = || "why".to_owned();
        for error in [
            CallError::Board { code: 3, meaning: text(), lines: vec![text()] },
            CallError::TimedOut { lines: vec![text(), text()] },
            CallError::TimedOut { lines: Vec::new() },
            CallError::Unavailable { reason: text() },
            CallError::Busy,
            CallError::NotPermitted { role_needed: text() },
            CallError::InvalidLine { reason: text() },
            CallError::OutOfRange,
            CallError::InvalidParameter { parameter: text(), expected: text() },
            CallError::InterfaceNotFound { interface: text() },
            CallError::MethodNotFound { method: text() },
            CallError::ExpectedMore,
        ] {
            assert_eq!(CallError::from_reply(&error.to_reply()), Some(error));
        }
        assert_eq!(CallError::from_reply(&Reply::default()), None);
        let foreign = Reply { error: Some("x.Y".to_owned()), ..Reply::default() };
        assert_eq!(CallError::from_reply(&foreign), Some(CallError::Protocol("x.Y".to_owned())));
    }

    #[test]
    fn enabled_functions_have_names() {
        assert_eq!((Enabled::SERVO | Enabled::ASCII).names(), ["servo", "ascii"]);
    }
}
