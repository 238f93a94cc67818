//! An error while a line is under way.
//!
//! It takes the place of the line's `<ACK>`: no other response to the line follows (Turbo Software Reference p. 37, Turbo User Manual
//! p. 406). But unless I6=2 the board reports an error of a program's `CMD` in the same way (Software Reference, I6). Then the line's
//! own response is still to come. The port does not know which it is, so it tells the error and goes on telling what comes. Its
//! caller knows whether a program may run, and lets the board's order of answers decide where one may.

use std::time::Instant;

use super::{AsciiEvent, DpramPort, State};
use crate::device::{Bus, BusError};
use crate::map::errors;

impl DpramPort {
    /// The number in `control` where that is an error of a program for sure: nothing is under way that a board refuses, or the
    /// board has not taken it yet, `is_early` being true of a control character. A board that was seen to answer before it clears
    /// the flag is believed. At most 1 read.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub(super) fn error_of_program(
        &self,
        bus: &mut impl Bus,
        control: u16,
        is_early: bool,
    ) -> Result<Option<u16>, BusError> {
        let Some(number) = errors::from_control(control) else { return Ok(None) };
        let is_programs = match self.state {
            // No manual has a board refuse a control character.
            State::Idle | State::ControlReply { .. } => true,
            State::Loaded { sent } if sent == self.length && !self.answers_early && !self.open_ended => {
                self.is_loaded(bus)?
            }
            _ => is_early,
        };
        Ok(Some(number).filter(|_| is_programs))
    }

    /// An error came that may be the command's own.
    pub(super) fn end_with_error(&mut self, number: u16, now: Instant) -> AsciiEvent {
        match self.state {
            State::Refused => {}
            _ if self.open_ended => self.end_reply(now),
            // Without its second part the line is not carried out, whosever the error is.
            State::Loaded { sent } if sent < self.length => self.abandon(now, true),
            _ => {
                self.state = State::Refused;
                return AsciiEvent::Error(number);
            }
        }
        AsciiEvent::Done(Err(number))
    }

    /// The error was the line's: what comes from now on belongs to nobody.
    pub fn believe_error(&mut self, now: Instant) {
        if self.state == State::Refused {
            self.rest(now);
        }
    }
}
