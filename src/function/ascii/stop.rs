//! A stop goes over the line under way.
//!
//! Who aborts or kills means what was sent before, too: a line whose rest is handed over after the stop would move the machine again.
//! So no more of it is handed over, and a part that the board has not taken is taken back.
//!
//! A board keeps the first part of a line until it finds a NUL (DPRAM manual p. 28). It is told by `^X` to forget it ([`super::hold`]).
//! Until then nothing with a NUL may lie under the flag: an empty line would end that line, and the board carry it out.
//!
//! The board may have taken the part in just this moment, and carry the line out behind the stop. So the stop goes once more
//! when the board has shown that it is free.

use std::time::Instant;

use super::late_mark::Follows;
use super::{DpramPort, State};
use crate::device::{Bus, BusError};
use crate::protocol::control::{ABORT, HOLD, KILL, QUIT};

/// What a stop has done to the line under way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stopped {
    /// Nothing: none is under way, or the board has all of it.
    Nothing,
    /// It is not sent: the board has not got the end of it, and does nothing before that.
    Unsent,
    /// The board may have carried out some of it, or all.
    Uncertain,
}

/// Whether this character does no harm when it comes twice. A step would be another one.
const fn may_come_twice(character: u8) -> bool {
    matches!(character, ABORT | KILL | HOLD | QUIT)
}

impl DpramPort {
    /// Ends the line under way before `character`, which [goes over it](super::control::goes_over_line), is handed over. The port is
    /// held then, as after [`DpramPort::give_up`].
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn stop(&mut self, bus: &mut impl Bus, character: u8, now: Instant) -> Result<Stopped, BusError> {
        let lacks_end = match self.state {
            State::FirstTaken { .. } => true,
            State::Loaded { sent } => sent < self.length,
            _ => return Ok(Stopped::Nothing),
        };
        let has_parts = self.length > self.first_part();
        if !lacks_end && !(has_parts && self.is_loaded(bus)?) {
            return Ok(Stopped::Nothing);
        }
        self.withdraw_line(bus)?;
        self.abandon(now, has_parts);
        self.stop_again = may_come_twice(character).then_some(character);
        // A board that answers a first part may carry it out.
        let is_unsent = lacks_end && self.part_answer == Follows::No;
        Ok(if is_unsent { Stopped::Unsent } else { Stopped::Uncertain })
    }
}
