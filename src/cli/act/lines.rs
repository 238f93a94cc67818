//! Sends command lines one after the other, through the daemon or over a serial line, and tells how each ended.

use std::path::Path;
use std::time::Duration;

use serde_json::{Value, json};

use crate::cli::context::Failure;
use crate::client::command::SendAs;
use crate::client::{CommandError, Connection, SerialError, SerialLine};
use crate::protocol::board::{LineFailure, LineOutcome, SendReply};
use crate::protocol::line;
use crate::protocol::password::without_password;
use crate::protocol::{CallError, OpenBufferInfo, deadlines};

/// How long the board may stay silent after a reset.
const AWAY: Duration = Duration::from_secs(20);

/// Why the board did not acknowledge a line.
#[derive(Debug)]
pub enum LineError {
    /// The board refused it.
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
    /// The line did not reach the board, and neither can the lines after it.
    NotSent(Failure),
}

impl LineError {
    /// What the daemon tells of a line of a sequence, and what the board had answered before.
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
            // The line was open, so characters may have gone out.
            SerialError::Port { .. } | SerialError::NoBoard { .. } => {
                Self::Uncertain { failure: Failure::Request(text), lines: Vec::new() }
            }
            _ => Self::NotSent(Failure::Request(text)),
        }
    }
}

/// What whoever sends `line` is told that `open` took, which these lines have not opened.
pub fn entered_note(line: &str, open: &OpenBufferInfo) -> String {
    format!(
        "note: {open}, is open: the program statements of {} went into it and were not carried out; CLOSE closes it",
        without_password(line)
    )
}

/// A way to the board's command interpreter.
pub enum Way {
    /// Through the daemon.
    Daemon(Connection),
    /// Over a serial line.
    Serial(SerialLine),
}

impl Way {
    /// Over the serial line `path`.
    ///
    /// # Errors
    /// [`Failure::Request`] if no board answers.
    pub fn serial(path: &Path, baud: u32) -> Result<Self, Failure> {
        SerialLine::open(path, baud).map(Self::Serial).map_err(Failure::request)
    }

    /// Sends `line` and waits at most `timeout` for the reply; [`deadlines`] says which lines have longer limits.
    ///
    /// # Errors
    /// [`LineError`].
    pub fn send(&mut self, line: &str, timeout: Duration) -> Result<Vec<String>, LineError> {
        Ok(self.send_as(line, false, timeout)?.lines)
    }

    /// As [`Way::send`]. A line that goes `into_buffer`, the program buffer that its user has open, is not sent when that is
    /// closed. The reply of any other one tells into which buffer of his it went.
    ///
    /// # Errors
    /// [`LineError`].
    pub fn send_as(
        &mut self,
        line: &str,
        into_buffer: bool,
        timeout: Duration,
    ) -> Result<SendReply, LineError> {
        let timeout = deadlines::of_line(line, timeout);
        // The board need not acknowledge a reset.
        let resets = line::resets(line.as_bytes());
        let lines = match self {
            Self::Daemon(connection) if into_buffer => connection.send_into_buffer(line, timeout)?,
            Self::Daemon(connection) => match connection.send_and_see(line, timeout, SendAs::default()) {
                Err(CommandError::Refused(CallError::TimedOut { .. })) if resets => Vec::new(),
                result => return Ok(result?),
            },
            Self::Serial(serial) => match serial.send(line, timeout) {
                Err(SerialError::TimedOut | SerialError::NoBoard { .. }) if resets => Vec::new(),
                result => result?,
            },
        };
        Ok(SendReply { lines, entered: None })
    }

    /// Waits until the board answers again after a reset. Only a serial line shows that.
    ///
    /// # Errors
    /// [`LineError`] if the board does not answer.
    pub fn wait_for_board(&mut self) -> Result<(), LineError> {
        match self {
            Self::Daemon(_) => Ok(()),
            Self::Serial(serial) => Ok(serial.answers_within(AWAY)?),
        }
    }
}
