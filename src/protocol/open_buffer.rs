//! Whether the board takes command lines as program lines: as the lines themselves tell, and its reports where they come.
//!
//! After `OPEN PROG`, `OPEN ROT` or `OPEN PLC` a line such as `I57` or `P1` is no question any more but a piece of the
//! program (Software Reference, I, J and K as circle vectors): a question asked by the way would move a machine.

/// Follows the lines that a board is sent. Takes no memory.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct OpenBuffer {
    /// The lines so far opened one.
    open: bool,
    /// The board's status says that one is open, whoever opened it.
    seen: bool,
    /// Reports that may still be from before a CLOSE.
    old_reports: u8,
}

/// Servo reports after a CLOSE that are not believed when they say open: the board has to take the line first.
const OLD_REPORTS: u8 = 50;

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
        self.open || self.seen
    }

    /// Takes note of what a report of the board says.
    pub const fn see(&mut self, open: bool) {
        self.old_reports = if open { self.old_reports.saturating_sub(1) } else { 0 };
        self.seen = open && self.old_reports == 0;
    }

    const fn close(&mut self) {
        *self = Self { open: false, seen: false, old_reports: OLD_REPORTS };
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
                    self.close();
                }
            }
            // No buffer is open after a reset.
            if part.windows(3).any(|three| three == b"$$$") {
                self.close();
            }
        }
    }

    /// Takes note of a control character.
    pub fn follow_control(&mut self, character: u8) {
        match character {
            OPEN_ROTARY => self.open = true,
            CLOSE_ROTARY => self.close(),
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_somebody_else_opened_is_seen_and_our_own_close_believed() {
        let mut buffer = OpenBuffer::default();
        buffer.see(true);
        assert!(buffer.is_open());
        buffer.see(false);
        assert!(!buffer.is_open());
        buffer.see(true);
        buffer.follow(b"CLOSE");
        assert!(!buffer.is_open());
        buffer.see(true);
        assert!(!buffer.is_open(), "a report from before");
        buffer.see(false);
        buffer.see(true);
        assert!(buffer.is_open(), "opened anew");
        buffer.follow(b"CLOSE");
        (0..OLD_REPORTS).for_each(|_| buffer.see(true));
        assert!(buffer.is_open(), "not closed after all");
    }

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
