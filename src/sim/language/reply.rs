//! What comes back from a command line.

use crate::sim::board::error::CommandError;

/// The longest line that the interpreter takes, in characters.
pub const LONGEST_LINE: usize = 255;

/// What a command ends in.
pub type Outcome = Result<(), CommandError>;

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

/// Two status words as reports show them.
#[must_use]
pub fn status_text([first, second]: [u32; 2]) -> String {
    format!("{:06X}{:06X}", first & 0xFF_FFFF, second & 0xFF_FFFF)
}
