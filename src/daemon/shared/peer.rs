//! The process at the other end of a connection.

use std::os::unix::net::UnixStream;

use nix::sys::socket::{getsockopt, sockopt::PeerCredentials};
use nix::unistd::{Gid, Uid};

use super::open_buffer::Account;

/// The other end of a connection, as the kernel vouches for it at the time of `connect`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Peer {
    /// Its user.
    pub uid: Uid,
    /// Its primary group.
    pub gid: Gid,
    /// Its process.
    pub pid: i32,
}

impl Peer {
    /// The peer's user and process, for the bus thread.
    #[must_use]
    pub fn account(&self) -> Account {
        Account { uid: self.uid.as_raw(), pid: self.pid }
    }

    /// The process at the other end of `stream`.
    ///
    /// # Errors
    /// When the kernel does not say.
    pub fn of(stream: &UnixStream) -> nix::Result<Self> {
        let credentials = getsockopt(stream, PeerCredentials)?;
        Ok(Self {
            uid: Uid::from_raw(credentials.uid()),
            gid: Gid::from_raw(credentials.gid()),
            pid: credentials.pid(),
        })
    }
}
