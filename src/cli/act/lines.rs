//! Command lines sent one after the other, through the daemon or over a serial line, and what can become of each.

use std::path::Path;
use std::time::Duration;

use serde_json::{Value, json};

use crate::cli::context::{Context, Failure};
use crate::client::{CommandError, Connection, SerialError, SerialLine};
use crate::protocol::CallError;

/// How long `SAVE` may take: it erases and writes flash.
const SAVING: Duration = Duration::from_secs(60);
/// How long a reset may take to be acknowledged, which it need not be.
const RESETTING: Duration = Duration::from_secs(3);
/// How long the board may then be away.
const AWAY: Duration = Duration::from_secs(20);

/// Why a line brought no acknowledgement.
#[derive(Debug)]
pub enum LineError {
    /// The board refused it.
    Board {
        /// The number of `ERRnnn`, when the board says it.
        code: Option<u16>,
        /// `ERR003: meaning`.
        text: String,
        /// What it had answered before.
        lines: Vec<String>,
    },
    /// No answer came, or not its end: the line may or may not have been carried out.
    Uncertain {
        /// Why.
        failure: Failure,
        /// What had come of the answer.
        lines: Vec<String>,
    },
    /// The line did not reach the board: what comes behind it cannot be sent either.
    NotSent(Failure),
}

impl LineError {
    /// Takes out what the board had answered before the error, or before it was given up.
    pub fn take_lines(&mut self) -> Vec<String> {
        match self {
            Self::Board { lines, .. } | Self::Uncertain { lines, .. } => std::mem::take(lines),
            Self::NotSent(_) => Vec::new(),
        }
    }

    /// The error as JSON: `code` is null when the board was not the one that said no.
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
            // The connection was there, so the daemon may have passed the line on.
            CommandError::Broken { .. }
            | CommandError::NoAnswer { .. }
            | CommandError::Refused(CallError::Protocol(_)) => {
                Self::Uncertain { failure: error.into(), lines: Vec::new() }
            }
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

/// A way to the board's command interpreter.
pub enum Way {
    /// Through the daemon.
    Daemon(Connection),
    /// Over a serial line.
    Serial(SerialLine),
}

impl Way {
    /// Through the daemon of `context`.
    ///
    /// # Errors
    /// [`Failure::Request`] when it cannot be reached.
    pub fn daemon(context: &Context) -> Result<Self, Failure> {
        Ok(Self::Daemon(context.connection()?))
    }

    /// Over the serial line `path`.
    ///
    /// # Errors
    /// [`Failure::Request`] when there is no board that answers.
    pub fn serial(path: &Path, baud: u32) -> Result<Self, Failure> {
        SerialLine::open(path, baud).map(Self::Serial).map_err(Failure::request)
    }

    /// Sends `line`, which may take `timeout`, or longer when it is one that takes long on every board.
    ///
    /// # Errors
    /// [`LineError`].
    pub fn send(&mut self, line: &str, timeout: Duration) -> Result<Vec<String>, LineError> {
        let kind = Kind::of(line);
        let timeout = match kind {
            Kind::Plain => timeout,
            Kind::Save => timeout.max(SAVING),
            Kind::Reset => RESETTING,
        };
        match self {
            Self::Daemon(connection) => match connection.send(line, timeout) {
                // A board that resets need not acknowledge it.
                Err(CommandError::Refused(CallError::TimedOut { .. })) if kind == Kind::Reset => {
                    Ok(Vec::new())
                }
                result => Ok(result?),
            },
            Self::Serial(serial) => match serial.send(line, timeout) {
                Err(SerialError::TimedOut | SerialError::NoBoard { .. }) if kind == Kind::Reset => {
                    Ok(Vec::new())
                }
                result => Ok(result?),
            },
        }
    }

    /// Waits until the board can be talked to again after a reset; only a serial line can tell.
    ///
    /// # Errors
    /// [`LineError`] when it does not answer.
    pub fn wait_for_board(&mut self) -> Result<(), LineError> {
        match self {
            Self::Daemon(_) => Ok(()),
            Self::Serial(serial) => Ok(serial.answers_within(AWAY)?),
        }
    }
}

/// Lines that take their own time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    Plain,
    /// `SAVE`.
    Save,
    /// `$$$`, `$$$***`.
    Reset,
}

impl Kind {
    pub fn of(line: &str) -> Self {
        let line = line.trim();
        if line.to_ascii_uppercase().contains("SAVE") {
            Self::Save
        } else if line.contains("$$$") {
            Self::Reset
        } else {
            Self::Plain
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slow_lines_are_known() {
        assert_eq!(Kind::of("save"), Kind::Save);
        assert_eq!(Kind::of(" $$$*** "), Kind::Reset);
        assert_eq!(Kind::of("I125=$C000"), Kind::Plain);
        assert_eq!(Kind::of("$"), Kind::Plain);
    }
}
