//! The trace of the daemon's bus accesses.

use super::{CommandError, Connection, DAEMON_TIMEOUT};
use crate::protocol::board::TraceReply;
use crate::protocol::calls;

impl Connection {
    /// The daemon's accesses to the bus since this connection's last call. The first call begins the trace, which ends
    /// with the connection or after 5 s without a call. With `end` the daemon records no more accesses: this reply and
    /// the next ones bring the rest, until a reply is empty.
    ///
    /// # Errors
    /// [`CommandError`]; the daemon refuses while another client traces.
    pub fn trace(&mut self, end: bool) -> Result<TraceReply, CommandError> {
        self.call("Trace", &calls::Trace { end: Some(end) }, DAEMON_TIMEOUT)
    }
}
