//! A stop ends the line under way.
//!
//! An abort or kill also covers lines sent before: a line that the board carries out after the stop would move the
//! machine again. So the port hands over no more of the line and takes back the untaken part. PMAC looks at a control
//! character before the waiting line, and keeps that line for later (User Manual p. 28).
//!
//! The port empties a line of one part in the buffer; the board still clears the flag when it is done with the line.
//!
//! A board keeps the first part of a line until it finds a NUL (DPRAM manual p. 28) or takes a `^X` ([`super::hold`]).
//! Until then the port must not hand over a NUL: an empty line would end that part, and the board would carry it out.
//! So the port only clears the part's flag.
//!
//! The board may have taken the line just now and may carry it out after the stop. So the port sends the stop once
//! more when the board has answered a later line. The port does the same for a line that the board took before and
//! that may move a motor ([`DpramPort::stop_again_behind`]).

use std::time::Instant;

use super::{DpramPort, DpramState};
use crate::device::{Bus, BusError};
use crate::function::line_port::Stopped;
use crate::protocol::control::{ABORT, CANCEL, HOLD, KILL, QUIT};

/// Whether the board may get this character twice without harm. A second step would be another step.
pub(super) const fn may_come_twice(character: u8) -> bool {
    matches!(character, ABORT | KILL | HOLD | QUIT)
}

/// The stronger of the stop `before` and the new `character`: the port sends that stop once more.
fn stronger(before: Option<u8>, character: u8) -> Option<u8> {
    let strength = |character: &u8| [HOLD, QUIT, ABORT, KILL].iter().position(|stop| stop == character);
    before.into_iter().chain(may_come_twice(character).then_some(character)).max_by_key(strength)
}

/// Whether `character` may replace another host's character that the board leaves in its word: a stop replaces any
/// weaker character.
pub(super) fn goes_over_foreign(character: u8, found: u8) -> bool {
    let found = Some(found).filter(|found| may_come_twice(*found));
    match character {
        CANCEL => found.is_none(),
        _ => may_come_twice(character) && stronger(found, character) == Some(character),
    }
}

impl DpramPort {
    /// Ends the line under way before `character`, which [goes over it](super::control::goes_over_line), is handed
    /// over, as `LinePort::give_up` does.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn stop(&mut self, bus: &mut dyn Bus, character: u8, now: Instant) -> Result<Stopped, BusError> {
        let lacks_end = match self.state {
            DpramState::Loaded { sent } => sent < self.length,
            DpramState::Unsettled => false,
            _ => return Ok(Stopped::Nothing),
        };
        if !lacks_end && (self.flag_is_characters() || !self.is_loaded(bus)?) {
            return Ok(Stopped::Nothing);
        }
        self.end_line(bus, now)?;
        self.stop_again = stronger(self.stop_again, character);
        Ok(if lacks_end { Stopped::Unsent } else { Stopped::Uncertain })
    }

    /// The port has handed over the stop `character`. An unfinished line that `may_move` a motor may be carried out
    /// after the stop. The port then sends the stop once more; it also does so if an earlier stop was due again.
    pub fn stop_again_behind(&mut self, character: u8, may_move: bool) {
        if let DpramState::Held(hold) = &mut self.state
            && hold.character != CANCEL
        {
            hold.character = stronger(Some(hold.character), character).unwrap_or(character);
            return;
        }
        if self.stop_again.is_some() || may_move {
            self.stop_again = stronger(self.stop_again, character);
        }
    }

    /// The machine shall go on: the port does not send a stop once more.
    pub fn forget_stop(&mut self) {
        self.stop_again = None;
        if let DpramState::Held(hold) = self.state
            && hold.character != CANCEL
            && !hold.lies()
        {
            self.state = DpramState::Idle;
        }
    }
}
