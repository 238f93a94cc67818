//! The command language of a PMAC: what a line of text does, and what comes back.
//!
//! On the board this is the interpreter of on-line commands (Software Reference, "On-line commands"), reached through
//! the serial port, the host bus and the DPRAM. A line goes through [`Interpreter::execute`] and yields a [`Reply`]: data
//! lines and at most one error. The port makes bytes of a reply: [`SerialPort`] puts the handshake of I3,
//! I4 and I6 around it; the DPRAM port puts the same into its control word.
//!
//! Board families differ in data: [`crate::sim::board::firmware::FirmwareTables`] and the family it belongs to.
//!
//! | file | idea |
//! |---|---|
//! | [`scanner`], [`words`] | blanks, numbers, keywords |
//! | [`expression`], [`axis`], [`m_definition`] | arithmetic, axis definitions, definitions of M-variables |
//! | [`interpreter`] | one line, command by command; addressing |
//! | [`reply`], [`serial`] | what comes back, and as the raw bytes of the serial port |
//! | [`control`] | control characters |

pub mod axis;
pub mod control;
pub mod expression;
pub mod interpreter;
pub mod m_definition;
pub mod reply;
pub mod scanner;
pub mod serial;
pub mod words;

pub use interpreter::Interpreter;
pub use reply::Reply;
pub use serial::SerialPort;
