//! The sender of a line.

use std::fmt;

/// A user and a process of his.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Account {
    /// The user.
    pub uid: u32,
    /// The process; 0 when it is not known.
    pub pid: i32,
}

/// The sender of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Writer {
    /// Somebody who wants to know something: the daemon, or a program by the way. Such a line enters no buffer.
    Question,
    /// The daemon, who stops a motor or a program. Such a line goes whatever is open, and addresses again what was addressed.
    Stop,
    /// A user, by hand.
    Hand(Account),
    /// A user, by hand, into the buffer that this process of his has open, or opens. Where it is closed, the board would carry the line
    /// out at once.
    IntoBuffer(Account),
    /// A user, by hand, beside every buffer: such a line enters none, not even one that he has open, and opens none.
    Beside,
    /// A sequence of the daemon's.
    Sequence {
        /// Its number.
        number: u64,
        /// For whom it runs.
        account: Account,
        /// Its lines so far have opened a buffer that it has not closed.
        inside: bool,
    },
}

impl fmt::Display for Account {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.pid {
            0 => write!(f, "uid {}", self.uid),
            pid => write!(f, "uid {} (pid {pid})", self.uid),
        }
    }
}
