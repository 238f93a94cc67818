//! Names a board, and attaches to it.

use std::path::PathBuf;

use pmac_dpram::client::{Board, ClientError, CommandError, Connection};
use pmac_dpram::segment::SegmentName;

/// A board by its name, by its daemon's socket, or both.
#[derive(Debug, Clone)]
pub enum Place {
    /// The segment's name; the socket, if given, must be that board's.
    Named(SegmentName, Option<PathBuf>),
    /// The daemon at this socket tells its segment.
    At(PathBuf),
}

impl Place {
    /// The board's label before the program has attached.
    #[must_use]
    pub fn label(&self) -> String {
        match self {
            Self::Named(name, _) => name.as_str().to_owned(),
            Self::At(socket) => socket.display().to_string(),
        }
    }

    /// Attaches to the board's segment.
    ///
    /// # Errors
    /// [`ClientError`]: the segment does not exist, or the daemon at the socket does not answer.
    pub fn attach(&self) -> Result<Board, ClientError> {
        match self {
            Self::Named(name, None) => Board::attach(name.as_str()),
            Self::Named(name, Some(socket)) => Ok(Board::attach(name.as_str())?.with_socket(socket)),
            Self::At(socket) => Board::at_socket(socket),
        }
    }

    /// Refuses a socket whose daemon has another board than the named one. Accepts an absent daemon: it may come
    /// later.
    ///
    /// # Errors
    /// [`CommandError::OtherBoard`].
    pub fn look(&self) -> Result<(), CommandError> {
        let Self::Named(name, Some(socket)) = self else { return Ok(()) };
        match Connection::open(socket).and_then(|connection| connection.of_board(name)) {
            Err(error @ CommandError::OtherBoard { .. }) => Err(error),
            _ => Ok(()),
        }
    }
}
