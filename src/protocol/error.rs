//! What a call is refused with.

use std::fmt;

use serde::{Deserialize, Serialize};

/// An error that the service answers, named on the wire with its interface.
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
    #[serde(rename = "io.github.pmac-dpram.Board.TimedOut")]
    TimedOut {
        /// What had come of its reply.
        lines: Vec<String>,
    },
    /// The command ended before the board had answered. The board may have been at it.
    #[error("{reason}; it may or may not have been carried out")]
    #[serde(rename = "io.github.pmac-dpram.Board.Interrupted")]
    Interrupted {
        /// What ended it.
        reason: String,
    },
    /// The board does not take commands now. Nothing was sent.
    #[error("the board does not take commands now: {reason}")]
    #[serde(rename = "io.github.pmac-dpram.Board.Unavailable")]
    Unavailable {
        /// Why, and what to do.
        reason: String,
    },
    /// Others' commands, or questions of the daemon's, took the board's time until the caller's was over.
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
        /// What is wrong and where.
        reason: String,
    },
    /// It cannot be done; nothing has been written.
    #[error("{reason}")]
    #[serde(rename = "io.github.pmac-dpram.Board.Refused")]
    Refused {
        /// Why, and what to do.
        reason: String,
    },
    /// A stop did not go as asked: what was to stand may still move, or more was stopped.
    #[error("{reason}")]
    #[serde(rename = "io.github.pmac-dpram.Board.StopFailed")]
    StopFailed {
        /// What may move, what was stopped, and what to do.
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
        /// What it takes.
        expected: String,
    },
    /// There is no such interface.
    #[error("the service has no interface {interface}")]
    #[serde(rename = "org.varlink.service.InterfaceNotFound")]
    InterfaceNotFound {
        /// Its name.
        interface: String,
    },
    /// There is no such method.
    #[error("the service has no method {method}")]
    #[serde(rename = "org.varlink.service.MethodNotFound")]
    MethodNotFound {
        /// Its name with that of the interface.
        method: String,
    },
    /// The method streams and was not called so.
    #[error("the method streams its replies: call it with \"more\"")]
    #[serde(rename = "org.varlink.service.ExpectedMore")]
    ExpectedMore,
    /// The other side does not follow the protocol.
    #[error("the service answered something that is not understood: {0}")]
    #[serde(skip)]
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
    /// It cannot be done, for this reason; nothing has been written.
    pub fn refused(reason: impl fmt::Display) -> Self {
        Self::Refused { reason: reason.to_string() }
    }

    /// The same with the cause behind its reason, where it has one.
    #[must_use]
    pub fn because(mut self, cause: &Self) -> Self {
        if let Self::Refused { reason } | Self::Interrupted { reason } = &mut self {
            *reason = format!("{reason}: {cause}");
        }
        self
    }

    /// Takes out what the board had answered before the error.
    pub fn take_lines(&mut self) -> Vec<String> {
        match self {
            Self::Board { lines, .. } | Self::TimedOut { lines } => std::mem::take(lines),
            _ => Vec::new(),
        }
    }

    /// A parameter is not what it should be.
    #[must_use]
    pub fn invalid(parameter: &str, expected: impl std::fmt::Display) -> Self {
        Self::InvalidParameter { parameter: parameter.to_owned(), expected: expected.to_string() }
    }

    /// Something cannot be asked of a replay, for the reason `what`.
    #[must_use]
    pub fn of_replay(what: impl std::fmt::Display) -> Self {
        Self::Refused { reason: format!("this is a replay of a recording, no board: {what}") }
    }

    /// What moves, writes or sets cannot be asked of a replay.
    #[must_use]
    pub fn replay_moves_nothing() -> Self {
        Self::of_replay("nothing can be moved, written or set")
    }
}
