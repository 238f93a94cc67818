//! `<ACK>` behind a reply that has ended already: an error, or a control character's reply.
//!
//! An error needs no `<ACK>` to be known as the end (DPRAM manual p. 28: from step 3 on it is about what "does not show an error"),
//! nor has a control character's reply one for sure. But "the last transmission should be an `<ACK>`" (p. 29) may be
//! meant of these, too, and on real boards one "can precede the next reply" (FACTS 13). It must not end the next
//! command's reply: that command would be told done whatever becomes of it, and each reply given to the command after.
//!
//! So the next line waits for the `<ACK>`: the first time for [`FIRST`], to learn what the board does. A board that sends one
//! is waited for up to [`EXPECTED`], one that does not for a short silence.

use std::time::{Duration, Instant};

use super::hold::{After, Hold};
use super::{AsciiEvent, DOUBT, DpramPort, State};
use crate::map::functions::response;

/// How long the first `<ACK>` is waited for.
pub(super) const FIRST: Duration = Duration::from_millis(300);
/// How long one is waited for that has come every time so far.
pub(super) const EXPECTED: Duration = Duration::from_secs(1);

/// Whether an `<ACK>` follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum Follows {
    #[default]
    Unknown,
    Yes,
    No,
}

/// What the board has been seen to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct LateMarks {
    after_error: Follows,
    after_control_reply: Follows,
    /// What has ended last, as long as its `<ACK>` has not come.
    last: Option<After>,
}

impl LateMarks {
    const fn of(&mut self, after: After) -> &mut Follows {
        match after {
            After::Error => &mut self.after_error,
            After::ControlReply => &mut self.after_control_reply,
        }
    }

    /// An `<ACK>` came that is no end of a reply.
    pub(super) fn came(&mut self) {
        if let Some(after) = self.last.take() {
            *self.of(after) = Follows::Yes;
        }
    }
}

impl DpramPort {
    /// Whether the next line waits only for an `<ACK>` that may follow the last reply.
    #[must_use]
    pub const fn awaits_mark(&self) -> bool {
        matches!(self.state, State::Held(hold) if hold.is_for_mark())
    }

    /// An error came. With I6=1 the firmware reports errors of a program's `CMD` in the same way (Software Reference, I6), so a line's
    /// error is told when nothing but an `<ACK>` has followed.
    pub(super) fn end_with_error(&mut self, number: u16, now: Instant) -> AsciiEvent {
        match self.state {
            _ if self.open_ended => self.end_reply(now),
            State::ControlReply { .. } => self.await_mark(After::ControlReply, now),
            // Without its second part the line is not carried out, whosever the error is.
            State::Loaded { sent } if sent < self.length => self.abandon(now, true),
            _ => {
                self.await_mark(After::Error, now);
                self.error = Some(number);
                return AsciiEvent::Error(number);
            }
        }
        AsciiEvent::Done(Err(number))
    }

    /// What a response says of the error before it.
    pub(super) fn answer_behind_error(&mut self, control: u16, now: Instant) -> Option<AsciiEvent> {
        let is_mark = control == response::ACKNOWLEDGE && self.late_marks.after_error != Follows::No;
        let is_answer = control == response::ACKNOWLEDGE || control == response::LINE;
        let number = self.error.take_if(|_| is_answer)?;
        if is_mark {
            self.mark_came(now);
            return Some(AsciiEvent::Done(Err(number)));
        }
        // Should it be the `<ACK>` of the error after all, the next one is waited for.
        self.late_marks.after_error = Follows::Unknown;
        self.abandon(now, false);
        Some(AsciiEvent::Doubtful(number))
    }

    /// The error that nothing has followed.
    pub(super) fn error_alone(&mut self) -> Option<AsciiEvent> {
        let is_over = !self.awaits_mark();
        self.error.take_if(|_| is_over).map(|number| AsciiEvent::Done(Err(number)))
    }

    /// Has the next line wait for the `<ACK>`.
    pub(super) fn await_mark(&mut self, after: After, now: Instant) {
        let patience = match self.late_marks.of(after) {
            Follows::Unknown => FIRST,
            Follows::Yes => EXPECTED,
            Follows::No => Duration::ZERO,
        };
        let patience = if after == After::Error { patience.max(self.answer_patience()) } else { patience };
        self.late_marks.last = Some(after);
        self.state = State::Held(Hold::mark(now, after, now + patience));
    }

    /// What comes later than the board's answers do is no answer, nor one more line of a reply.
    pub(super) fn answer_patience(&self) -> Duration {
        (2 * self.answer_time).min(EXPECTED)
    }

    /// An `<ACK>` came while the port was held.
    pub(super) fn mark_came(&mut self, now: Instant) {
        if self.awaits_mark() {
            self.late_marks.came();
            self.rest(now);
        }
    }

    /// None came in time. One that came so far may have been cancelled.
    pub(super) fn no_mark_came(&mut self, after: After, now: Instant) {
        let follows = self.late_marks.of(after);
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
