//! A stop goes over the line under way.
//!
//! Who aborts or kills means what was sent before, too: what the board carries out behind the stop moves the machine again. So no
//! more of a line is handed over, and what the board has not taken is taken back. PMAC looks at a control character before the line
//! that lies there, which it keeps for later (User Manual p. 28).
//!
//! A line of one part is made empty where it lies, and its flag goes on telling when the board is done with it.
//!
//! A board keeps the first part of a line until it finds a NUL (DPRAM manual p. 28). It is told by `^X` to forget it ([`super::hold`]).
//! Until then nothing with a NUL may lie under the flag: an empty line would end that line, and the board carry it out. So a part
//! loses its flag alone.
//!
//! The board may have taken the line in just this moment, and carry it out behind the stop. So the stop goes once more
//! when the board has answered a line that was sent behind it. Of a line that the board has taken before, the caller knows whether
//! it can move something; behind such a one the stop goes once more, too ([`DpramPort::stop_again_behind`]).

use std::time::Instant;

use super::{DpramPort, DpramState};
use crate::device::{Bus, BusError};
use crate::function::line_port::Stopped;
use crate::protocol::control::{ABORT, CANCEL, HOLD, KILL, QUIT};

/// Whether this character does no harm when it comes twice. A step would be another one.
pub(super) const fn may_come_twice(character: u8) -> bool {
    matches!(character, ABORT | KILL | HOLD | QUIT)
}

/// What goes once more where `before` was to and `character` comes, too: what stops more.
fn stronger(before: Option<u8>, character: u8) -> Option<u8> {
    let strength = |character: &u8| [HOLD, QUIT, ABORT, KILL].iter().position(|stop| stop == character);
    before.into_iter().chain(may_come_twice(character).then_some(character)).max_by_key(strength)
}

/// Whether `character` goes over another one, of nobody here, that the board leaves in its word: what stops over what stops no more.
pub(super) fn goes_over_foreign(character: u8, found: u8) -> bool {
    let found = Some(found).filter(|found| may_come_twice(*found));
    match character {
        CANCEL => found.is_none(),
        _ => may_come_twice(character) && stronger(found, character) == Some(character),
    }
}

impl DpramPort {
    /// Ends the line under way before `character`, which [goes over it](super::control::goes_over_line), is handed over, as
    /// `LinePort::give_up` does.
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

    /// The stop `character` was handed over. Where the board has all of a line that it has not ended, and that `may_move` something,
    /// it may carry that out behind the stop, which goes once more then. So it does where a stop before it is to.
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

    /// The machine is to go on: no stop goes once more.
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
