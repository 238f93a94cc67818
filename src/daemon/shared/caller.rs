//! The caller of a method on the command socket.

use super::peer::Peer;

/// A caller.
#[derive(Debug, Clone, Copy)]
pub struct Caller {
    /// The connection.
    pub client: u64,
    /// The other end of it.
    pub peer: Peer,
    /// The caller wants no reply.
    pub oneway: bool,
}

impl Caller {
    /// In the place of the connection, where no client has called.
    pub const NOBODY: u64 = u64::MAX;
}
