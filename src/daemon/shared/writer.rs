//! The sender of a line.

use std::fmt;

/// A user and a process of that user.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Account {
    /// The user.
    pub uid: u32,
    /// The process; 0 if it is unknown.
    pub pid: i32,
}

/// The sender of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Writer {
    /// A sender that only asks: the daemon, or a program by the way. Such a line enters no buffer.
    Question,
    /// The daemon, which stops a motor or a program. It sends such a line whatever is open, and the line restores the
    /// address.
    Stop,
    /// A user, by hand.
    Hand(Account),
    /// A user, by hand, into the buffer that this process of the user has open, or opens. If the buffer is closed, the
    /// board would carry the line out at once.
    IntoBuffer(Account),
    /// A user, by hand, beside every buffer: such a line enters no buffer, not even the user's own, and opens none.
    Beside,
    /// A sequence of the daemon's.
    Sequence {
        /// The sequence's number.
        number: u64,
        /// The account for which the sequence runs.
        account: Account,
        /// The sequence's lines so far have opened a buffer, and have not closed it.
        inside: bool,
    },
}

impl Writer {
    /// The number of every rotary stream: a stream closes the buffers that another stream has opened.
    pub const STREAMS: u64 = u64::MAX;
}

impl fmt::Display for Account {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.pid {
            0 => write!(f, "uid {}", self.uid),
            pid => write!(f, "uid {} (pid {pid})", self.uid),
        }
    }
}
