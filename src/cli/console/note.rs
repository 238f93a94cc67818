//! What is said beside the data.

use std::fmt::Display;
use std::io::{self, Write};

/// Says `text` on stderr. If that is closed, nobody hears it, and the command goes on.
pub fn note(text: impl Display) {
    let _ = writeln!(io::stderr(), "{text}");
}
