//! Text from a board or a client, shown to people: its control characters are seen and do nothing.

use std::fmt::{self, Display, Write};

/// Shows the control characters of what it holds as `\x1b`. ESC, CSI, CR and BS could otherwise rewrite what a terminal
/// shows, and a line end could look like a line of the log.
#[derive(Debug, Clone, Copy)]
pub struct Visible<T>(pub T);

impl<T: Display> Display for Visible<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(Escaping(f), "{}", self.0)
    }
}

/// A control character, or one that is not seen and makes what stands beside it look otherwise, as U+202E turns it round.
#[must_use]
pub fn is_hidden(letter: char) -> bool {
    letter.is_control()
        || matches!(letter, '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{2069}' | '\u{feff}')
}

struct Escaping<'a, 'b>(&'a mut fmt::Formatter<'b>);

impl Write for Escaping<'_, '_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for part in text.split_inclusive(is_hidden) {
            let end = part.char_indices().next_back();
            match end.filter(|(_, last)| is_hidden(*last)) {
                Some((start, last)) => write!(self.0, "{}\\x{:02x}", &part[..start], u32::from(last))?,
                None => self.0.write_str(part)?,
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_seen() {
        let text = "a\u{1b}[2J\u{9b}K\r\u{8}\n\u{7f}b\u{e9}";
        assert_eq!(Visible(text).to_string(), "a\\x1b[2J\\x9bK\\x0d\\x08\\x0a\\x7fb\u{e9}");
        assert_eq!(Visible("a\u{202e}b\u{2028}").to_string(), "a\\x202eb\\x2028");
        assert_eq!(Visible("").to_string(), "");
    }
}
