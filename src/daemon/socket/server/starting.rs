//! Keeps a start from running lines that nobody expects.

use super::Service;
use crate::daemon::socket::leftovers::Starts;
use crate::protocol::CallError;

impl Service {
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
