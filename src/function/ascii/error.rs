//! An error while a line is under way.
//!
//! A line's error replaces its `<ACK>`: no other response to the line follows (Turbo Software Reference p. 37, Turbo
//! User Manual p. 406). But unless I6=2 the board reports an error of a program's `CMD` in the same way (Software
//! Reference, I6), and then the line's own response is still to come. The port cannot tell the two apart, so it
//! reports the error and all later responses. The caller knows whether a program may run; if one may, the caller sends
//! a probe.

use std::time::Instant;

use super::{DpramPort, DpramState};
use crate::function::line_port::AsciiEvent;
use crate::map::errors;

impl DpramPort {
    /// Decides which line or program an error belongs to. A control word that no manual names counts as an error
    /// without a number.
    pub(super) fn classify_error(&mut self, control: u16, now: Instant) -> AsciiEvent {
        let number = errors::from_control(control).unwrap_or(0);
        match self.state {
            // No manual says that a board refuses a control character.
            DpramState::Idle | DpramState::Control => AsciiEvent::ProgramError(number),
            DpramState::Emptied | DpramState::Held(_) | DpramState::Resting { .. } => {
                AsciiEvent::Stale(control)
            }
            DpramState::Loaded { sent } if sent < self.length => {
                // Without its second part the board does not carry the line out, whoever caused the error.
                self.abandon(true, now);
                AsciiEvent::Done(Err(number))
            }
            DpramState::Loaded { .. } | DpramState::Replying if !self.open_ended => {
                self.state = DpramState::Unsettled;
                AsciiEvent::Error(number)
            }
            DpramState::Loaded { .. } | DpramState::Replying | DpramState::Unsettled => {
                AsciiEvent::Done(Err(number))
            }
        }
    }
}
