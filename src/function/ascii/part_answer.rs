//! The answer to the first part of a line that goes in two parts.
//!
//! "The first 159 characters are placed in DPRAM without a terminating NULL" (DPRAM manual p. 28), and the flag is set for each
//! part. That the board answers the line once, at its end, no text says: it may acknowledge each part it takes. That `<ACK>` must
//! not end the line's reply: the line would be told done before the board has all of it, and each reply be given to the line after.
//!
//! So the second part waits for an answer to the first, as [`super::late_mark`] has a line wait: the first time for
//! [`FIRST`], to learn what the board does; then up to [`EXPECTED`] on a board that answered, and not at all on one that did not.
//! Lines that come with it are the reply's: a board that carries out each part says more at the next one's end.

use std::time::{Duration, Instant};

use super::EXPECTED;
use super::late_mark::{FIRST, Follows};
use super::response_buffer::Untold;
use super::{AsciiEvent, DpramPort, ResponseText, State};
use crate::device::{Bus, BusError};
use crate::map::errors;
use crate::map::functions::response;

impl DpramPort {
    /// PMAC has taken the first part, of `sent` characters.
    pub(super) fn first_part_taken(&mut self, sent: usize, now: Instant) {
        let patience = match self.part_answer {
            Follows::Unknown => FIRST,
            Follows::Yes => EXPECTED,
            Follows::No => Duration::ZERO,
        };
        self.state = State::FirstTaken { sent, until: Some(now + patience) };
    }

    /// Behind a response: PMAC may have taken the first part, and answered it, since it was looked at (`tests/models/part_reply.pml`).
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub(super) fn look_again_for_first_part(
        &mut self,
        bus: &mut impl Bus,
        now: Instant,
    ) -> Result<(), BusError> {
        if let State::Loaded { sent } = self.state
            && sent < self.length
            && !self.is_loaded(bus)?
        {
            self.first_part_taken(sent, now);
        }
        Ok(())
    }

    /// Whether the second part waits no longer: the board has answered the first, or does not.
    pub(super) fn second_part_is_due(&mut self, now: Instant) -> bool {
        let until = match self.state {
            State::FirstTaken { until: Some(until), .. } => until,
            State::FirstTaken { until: None, .. } => return true,
            _ => return false,
        };
        if now < until {
            return false;
        }
        self.part_answer = match self.part_answer {
            // One that came so far may have been an earlier command's.
            Follows::Yes => Follows::Unknown,
            Follows::Unknown | Follows::No => Follows::No,
        };
        true
    }

    /// The board answers first parts.
    pub(super) const fn first_part_was_answered(&mut self) {
        self.part_answer = Follows::Yes;
    }

    /// Hands over the second part.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub(super) fn go_on_with_line(&mut self, bus: &mut impl Bus) -> Result<(), BusError> {
        match self.state {
            State::FirstTaken { sent, .. } => self.load(bus, sent),
            _ => Ok(()),
        }
    }

    /// Takes what the board says to the first part.
    pub(super) fn answer_to_first_part(
        &mut self,
        control: u16,
        text: ResponseText,
        now: Instant,
    ) -> AsciiEvent {
        let State::FirstTaken { sent, until } = self.state else { return AsciiEvent::Stale(control) };
        match (control, errors::from_control(control)) {
            (response::LINE | response::ACKNOWLEDGE, _) => {
                let ends = control == response::ACKNOWLEDGE;
                if ends {
                    self.first_part_was_answered();
                }
                // After lines an `<ACK>` is still to come.
                let until = until.filter(|_| !ends).map(|until| until.max(now + EXPECTED));
                self.state = State::FirstTaken { sent, until };
                if ends && text.as_bytes().is_empty() {
                    return AsciiEvent::Stale(control);
                }
                self.untold = Untold::new(text, false);
                self.tell(now).unwrap_or(AsciiEvent::Line(text))
            }
            // Whether it keeps the part, before which it would put the next line, is not known.
            (_, number) => {
                self.abandon(now, true);
                number.map_or(AsciiEvent::Unknown(control), |number| AsciiEvent::Done(Err(number)))
            }
        }
    }
}
