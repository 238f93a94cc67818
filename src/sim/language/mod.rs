//! The command language of a PMAC: what a line of text does, and what comes back.
//!
//! On the board this is the interpreter of on-line commands (Software Reference, "On-line commands"), reached through
//! the serial port, the host bus and the DPRAM. A line goes through [`Interpreter::execute`] and yields a [`Reply`]: data
//! lines and at most one error. How a reply becomes bytes is the port's affair: [`SerialPort`] puts the handshake of I3,
//! I4 and I6 around it; the DPRAM port puts the same into its control word.
//!
//! Board families differ in data ([`Family`]): variable tables, counts, keyword tables, where variables live.
//!
//! | file | idea |
//! |---|---|
//! | [`family`], [`i_rows`] | what differs between board families; the I-variable tables |
//! | [`scanner`], [`words`] | blanks, numbers, keywords |
//! | [`number`] | numbers as PMAC prints them |
//! | [`expression`] | arithmetic |
//! | [`variables`], [`m_definition`], [`axis`], [`password`] | the state commands read and write |
//! | [`interpreter`] | one line, command by command; addressing |
//! | `motor`, `coordinate`, `assign`, `memory`, `system`, `control` | the commands, by what they act on |
//! | [`buffers`], `list`, `entry` | commands on program buffers; listings; lines that go into an open buffer |
//! | [`serial`] | the raw byte stream of the serial port |

mod assign;
pub mod axis;
pub mod buffers;
mod control;
mod coordinate;
mod entry;
pub mod expression;
pub mod family;
pub mod i_rows;
pub mod interpreter;
mod list;
pub mod m_definition;
mod memory;
mod motor;
pub mod number;
pub mod password;
pub mod scanner;
pub mod serial;
mod system;
pub mod variables;
pub mod words;

pub use axis::{AxisDefinition, AxisDefinitions};
pub(super) use control::takes_line;
pub(super) use coordinate::check_start;
pub use family::Family;
pub use interpreter::Interpreter;
pub use serial::SerialPort;
pub use variables::Variables;

use super::board::{Board, Jog, Memory};

/// The number of an error report: 3 is printed as `ERR003` (Software Reference, I6).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, thiserror::Error)]
#[error("ERR{0:03}")]
pub struct CommandError(pub u16);

impl CommandError {
    /// ERR001: not allowed while a motion program runs.
    pub const RUNNING: Self = Self(1);
    /// ERR002: the password is missing or wrong.
    pub const PASSWORD: Self = Self(2);
    /// ERR003: a command or number that is not understood.
    pub const SYNTAX: Self = Self(3);
    /// ERR004: a character above 127.
    pub const CHARACTER: Self = Self(4);
    /// ERR005: a program command with no buffer open to take it.
    pub const NO_OPEN_BUFFER: Self = Self(5);
    /// ERR006: no room in the buffer.
    pub const NO_ROOM: Self = Self(6);
    /// ERR007: a buffer is open already.
    pub const BUFFER_IN_USE: Self = Self(7);
    /// ERR009: the end of a block without its begin.
    pub const STRUCTURE: Self = Self(9);
    /// ERR010: both overtravel limits of a motor are set.
    pub const BOTH_LIMITS: Self = Self(10);
    /// ERR011: the previous move is still in progress.
    pub const MOVE_IN_PROGRESS: Self = Self(11);
    /// ERR012: a motor of the coordinate system is open-loop.
    pub const OPEN_LOOP: Self = Self(12);
    /// ERR013: a motor of the coordinate system is not activated.
    pub const NOT_ACTIVATED: Self = Self(13);
    /// ERR014: there is no motor in the coordinate system.
    pub const NO_MOTOR: Self = Self(14);
    /// ERR015: the coordinate system does not point to a program.
    pub const NO_PROGRAM: Self = Self(15);
    /// ERR016: the program has blocks that do not end.
    pub const BAD_STRUCTURE: Self = Self(16);
    /// ERR017: motors are not where the program stopped.
    pub const NOT_AT_STOP: Self = Self(17);
}

/// What a command line answers: its data lines, without handshake characters, then perhaps an error.
///
/// Data produced before the error comes first; a line reports one error only.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Reply {
    /// Lines of data, in order.
    pub lines: Vec<String>,
    /// The error that ended the line, if one did.
    pub error: Option<CommandError>,
}

/// The result of one command of a line.
type Outcome = Result<(), CommandError>;

#[cfg(test)]
pub(crate) mod testing {
    use super::{Board, family};

    /// A board at factory defaults.
    pub(crate) fn board() -> Board {
        Board::alone(&family::PMAC).unwrap()
    }
}
