//! Compares the board's count of the lines in its own rotary buffer with the lines that it took out of the DPRAM.
//!
//! `PR` counts the program lines between the line that the board executes and the last one (Software Reference, `PR`;
//! Turbo Software Reference p. 286). While the board executes nothing, that is every line that it took. A board that
//! reads the headers at another stride, or counts coordinate systems from another number, puts the lines into another
//! buffer. Without this comparison nobody would notice: `R` would run a program that is not there, and the lines would
//! run where nobody looks. If a board counts otherwise, the daemon refuses `R`; then stream without `--run`, look, and
//! send `R`.
//!
//! The board may stop in the middle of a line, when its own buffer is full or the line is wrong. No manual says whether
//! `PR` counts that line, so both counts are right.

use crate::function::rotary::RotaryState;
use crate::map::functions::rotary_header;
use crate::protocol::{CallError, answer};

/// The contents of the board's own rotary buffer.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Count {
    /// Lines that were in the buffer before the stream, and stay.
    pub(super) kept: u64,
    /// Lines that the board had taken when the daemon asked last.
    taken: u64,
    /// The board had also taken a part of the next line.
    is_inside_line: bool,
    /// The error in the header's status.
    error: Option<u8>,
    /// The board's answer to `PR` at that time.
    pub(super) told: Option<u64>,
}

impl Count {
    /// Takes the board's progress.
    pub(super) fn see(&mut self, state: RotaryState) {
        self.taken = state.sent_lines.saturating_sub(state.ahead_lines);
        (self.is_inside_line, self.error) = (state.is_inside_line, state.error);
    }

    /// Whether the board has taken any line.
    pub(super) fn has_lines(&self) -> bool {
        self.taken > 0
    }

    /// Why the buffer cannot be the buffer that the daemon fed, if the board has executed none of its lines. `before`
    /// is the count from before the question: the board takes lines meanwhile.
    pub(super) fn doubt(&self, before: Self, cs: u8) -> Option<String> {
        let told = self.told?;
        let least = self.kept + before.taken;
        (!(least..=self.most()).contains(&told)).then(|| self.text(told, cs))
    }

    /// As [`Self::doubt`], if the board may have executed lines: only too many lines are a sign then.
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
