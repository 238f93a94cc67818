//! The errors that the service answers a call with.

use std::fmt;

use serde::{Deserialize, Serialize};

/// An error of the service, named on the wire with its interface.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error, Serialize, Deserialize)]
#[serde(tag = "error", content = "parameters")]
#[non_exhaustive]
pub enum CallError {
    /// The board refused the line.
    #[error("ERR{code:03}: {meaning}")]
    #[serde(rename = "io.github.pmac-dpram.Board.BoardError")]
    Board {
        /// The number of `ERRnnn`.
        code: u16,
        /// The number's meaning.
        meaning: String,
        /// The board's answer before the error.
        lines: Vec<String>,
    },
    /// The board did not answer in time.
    #[error(
        "the board did not answer in time{}; the line may or may not have been carried out",
        so_far(lines)
    )]
    #[serde(rename = "io.github.pmac-dpram.Board.TimedOut")]
    TimedOut {
        /// The part of the reply that had come.
        lines: Vec<String>,
    },
    /// The command ended before the board had answered. The board may have been carrying it out.
    #[error("{reason}; it may or may not have been carried out")]
    #[serde(rename = "io.github.pmac-dpram.Board.Interrupted")]
    Interrupted {
        /// Why the command ended.
        reason: String,
    },
    /// The board does not take commands now. The daemon sent none.
    #[error("the board does not take commands now: {reason}")]
    #[serde(rename = "io.github.pmac-dpram.Board.Unavailable")]
    Unavailable {
        /// Why, and what to do.
        reason: String,
    },
    /// Other clients' commands, or the daemon's own questions, took the board's time until the caller's time-out.
    #[error("the board is busy with other commands; nothing was sent, try again")]
    #[serde(rename = "io.github.pmac-dpram.Board.Busy")]
    Busy,
    /// The caller lacks a role.
    #[error("not permitted: this needs the role {role_needed}; ask the administrator for its group")]
    #[serde(rename = "io.github.pmac-dpram.Board.NotPermitted")]
    NotPermitted {
        /// The role: observe, stop, operate or engineer.
        role_needed: String,
    },
    /// The line cannot be sent to a board.
    #[error("invalid line: {reason}")]
    #[serde(rename = "io.github.pmac-dpram.Board.InvalidLine")]
    InvalidLine {
        /// The fault and its place.
        reason: String,
    },
    /// The daemon refuses the call, and has written nothing.
    #[error("{reason}")]
    #[serde(rename = "io.github.pmac-dpram.Board.Refused")]
    Refused {
        /// Why, and what to do.
        reason: String,
    },
    /// A stop did not go as asked: a motor that should stand may still move, or the stop stopped more than asked.
    #[error("{reason}")]
    #[serde(rename = "io.github.pmac-dpram.Board.StopFailed")]
    StopFailed {
        /// The motors that may move, those that the stop stopped, and the cure.
        reason: String,
    },
    /// The words do not all lie in the board's window.
    #[error("the words do not all lie in the board's window")]
    #[serde(rename = "io.github.pmac-dpram.Board.OutOfRange")]
    OutOfRange,
    /// A parameter is missing, of the wrong type, or not known.
    #[error("invalid parameter {parameter}{}", and_what(expected))]
    #[serde(rename = "org.varlink.service.InvalidParameter")]
    InvalidParameter {
        /// Its name.
        parameter: String,
        /// The values that the parameter takes.
        expected: String,
    },
    /// The service has no such interface.
    #[error("the service has no interface {interface}")]
    #[serde(rename = "org.varlink.service.InterfaceNotFound")]
    InterfaceNotFound {
        /// Its name.
        interface: String,
    },
    /// The service has no such method.
    #[error("the service has no method {method}")]
    #[serde(rename = "org.varlink.service.MethodNotFound")]
    MethodNotFound {
        /// Its name with that of the interface.
        method: String,
    },
    /// The method streams its replies, and the caller did not ask for `more`.
    #[error("the method streams its replies: call it with \"more\"")]
    #[serde(rename = "org.varlink.service.ExpectedMore")]
    ExpectedMore,
    /// The other side does not follow the protocol.
    #[error("the service answered something that is not understood: {0}")]
    #[serde(skip)]
    Protocol(String),
}

/// The values that a parameter takes, if known.
fn and_what(expected: &str) -> String {
    if expected.is_empty() { String::new() } else { format!(": {expected}") }
}

/// How much of a reply had come when the daemon gave it up.
fn so_far(lines: &[String]) -> String {
    match lines.len() {
        0 => String::new(),
        1 => ": 1 line of its reply had come, its end had not".to_owned(),
        count => format!(": {count} lines of its reply had come, its end had not"),
    }
}

impl CallError {
    /// The daemon refuses the call for this reason, and has written nothing.
    pub fn refused(reason: impl fmt::Display) -> Self {
        Self::Refused { reason: reason.to_string() }
    }

    /// The same error with the cause appended to its reason, if it has one.
    #[must_use]
    pub fn because(mut self, cause: &Self) -> Self {
        if let Self::Refused { reason } | Self::Interrupted { reason } = &mut self {
            *reason = format!("{reason}: {cause}");
        }
        self
    }

    /// Takes out the board's answer before the error.
    pub fn take_lines(&mut self) -> Vec<String> {
        match self {
            Self::Board { lines, .. } | Self::TimedOut { lines } => std::mem::take(lines),
            _ => Vec::new(),
        }
    }

    /// A parameter has a wrong value.
    #[must_use]
    pub fn invalid(parameter: &str, expected: impl std::fmt::Display) -> Self {
        Self::InvalidParameter { parameter: parameter.to_owned(), expected: expected.to_string() }
    }

    /// A replay refuses the call, for the reason `what`.
    #[must_use]
    pub fn of_replay(what: impl std::fmt::Display) -> Self {
        Self::Refused { reason: format!("this is a replay of a recording, no board: {what}") }
    }

    /// A replay refuses calls that move, write or set.
    #[must_use]
    pub fn replay_moves_nothing() -> Self {
        Self::of_replay("nothing can be moved, written or set")
    }
}
