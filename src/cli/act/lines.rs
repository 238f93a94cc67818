//! The outcome of a command line that went through the daemon or over a serial line.

use serde_json::{Value, json};

use crate::cli::context::Failure;
use crate::client::{CommandError, SerialError};
use crate::language::password::without_password;
use crate::language::{Meaning, WhileOpen};
use crate::protocol::board::{LineFailure, LineOutcome};
use crate::protocol::{CallError, OpenBufferInfo};

/// Why the board did not acknowledge a line.
#[derive(Debug)]
pub enum LineError {
    /// The board refused the line.
    Board {
        /// The number of `ERRnnn`, if the board gave one.
        code: Option<u16>,
        /// `ERR003: meaning`.
        text: String,
        /// The reply lines before the error.
        lines: Vec<String>,
    },
    /// The reply is missing or incomplete. The board may or may not have executed the line.
    Uncertain {
        /// Why.
        failure: Failure,
        /// The reply lines that arrived.
        lines: Vec<String>,
    },
    /// The line did not reach the board, and the lines after it cannot either.
    NotSent(Failure),
}

impl LineError {
    /// The daemon's report of a failed line in a sequence, with the board's reply before the failure.
    pub fn of(failure: &LineFailure, lines: &[String]) -> Self {
        let lines = lines.to_vec();
        let text = failure.message.clone();
        match failure.outcome {
            LineOutcome::Refused => Self::Board { code: failure.code, text, lines },
            LineOutcome::Uncertain | LineOutcome::Reset => {
                Self::Uncertain { failure: Failure::Refused(text), lines }
            }
            LineOutcome::NotSent => Self::NotSent(Failure::Refused(text)),
        }
    }

    /// Takes out the reply lines that arrived before the error or the time-out.
    pub fn take_lines(&mut self) -> Vec<String> {
        match self {
            Self::Board { lines, .. } | Self::Uncertain { lines, .. } => std::mem::take(lines),
            Self::NotSent(_) => Vec::new(),
        }
    }

    /// The error as JSON. `code` is null unless the board itself refused the line.
    pub fn document(&self) -> Value {
        match self {
            Self::Board { code, text, .. } => json!({ "code": code, "message": text }),
            Self::Uncertain { failure, .. } | Self::NotSent(failure) => {
                json!({ "code": null, "message": failure.to_string() })
            }
        }
    }
}

impl std::fmt::Display for LineError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Board { text, .. } => f.write_str(text),
            Self::Uncertain { failure, .. } | Self::NotSent(failure) => failure.fmt(f),
        }
    }
}

impl From<LineError> for Failure {
    fn from(error: LineError) -> Self {
        match error {
            LineError::Board { text, .. } => Self::Refused(text),
            LineError::Uncertain { failure, .. } | LineError::NotSent(failure) => failure,
        }
    }
}

impl From<CommandError> for LineError {
    fn from(error: CommandError) -> Self {
        let text = error.to_string();
        match error {
            CommandError::Refused(CallError::Board { code, lines, .. }) => {
                Self::Board { code: Some(code), text, lines }
            }
            CommandError::Refused(CallError::TimedOut { lines }) => {
                Self::Uncertain { failure: Failure::Refused(text), lines }
            }
            CommandError::Refused(CallError::Interrupted { .. }) => {
                Self::Uncertain { failure: Failure::Refused(text), lines: Vec::new() }
            }
            error if error.is_uncertain() => Self::Uncertain { failure: error.into(), lines: Vec::new() },
            other => Self::NotSent(other.into()),
        }
    }
}

impl From<SerialError> for LineError {
    fn from(error: SerialError) -> Self {
        let text = error.to_string();
        match error {
            SerialError::Board { code, lines } => Self::Board { code, text, lines },
            SerialError::TimedOut => Self::Uncertain { failure: Failure::Refused(text), lines: Vec::new() },
            // The line was open, so the board may have got characters.
            SerialError::Port { .. } | SerialError::NoBoard { .. } => {
                Self::Uncertain { failure: Failure::Request(text), lines: Vec::new() }
            }
            _ => Self::NotSent(Failure::Request(text)),
        }
    }
}

/// The note to a user whose `line` met `open`, another client's open buffer: the buffer took the line's statements. No
/// manual says whether it takes some on-line commands, too.
pub fn entered_note(line: &str, open: &OpenBufferInfo) -> String {
    let WhileOpen { enters, acts, may_act, .. } = Meaning::of(line).while_open;
    let shown = without_password(line);
    let went = format!("the program statements of {shown} went into it and were not carried out");
    let became = match (enters, acts, may_act) {
        (true, false, false) => format!("{went}; CLOSE closes it"),
        (true, true, false) => {
            format!("{went}; its on-line commands were carried out at once; CLOSE closes it")
        }
        (true, _, true) => {
            format!("{went}; its on-line commands MAY have been carried out at once; LIST shows what went in")
        }
        (false, ..) => format!(
            "{shown} is no program statement, and MAY have been carried out at once; LIST shows whether it went in"
        ),
    };
    format!("note: {open}, is open: {became}")
}
