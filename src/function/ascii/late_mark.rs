//! `<ACK>` behind a control character's reply that a silence has ended.
//!
//! "The last transmission should be an `<ACK>`" (DPRAM manual p. 29) may be meant of such a reply, too. That `<ACK>` must not end the
//! next command's reply: that command would be told done whatever becomes of it, and each reply given to the command after.
//!
//! So the next line waits for the `<ACK>`: the first time for [`FIRST`], to learn what the board does. A board that sends one
//! is waited for up to [`EXPECTED`], one that does not for a short silence. No `<ACK>` follows an error ([`super::error`]).

use std::time::{Duration, Instant};

use super::hold::Hold;
use super::{DOUBT, DpramPort, EXPECTED, State};

/// How long the first `<ACK>` is waited for.
pub(super) const FIRST: Duration = Duration::from_millis(300);

/// Whether an `<ACK>` follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum Follows {
    #[default]
    Unknown,
    Yes,
    No,
}

/// What the board has been seen to do behind a control character's reply.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct LateMarks {
    follows: Follows,
    /// Such a reply has ended last, and its `<ACK>` has not come.
    is_owed: bool,
}

impl LateMarks {
    /// An `<ACK>` came that is no end of a reply.
    pub(super) fn came(&mut self) {
        if std::mem::take(&mut self.is_owed) {
            self.follows = Follows::Yes;
        }
    }
}

impl DpramPort {
    /// Whether the next line waits only for an `<ACK>` that may follow the last reply.
    #[must_use]
    pub const fn awaits_mark(&self) -> bool {
        matches!(self.state, State::Held(hold) if hold.is_for_mark())
    }

    /// Has the next line wait for the `<ACK>`.
    pub(super) fn await_mark(&mut self, now: Instant) {
        let patience = match self.late_marks.follows {
            Follows::Unknown => FIRST,
            Follows::Yes => EXPECTED,
            Follows::No => Duration::ZERO,
        };
        self.late_marks.is_owed = true;
        self.state = State::Held(Hold::mark(now, now + patience));
    }

    /// An `<ACK>` came while the port was held.
    pub(super) fn mark_came(&mut self, now: Instant) {
        if self.awaits_mark() {
            self.late_marks.came();
            self.rest(now);
        }
    }

    /// None came in time. One that came so far may have been cancelled.
    pub(super) fn no_mark_came(&mut self, now: Instant) {
        let follows = &mut self.late_marks.follows;
        if *follows != Follows::No {
            // Should it come later still, it may find a line that the board has not taken.
            self.doubt_until = self.doubt_until.max(now + DOUBT);
        }
        *follows = if *follows == Follows::Yes { Follows::Unknown } else { Follows::No };
        // It was silent long enough for whatever else the next line waits for.
        self.settles = false;
        self.rest(now);
    }
}
