//! The lines of the board's reply, as C reads them.

use std::ffi::CString;

/// Lines of text.
#[derive(Default)]
pub struct Reply {
    lines: Vec<CString>,
    /// All lines, a newline between two.
    text: CString,
}

impl Reply {
    /// `lines`; a NUL in them becomes a space.
    pub fn new(lines: &[String]) -> Self {
        let text = |text: &str| CString::new(text.replace('\0', " ")).unwrap_or_default();
        Self { lines: lines.iter().map(|line| text(line)).collect(), text: text(&lines.join("\n")) }
    }

    /// How many lines.
    pub fn count(&self) -> usize {
        self.lines.len()
    }

    /// Line `index`, from 0.
    pub fn line(&self, index: usize) -> Option<&CString> {
        self.lines.get(index)
    }

    /// All lines, a newline between two.
    pub const fn text(&self) -> &CString {
        &self.text
    }
}
