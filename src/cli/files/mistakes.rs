//! Prints the mistakes in files before pmacctl sends a line.

use crate::cli::console::note;
use crate::cli::context::Failure;
use crate::preprocess::Mistake;

/// The most mistakes to print.
const MISTAKES_MAX: usize = 50;

/// Prints each mistake as `FILE:LINE: message` on stderr. With any mistake, the command sends no line.
pub fn mistaken(mistakes: &[Mistake]) -> Failure {
    for mistake in mistakes.iter().take(MISTAKES_MAX) {
        note(mistake);
    }
    let count = mistakes.len();
    Failure::Request(format!("{count} mistake{}; nothing was sent", if count == 1 { "" } else { "s" }))
}
