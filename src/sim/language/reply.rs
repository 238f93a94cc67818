//! The reply to a command line.

use crate::sim::board::error::CommandError;

/// The longest command line, in characters.
pub const LONGEST_LINE: usize = 255;

/// The result of a command.
pub type Outcome = Result<(), CommandError>;

/// The reply to a command line: its data lines, without handshake characters, then an optional error.
///
/// Data produced before the error comes first; a line reports at most one error.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Reply {
    /// Lines of data, in order.
    pub lines: Vec<String>,
    /// The error that ended the line, if any.
    pub error: Option<CommandError>,
}

/// Status words in the form of reports: six digits each.
#[must_use]
pub fn status_text(words: &[u32]) -> String {
    words.iter().map(|word| format!("{:06X}", word & 0xFF_FFFF)).collect()
}
