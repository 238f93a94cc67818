//! What every command gets, and how it can end.

use std::io;
use std::path::PathBuf;

use crate::cli::console::output::Output;
use crate::client::{Board, ClientError, CommandError, Connection};
use crate::map::Family;
use crate::protocol::CallError;
use crate::segment::SegmentName;

/// The result of a command that was executed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Exit status 0.
    Yes,
    /// Exit status 1.
    No,
}

impl From<bool> for Verdict {
    fn from(yes: bool) -> Self {
        if yes { Self::Yes } else { Self::No }
    }
}

/// Why a command was not executed.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// The request could not be made: exit status 2.
    #[error("{0}")]
    Request(String),
    /// The board or the daemon refused: exit status 1. Printed without the program's name, in the board's own words.
    #[error("{0}")]
    Refused(String),
    /// The output could not be written.
    #[error("writing the output: {0}")]
    Output(#[from] io::Error),
}

impl Failure {
    pub fn request(error: impl std::fmt::Display) -> Self {
        Self::Request(error.to_string())
    }

    /// The same failure, with its place in front.
    pub fn at(self, place: impl std::fmt::Display) -> Self {
        match self {
            Self::Refused(text) => Self::Refused(format!("{place}: {text}")),
            Self::Request(text) => Self::Request(format!("{place}: {text}")),
            output @ Self::Output(_) => output,
        }
    }
}

impl From<ClientError> for Failure {
    fn from(error: ClientError) -> Self {
        Self::request(error)
    }
}

impl From<CommandError> for Failure {
    fn from(error: CommandError) -> Self {
        match &error {
            CommandError::Refused(
                CallError::Board { .. }
                | CallError::TimedOut { .. }
                | CallError::Unavailable { .. }
                | CallError::Busy
                | CallError::NotPermitted { .. }
                | CallError::Refused { .. }
                | CallError::OutOfRange,
            ) => Self::Refused(error.to_string()),
            _ => Self::request(error),
        }
    }
}

/// What every command gets.
pub struct Context {
    pub name: SegmentName,
    pub socket: PathBuf,
    pub output: Output,
}

impl Context {
    pub fn board(&self) -> Result<Board, Failure> {
        Ok(Board::attach(self.name.as_str())?.with_socket(&self.socket))
    }

    pub fn connection(&self) -> Result<Connection, Failure> {
        Ok(Connection::open(&self.socket)?)
    }

    /// The family: `given`, or that of the board behind `connection`.
    pub fn family(
        given: Option<&'static Family>,
        connection: &mut Connection,
    ) -> Result<&'static Family, Failure> {
        match given {
            Some(family) => Ok(family),
            None => Ok(Family::by_name(&connection.info()?.family).map_err(Failure::request)?),
        }
    }
}
