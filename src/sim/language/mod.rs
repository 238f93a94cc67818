//! The command language of a PMAC: the effect of a line of text, and the board's answer.
//!
//! On the board this is the interpreter of on-line commands (Software Reference, "On-line commands"), for the serial
//! port, the host bus and the DPRAM. [`Interpreter::execute`] executes a line and returns a [`Reply`]: data lines and
//! at most one error. The port encodes the reply: [`SerialPort`] adds the handshake of I3, I4 and I6; the DPRAM port
//! writes that handshake into its control word.
//!
//! Board families differ only in data: [`crate::sim::board::firmware::FirmwareTables`] and its family.
//!
//! | file | idea |
//! |---|---|
//! | [`scanner`], [`words`] | blanks, numbers, keywords |
//! | [`expression`], [`axis`], [`m_definition`], [`station`], [`lock`] | arithmetic, axis definitions, definitions of M-variables, variables of MACRO stations, locking bits |
//! | [`interpreter`], [`ports`] | one line, command by command; the motor and system that each port addresses |
//! | [`reply`], [`serial`] | the reply, and its raw bytes on the serial port |
//! | [`control`] | control characters |

pub mod axis;
pub mod control;
pub mod expression;
pub mod interpreter;
pub mod lock;
pub mod m_definition;
pub mod ports;
pub mod reply;
pub mod scanner;
pub mod serial;
pub mod station;
pub mod words;

pub use interpreter::Interpreter;
pub use ports::Ports;
pub use reply::Reply;
pub use serial::SerialPort;
