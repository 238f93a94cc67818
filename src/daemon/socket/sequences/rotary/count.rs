//! Compares what the board counts in its own rotary buffer with what it took out of the DPRAM.
//!
//! `PR` counts the program lines between the one that is executed and the last one (Software Reference, `PR`; Turbo Software
//! Reference p. 286). As long as nothing is executed that is all that was taken. A board that counted otherwise would have `R`
//! refused; then stream without `--run`, look, and send `R`. A board that reads the headers
//! at another stride, or counts coordinate systems from another number, puts the lines into another buffer, and without this
//! nothing would tell: `R` would run a program that is not there, and the lines would run where nobody looks.

use crate::function::rotary::RotaryState;
use crate::protocol::{CallError, answer};

/// What was put into the board's own rotary buffer.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Count {
    /// Lines that were there before the stream and stay.
    pub(super) kept: u64,
    /// Lines that the board had taken when it was asked last.
    taken: u64,
    /// What `PR` said then.
    pub(super) told: Option<u64>,
}

impl Count {
    /// Takes how far the board is.
    pub(super) fn see(&mut self, state: RotaryState) {
        self.taken = state.sent_lines.saturating_sub(state.ahead_lines);
    }

    /// Whether the board has taken any line.
    pub(super) fn has_lines(&self) -> bool {
        self.taken > 0
    }

    /// Why the buffer cannot be the one that was fed, where nothing of it has been executed. `before` is the count of before
    /// the board was asked: it takes lines meanwhile.
    pub(super) fn doubt(&self, before: Self, cs: u8) -> Option<String> {
        let told = self.told?;
        let (least, most) = (self.kept + before.taken, self.kept + self.taken);
        (!(least..=most).contains(&told)).then(|| self.text(told, most, cs))
    }

    /// The same where lines may have been executed: only too many are a sign.
    pub(super) fn surplus(&self, cs: u8) -> Option<String> {
        let (told, most) = (self.told?, self.kept + self.taken);
        (told > most).then(|| self.text(told, most, cs))
    }

    fn text(&self, told: u64, put_in: u64, cs: u8) -> String {
        format!(
            "the board counts {told} lines of the {put_in} that were put in (&{cs}PR): it may read the coordinate system's number \
             in the buffer's header, or the header's place, otherwise than they are written; look for the lines in other \
             coordinate systems (&nPR), and see --set coordinate_system_base and, under [readings], rotary_header"
        )
    }
}

/// The number in the reply to `PR`.
pub(in crate::daemon::socket) fn lines_left(reply: &[String]) -> Result<u64, CallError> {
    let number = reply.first().and_then(|line| answer::integer(line));
    number.and_then(|number| u64::try_from(number).ok()).ok_or_else(|| CallError::Refused {
        reason: format!("the board answers {reply:?} to PR, which should be a number of lines"),
    })
}
