//! Keeps a start from running lines that nobody expects, and a line from moving a motor that somebody else holds.

use super::Service;
use super::calls::held_by_another;
use crate::daemon::socket::leftovers::{LineEffect, Starts};
use crate::protocol::CallError;
use crate::protocol::moved_motors::motors_moved;

impl Service {
    /// Whether `client` may send `line`, by itself or in a sequence. The coordinate systems in which nothing is left when it is
    /// done. `confirmed`: what is left is to run.
    ///
    /// # Errors
    /// Why not; nothing was sent.
    pub(super) fn may_send(&mut self, client: u64, line: &str, confirmed: bool) -> Result<u32, CallError> {
        let open = self.info.board().open_buffer.as_ref().and_then(|open| open.name.as_deref());
        let effect = LineEffect::of(line, open.is_some_and(|name| name.starts_with("ROT")));
        self.may_start(Starts { systems: effect.starts, confirmed })?;
        match self.leases.held_by_another(client, motors_moved(line)) {
            Some((holder, held)) => Err(held_by_another(holder, held)),
            None => Ok(effect.forgets),
        }
    }

    /// Whether programs may be started: no stream is being ended that feeds one, and none has left lines there.
    ///
    /// # Errors
    /// Why not; nothing was sent.
    pub(super) fn may_start(&mut self, starts: Starts) -> Result<(), CallError> {
        if self.sequences.is_ending_feed(starts.systems) {
            return Err(CallError::Refused {
                reason: "not started: pmacd is ending a rotary stream into this coordinate system; try again"
                    .to_owned(),
            });
        }
        self.leftovers.check(starts, self.resets.count())
    }
}
