//! Messages beside the data.

use std::fmt::Display;
use std::io::{self, Write};

/// Prints `text` on stderr. If stderr is closed, the command goes on without the message.
pub fn note(text: impl Display) {
    let _ = writeln!(io::stderr(), "{text}");
}
