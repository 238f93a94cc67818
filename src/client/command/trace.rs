//! The trace of the daemon's bus accesses.

use super::{CommandError, Connection, DAEMON_TIMEOUT};
use crate::protocol::board::TraceReply;
use crate::protocol::calls;

impl Connection {
    /// What the daemon has read and written on the bus since this connection's call before; the first call begins the trace, which
    /// ends with the connection, or when this is not called for 5 s. With `end` no more accesses are kept: what is left comes in
    /// this reply and the next ones, until one is empty.
    ///
    /// # Errors
    /// [`CommandError`]; refused while somebody else traces.
    pub fn trace(&mut self, end: bool) -> Result<TraceReply, CommandError> {
        self.call("Trace", &calls::Trace { end: Some(end) }, DAEMON_TIMEOUT)
    }
}
