//! The language of command lines (layer 1): the daemon reads a line's meaning once.
//!
//! The daemon reads a line where it comes in. The [`Line`] carries its [`Meaning`] to the log and to the bus thread,
//! which do not read the text again. The gateway and `pmacctl` read their own lines by the same [`Meaning`].
//!
//! | file | holds |
//! |---|---|
//! | `reader` | the characters: blanks, words, numbers |
//! | [`number`] | numbers of variables, and expressions of constants |
//! | `words` | the words |
//! | [`command`] | what a command is |
//! | [`lexer`] | the commands of a line, one [`command::Token`] each |
//! | [`meaning`] | what the commands of a line come to |
//! | [`settings`] | which I-variables a line sets |
//! | [`while_open`] | what becomes of a command while a program buffer is open |
//! | [`deadlines`] | how long the board may take |
//! | [`password`] | the line as others may see it |
//!
//! Only [`password`] allocates memory. For an unknown command this module assumes the more harmful of the likely
//! readings: a line that may stop, start or close something counts as doing so.

pub mod command;
pub mod deadlines;
pub mod lexer;
pub mod meaning;
pub mod number;
pub mod password;
mod reader;
pub mod settings;
pub mod while_open;
mod words;

use std::ops::Deref;

pub use self::command::{Effect, NAME_MAX, is_rotary};
pub use self::meaning::{Jogs, LineEnds, Meaning};
pub use self::while_open::WhileOpen;
use crate::format::Text;

/// The longest line that a board of any family takes, in characters (DPRAM manual p. 27).
pub const LINE_MAX: usize = 200;

/// A command line and its meaning.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Line {
    text: Text<LINE_MAX>,
    /// The line's meaning.
    pub meaning: Meaning,
}

impl Line {
    /// Reads `line`, cut to the length that a board takes.
    #[must_use]
    pub fn of(line: impl AsRef<[u8]>) -> Self {
        let text = Text::from_bytes(line.as_ref());
        Self { text, meaning: Meaning::of(text.as_bytes()) }
    }
}

impl Deref for Line {
    type Target = str;

    fn deref(&self) -> &str {
        &self.text
    }
}

#[cfg(test)]
mod tests;
