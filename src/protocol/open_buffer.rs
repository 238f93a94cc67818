//! Whether the board takes command lines as program lines, as far as the lines themselves tell.
//!
//! After `OPEN PROG`, `OPEN ROT` or `OPEN PLC` a line such as `I57` or `P1` is no question any more but a piece of the
//! program (Software Reference, I, J and K as circle vectors): a question asked by the way would move a machine.

/// Follows the lines that a board is sent. Takes no memory.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct OpenBuffer {
    open: bool,
}

/// ^L, which closes the rotary buffers as `CLOSE` does.
const CLOSE_ROTARY: u8 = 12;
/// ^U, which opens them as `OPEN ROT` does.
const OPEN_ROTARY: u8 = 21;
const OPENS: [&str; 8] =
    ["OPEN", "OPENPROG", "OPENPLC", "OPENPLCC", "OPENROT", "OPENROTARY", "OPENFORWARD", "OPENINVERSE"];
const CLOSES: [&str; 2] = ["CLOSE", "CLS"];

impl OpenBuffer {
    /// Whether a buffer is open.
    #[must_use]
    pub const fn is_open(self) -> bool {
        self.open
    }

    /// Takes note of a command line. Counted as open even if the board refuses the line: an error may follow what
    /// opened it.
    pub fn follow(&mut self, line: &[u8]) {
        // What stands in quotes is text that a program sends.
        for part in line.split(|byte| *byte == b'"').step_by(2) {
            for word in part.split(|byte| !byte.is_ascii_alphabetic()) {
                let is = |name: &&str| word.eq_ignore_ascii_case(name.as_bytes());
                if OPENS.iter().any(is) {
                    self.open = true;
                } else if CLOSES.iter().any(is) {
                    self.open = false;
                }
            }
            // No buffer is open after a reset.
            self.open &= !part.windows(3).any(|three| three == b"$$$");
        }
    }

    /// Takes note of a control character.
    pub fn follow_control(&mut self, character: u8) {
        match character {
            OPEN_ROTARY => self.open = true,
            CLOSE_ROTARY => self.open = false,
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn open_buffers_are_followed() {
        let mut buffer = OpenBuffer::default();
        for (line, open) in [
            ("CLOSE", false),
            ("SEND\"OPEN PROG 1\"", false),
            ("OPEN PROG 1", true),
            ("X10 Y20", true),
            ("CMD\"CLOSE\"", true),
            ("close", false),
            ("&1open rot", true),
            ("$$$", false),
            ("CLOSE OPEN PLC 3 CLEAR", true),
        ] {
            buffer.follow(line.as_bytes());
            assert_eq!(buffer.is_open(), open, "{line}");
        }
        buffer.follow_control(12);
        assert!(!buffer.is_open());
        buffer.follow_control(21);
        buffer.follow_control(1);
        assert!(buffer.is_open());
    }
}
