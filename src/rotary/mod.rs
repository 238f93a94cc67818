//! Motion programs for the binary rotary buffers: text to 48-bit commands and back (layer 1).
//!
//! PMAC copies a binary rotary buffer straight into its internal rotary program buffer, without parsing text (DPRAM
//! manual pp. 29-35). A command is two 24-bit words; the first command of a text line carries the start-of-line bit,
//! and the commands of all lines follow one another. The format has only constants: no expression, no branch, no loop.
//!
//! [`compile()`] converts text to words and rejects, with its place, whatever has no binary form; [`decompile()`]
//! converts words to text. Both go through [`Item`], the meaning of one command, and both read the one table
//! [`codes::CODES`], as does [`same_line`], which recognises the typed program in a board's listing. Each point that
//! the manual leaves open is a named field of [`Settings`]. This module accesses no board.

pub mod codes;
pub mod compile;
pub mod constant;
pub mod decompile;
pub mod float;
pub mod item;
mod parse;
pub mod program;
pub mod reason;
mod refused;
mod scan;
pub mod settings;
mod spelling;

#[cfg(test)]
mod tests;

pub use codes::Code;
pub use compile::{Compiled, Refused, compile, compile_stream};
pub use constant::Constant;
pub use decompile::{DecodeError, Decompiled, Note, decompile};
pub use item::{Argument, Item};
pub use program::{Command, END_MARKER, Line, Program, START_OF_LINE};
pub use reason::{Placed, Reason, Report, Warning};
pub use settings::{Settings, SettingsError};
pub use spelling::same_line;
