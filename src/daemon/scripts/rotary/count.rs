//! Compares what the board counts in its own rotary buffer with what it took out of the DPRAM.
//!
//! `PR` counts the program lines between the one that is executed and the last one (Software Reference, `PR`; Turbo Software
//! Reference p. 286). As long as nothing is executed that is all that was taken. A board that counted otherwise would have `R`
//! refused; then stream without `--run`, look, and send `R`. A board that reads the headers
//! at another stride, or counts coordinate systems from another number, puts the lines into another buffer, and without this
//! nothing would tell: `R` would run a program that is not there, and the lines would run where nobody looks.
//!
//! The board may stop in the middle of a line, when its own buffer is full or the line is wrong. No text says whether `PR` counts
//! that line, so both are right.

use crate::function::rotary::RotaryState;
use crate::map::functions::rotary_header;
use crate::protocol::{CallError, answer};

/// What was put into the board's own rotary buffer.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Count {
    /// Lines that were there before the stream and stay.
    pub(super) kept: u64,
    /// Lines that the board had taken when it was asked last.
    taken: u64,
    /// It had taken a part of one more.
    is_inside_line: bool,
    /// The error in the header's status.
    error: Option<u8>,
    /// What `PR` said then.
    pub(super) told: Option<u64>,
}

impl Count {
    /// Takes how far the board is.
    pub(super) fn see(&mut self, state: RotaryState) {
        self.taken = state.sent_lines.saturating_sub(state.ahead_lines);
        (self.is_inside_line, self.error) = (state.is_inside_line, state.error);
    }

    /// Whether the board has taken any line.
    pub(super) fn has_lines(&self) -> bool {
        self.taken > 0
    }

    /// Why the buffer cannot be the one that was fed, where nothing of it has been executed. `before` is the count of before
    /// the board was asked: it takes lines meanwhile.
    pub(super) fn doubt(&self, before: Self, cs: u8) -> Option<String> {
        let told = self.told?;
        let least = self.kept + before.taken;
        (!(least..=self.most()).contains(&told)).then(|| self.text(told, cs))
    }

    /// The same where lines may have been executed: only too many are a sign.
    pub(super) fn surplus(&self, cs: u8) -> Option<String> {
        let told = self.told?;
        (told > self.most()).then(|| self.text(told, cs))
    }

    /// The most lines that the board can count.
    const fn most(&self) -> u64 {
        self.kept + self.taken + self.is_inside_line as u64
    }

    fn text(&self, told: u64, cs: u8) -> String {
        let put_in = self.kept + self.taken;
        if let Some(code) = self.error {
            let status = rotary_header::ERROR | u16::from(code);
            return format!(
                "the board reports rotary error {code} (0x{status:04X} in the buffer's header), and counts {told} lines of the {put_in} \
                 that it took (&{cs}PR): look at the line where it stopped"
            );
        }
        format!(
            "the board counts {told} lines of the {put_in} that were put in (&{cs}PR): it may read the coordinate system's number \
             in the buffer's header, or the header's place, otherwise than they are written; look for the lines in other \
             coordinate systems (&nPR), and see --set coordinate_system_base"
        )
    }
}

/// The number in the reply to `PR`.
pub fn lines_left(reply: &[String]) -> Result<u64, CallError> {
    let number = reply.first().and_then(|line| answer::integer(line));
    number.and_then(|number| u64::try_from(number).ok()).ok_or_else(|| {
        CallError::refused(format!("the board answers {reply:?} to PR, which should be a number of lines"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A board that has taken 18 of 40 lines.
    fn state(is_inside_line: bool, error: Option<u8>) -> RotaryState {
        RotaryState {
            ahead_longs: 60,
            ahead_commands: 30,
            ahead_lines: 22,
            is_inside_line,
            sent_lines: 40,
            busy: false,
            error,
            underruns: 0,
        }
    }

    #[test]
    fn a_line_that_the_board_has_begun_counts_or_not() {
        for (is_inside_line, told, is_right) in [
            (false, 18, true),
            (false, 19, false),
            (true, 18, true),
            (true, 19, true),
            (true, 20, false),
            (true, 17, false),
        ] {
            let mut count = Count::default();
            count.see(state(is_inside_line, None));
            count.told = Some(told);
            assert_eq!(count.doubt(count, 1).is_none(), is_right, "{is_inside_line} {told}");
        }
    }

    #[test]
    fn an_error_of_the_board_is_named_first() {
        let mut count = Count::default();
        count.see(state(false, Some(3)));
        count.told = Some(0);
        let doubt = count.doubt(count, 1).unwrap();
        assert!(doubt.starts_with("the board reports rotary error 3 (0x8003"), "{doubt}");
        assert!(!doubt.contains("coordinate_system_base"), "{doubt}");
    }
}
