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
