//! After a command that was given up: nobody else's line is begun before the board has answered one of our own.
//!
//! When the port is idle again the board has shown that it looks at its words and is at no line ([`hold`]). Where it does so
//! beside a line, the line's reply is still to come, and would be taken for the next one's. PMAC answers lines in
//! their order. So a line goes first whose reply can be known from every other's; what comes before that reply is late and dropped.
//! It is `I3 I10 I3`: twice the handshake, 0 to 3, and between them the servo period, a large number. I3 says besides
//! whether replies have an end mark at all (FACTS 7, handshake). While a program buffer is open the line would be a piece of the
//! program: it is left out then.
//!
//! [`hold`]: crate::function::ascii::hold

use std::time::{Duration, Instant};

use log::{info, warn};

use super::{AsciiQueue, InFlight, UnderWay};
use crate::daemon::bus::ports::command_port::PortError;
use crate::daemon::shared::queue::{Origin, REASON_MAX, Text};
use crate::device::Bus;
use crate::map::readings::ReplyEnd;
use crate::protocol::{CommandState, answer};
use crate::segment::Publisher;

/// The line. I3 and I10 are the same in every family.
const LINE: &[u8] = b"I3 I10 I3";
/// How long the board may take for it, and then for each response.
const PATIENCE: Duration = Duration::from_secs(1);
/// How soon it is sent again to a board that did not answer it.
const AGAIN: Duration = Duration::from_secs(1);
/// A board that has answered so many of them, but otherwise, answers them otherwise.
const TRIES: u8 = 3;

/// When the line is sent, and what the board said.
#[derive(Debug)]
pub(super) struct Check {
    not_before: Instant,
    /// The last three values that came.
    values: [Option<i64>; 3],
    /// A reply ended, whosever it was.
    is_answered: bool,
    /// How many lines were answered otherwise.
    tries: u8,
    /// Whose command was given up, and when it was sent.
    held_by: Option<(Origin, Instant)>,
}

impl Check {
    pub(super) const fn new(now: Instant) -> Self {
        Self { not_before: now, values: [None; 3], is_answered: false, tries: 0, held_by: None }
    }

    /// A line of a reply came.
    pub(super) fn line(&mut self, text: &[u8]) {
        let value = std::str::from_utf8(text).ok().and_then(answer::integer);
        self.values = [self.values[1], self.values[2], value];
    }

    /// I3, if the reply to our line has come.
    fn handshake(&self) -> Option<i64> {
        match self.values {
            [Some(first @ 0..=3), Some(4..), Some(last)] if first == last => Some(first),
            _ => None,
        }
    }

    /// How long it need not be sent.
    pub(super) fn due_in(&self, now: Instant) -> Duration {
        self.not_before.saturating_duration_since(now)
    }

    /// This command was given up, which was sent at `since`.
    pub(super) const fn hold(&mut self, origin: Origin, since: Instant) {
        self.held_by = Some((origin, since));
    }

    /// The board was reset, or has cancelled what it had: it works on nothing.
    pub(super) const fn reset(&mut self) {
        self.held_by = None;
    }

    /// Why nothing can be sent, if that is for a command given up.
    pub(super) fn reason(&self, now: Instant) -> Option<Text<REASON_MAX>> {
        let (Origin { uid, shown, .. }, since) = self.held_by.as_ref()?;
        let seconds = now.duration_since(*since).as_secs();
        Some(Text::of(&format_args!(
            "the board still works on \"{}\" of uid {uid}, sent {seconds} s ago, or no longer listens; nothing was sent; \
             ^X by an engineer cancels it",
            &**shown
        )))
    }
}

impl AsciiQueue {
    /// Sends the line, where it can be sent.
    pub(super) fn begin_check(
        &mut self,
        bus: &mut impl Bus,
        publisher: &Publisher,
        now: Instant,
    ) -> Result<(), PortError> {
        if self.buffer.is_open() {
            self.end_doubt(now);
        } else if now >= self.check.not_before && self.ports.begin_open_ended(bus, LINE)? {
            (self.check.values, self.check.is_answered) = ([None; 3], false);
            self.start(InFlight::Check, now + PATIENCE, publisher, now);
        }
        Ok(())
    }

    /// Something came; more may.
    pub(super) fn see_check(&mut self, now: Instant) {
        if let Some(UnderWay { command: InFlight::Check, deadline, .. }) = &mut self.under_way {
            *deadline = now + PATIENCE;
        }
    }

    /// A reply has ended: that to our line, or a late one.
    pub(super) fn end_check(&mut self, now: Instant) {
        self.check.is_answered = true;
        let Some(handshake) = self.check.handshake() else { return self.see_check(now) };
        if handshake >= 2 {
            self.set_reply_end(ReplyEnd::Ack);
        }
        self.under_way = None;
        self.end_doubt(now);
    }

    /// The board did not end the reply to our line in time. Where it has said that it marks no end, that is known from now on.
    pub(super) fn fail_check(&mut self, now: Instant) {
        self.check.not_before = now + AGAIN;
        self.check.tries += u8::from(self.check.is_answered);
        if matches!(self.check.handshake(), Some(0 | 1)) {
            self.set_reply_end(ReplyEnd::Silence);
        } else if self.check.tries < TRIES {
            self.state = CommandState::Silent;
            return;
        }
        self.state = CommandState::Answers;
        self.end_doubt(now);
    }

    fn end_doubt(&mut self, now: Instant) {
        self.check.held_by = None;
        self.check.tries = 0;
        self.ports.end_doubt(now);
    }

    fn set_reply_end(&mut self, reply_end: ReplyEnd) {
        if self.ports.dpram.reply_end() == reply_end {
            return;
        }
        self.ports.dpram.set_reply_end(reply_end);
        match reply_end {
            ReplyEnd::Silence => warn!(
                "the board does not mark the end of a reply (I3 is less than 2): replies end by a silence, each line takes 0.1 s \
                 longer, and a slow line may be told done early; send I3=2"
            ),
            ReplyEnd::Ack => info!("the board marks the end of a reply"),
        }
    }
}
