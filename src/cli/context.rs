//! The context that every command gets, and the possible ends of a command.

use std::io;
use std::path::{Path, PathBuf};

use crate::cli::console::Output;
use crate::client::{Board, ClientError, CommandError, Connection, Staleness};
use crate::map::Family;
use crate::protocol::board::BoardInfo;
use crate::protocol::function::{NO_FAMILY, UNKNOWN_FAMILY};
use crate::protocol::{CallError, socket_place};
use crate::segment::SegmentName;

/// The result of a command that pmacctl executed.
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

impl Verdict {
    /// `Yes`, unless there are `faults`.
    ///
    /// # Errors
    /// [`Failure::Refused`] with the faults.
    pub fn without(faults: &[String]) -> Result<Self, Failure> {
        if faults.is_empty() { Ok(Self::Yes) } else { Err(Failure::Refused(faults.join("\n"))) }
    }
}

/// Why pmacctl did not execute a command.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// pmacctl could not make the request: exit status 2.
    #[error("{0}")]
    Request(String),
    /// The board or the daemon refused: exit status 1. Printed without the program's name, in the board's own words.
    #[error("{0}")]
    Refused(String),
    /// pmacctl could not write the output.
    #[error("writing the output: {0}")]
    Output(#[from] io::Error),
}

impl Failure {
    pub fn request(error: impl std::fmt::Display) -> Self {
        Self::Request(error.to_string())
    }

    /// The same failure with its place in front, unless the text begins with the place.
    pub fn at(self, place: impl std::fmt::Display) -> Self {
        let place = place.to_string();
        let told = |text: String| if text.starts_with(&place) { text } else { format!("{place}: {text}") };
        match self {
            Self::Refused(text) => Self::Refused(told(text)),
            Self::Request(text) => Self::Request(told(text)),
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
                | CallError::Interrupted { .. }
                | CallError::Unavailable { .. }
                | CallError::Busy
                | CallError::NotPermitted { .. }
                | CallError::Refused { .. }
                | CallError::StopFailed { .. }
                | CallError::OutOfRange,
            ) => Self::Refused(error.to_string()),
            _ => Self::request(error),
        }
    }
}

/// Whether the daemon of `board` is stopped or hangs.
fn is_silent(board: &Board) -> bool {
    let segment = board.subscriber();
    let stale = Staleness::of_segment(segment.condition(), &segment.header(), segment.now_ns());
    matches!(stale, Some(Staleness::DaemonStopped { .. }))
}

/// The default name of a board.
const DEFAULT_NAME: &str = "pmac0";

/// The failure of a command that writes nothing, if the daemon does not know the board's family.
pub const GIVE_FAMILY: &str =
    "pmacd does not know the board's family; give --family pmac, pmac2, turbo or turbo2";

/// The context that every command gets.
pub struct Context {
    /// `--name`.
    name: Option<SegmentName>,
    /// `--socket`.
    socket: Option<PathBuf>,
    pub output: Output,
}

impl Context {
    pub fn new(name: Option<&str>, socket: Option<PathBuf>, output: Output) -> Result<Self, Failure> {
        let name = name.map(SegmentName::new).transpose().map_err(Failure::request)?;
        Ok(Self { name, socket, output })
    }

    /// The board's name from `--name`, if given.
    pub fn told_name(&self) -> Option<&SegmentName> {
        self.name.as_ref()
    }

    /// The daemon's socket from `--socket`, if given.
    pub fn told_socket(&self) -> Option<&Path> {
        self.socket.as_deref()
    }

    /// The board's name: from `--name`, else from the daemon at `--socket`.
    pub fn name(&self) -> Result<SegmentName, Failure> {
        match (&self.name, &self.socket) {
            (Some(name), _) => Ok(name.clone()),
            (None, None) => SegmentName::new(DEFAULT_NAME).map_err(Failure::request),
            (None, Some(socket)) => {
                SegmentName::new(&Connection::open(socket)?.info()?.segment).map_err(Failure::request)
            }
        }
    }

    /// The daemon's socket: from `--socket`, else from the board's name.
    pub fn socket(&self) -> PathBuf {
        let name = self.name.as_ref().map_or(DEFAULT_NAME, SegmentName::as_str);
        self.socket.clone().unwrap_or_else(|| socket_place::socket_path(name))
    }

    /// The board that both `--name` and `--socket` select.
    pub fn board(&self) -> Result<Board, Failure> {
        Ok(self.attach()?)
    }

    /// As [`Self::board`], for a caller to whom an absent board is an answer, too.
    pub fn attach(&self) -> Result<Board, ClientError> {
        let name = match (&self.name, &self.socket) {
            (None, Some(socket)) => return Board::at_socket(socket),
            (name, _) => name.as_ref().map_or(DEFAULT_NAME, SegmentName::as_str),
        };
        let board = Board::attach(name);
        // Do not ask a daemon that gives no sign of life: the question would only wait.
        if !board.as_ref().is_ok_and(is_silent) {
            self.agree()?;
        }
        Ok(board?.with_socket(&self.socket()))
    }

    /// A connection to the daemon of the board.
    pub fn connection(&self) -> Result<Connection, Failure> {
        Ok(self.connect()?)
    }

    fn connect(&self) -> Result<Connection, CommandError> {
        let connection = Connection::open(&self.socket())?;
        match (&self.name, &self.socket) {
            // Only the socket selects the board.
            (None, Some(_)) => Ok(connection),
            (Some(name), _) => connection.of_board(name),
            (None, None) => match self.name() {
                Ok(name) => connection.of_board(&name),
                Err(_) => Ok(connection),
            },
        }
    }

    /// Refuses a `--socket` whose daemon has another board than `--name`: the command would show data of one board and
    /// send lines to the other. Without an answering daemon the data can be shown.
    pub fn agree(&self) -> Result<(), CommandError> {
        if self.name.is_none() || self.socket.is_none() {
            return Ok(());
        }
        match self.connect() {
            Err(error @ CommandError::OtherBoard { .. }) => Err(error),
            _ => Ok(()),
        }
    }

    /// The family of the daemon's board, and the daemon's information on it; `None` without a running daemon.
    ///
    /// # Errors
    /// [`Failure`], which names `--family`, when the daemon does not know the family or does not answer.
    pub fn board_family(&self) -> Result<Option<(&'static Family, BoardInfo)>, Failure> {
        let info = match self.connect().and_then(|mut connection| connection.info()) {
            Ok(info) => info,
            Err(CommandError::Connect { source, .. })
                if matches!(source.kind(), io::ErrorKind::NotFound | io::ErrorKind::ConnectionRefused) =>
            {
                return Ok(None);
            }
            Err(error) => return Err(Failure::Request(format!("{error}; or give --family"))),
        };
        match info.known_family() {
            Ok(family) => Ok(Some((family, info))),
            Err(_) if info.family == NO_FAMILY => Err(Failure::request(GIVE_FAMILY)),
            Err(error) => Err(Failure::request(error)),
        }
    }

    /// The family: `given`, or that of the board behind `connection`. Refuses a family whose DPRAM words have other
    /// places than the board's.
    pub fn family(
        given: Option<&'static Family>,
        connection: &mut Connection,
    ) -> Result<&'static Family, Failure> {
        let info = connection.info()?;
        match (given, info.known_family()) {
            (Some(family), Ok(board)) if family.base != board.base => Err(Failure::Request(format!(
                "--family {}: the board is a {}, whose DPRAM is laid out otherwise",
                family.name, board.title
            ))),
            (Some(family), _) => Ok(info.sized(family)),
            (None, Ok(board)) => Ok(board),
            (None, Err(_)) if info.family == NO_FAMILY => Err(Failure::request(UNKNOWN_FAMILY)),
            (None, Err(error)) => Err(Failure::request(error)),
        }
    }
}

/// Refuses numbers of motors or coordinate systems that `family` does not have, before the command sends a line to the
/// board.
pub fn check_numbers(family: &Family, for_motors: bool, numbers: &[u8]) -> Result<(), Failure> {
    let (what, count) = match for_motors {
        true => ("motor", family.motors),
        false => ("coordinate system", family.coordinate_systems),
    };
    match numbers.iter().find(|number| usize::from(**number) > count) {
        Some(number) => Err(Failure::Request(format!("there is no {what} {number}; write 1 to {count}"))),
        None => Ok(()),
    }
}
