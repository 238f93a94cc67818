//! The socket to the daemon. Whole calls go out, whole replies come in, and no wait goes beyond its deadline. A forked
//! process has the same socket, but neither sends nor reads over it: parent and child would get each other's replies.

use std::io::{self, Read, Write};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd};
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use nix::errno::Errno;
use nix::sys::socket::{MsgFlags, recv};

use crate::protocol::{Inbox, REPLY_MAX, Reply};

/// A socket, and its received bytes that no caller has taken yet.
#[derive(Debug)]
pub(super) struct Link {
    stream: UnixStream,
    inbox: Inbox,
    /// The process that made the socket.
    pub(super) process: u32,
}

impl Link {
    pub(super) fn new(stream: UnixStream) -> Self {
        Self { stream, inbox: Inbox::new(REPLY_MAX), process: std::process::id() }
    }

    /// Sends a whole call. The daemon begins no call that it has not received whole.
    pub(super) fn call(&mut self, mut bytes: &[u8], deadline: Instant) -> io::Result<()> {
        while !bytes.is_empty() {
            let left = left(deadline).ok_or(io::ErrorKind::TimedOut)?;
            self.stream.set_write_timeout(Some(left))?;
            match self.stream.write(bytes) {
                Ok(count) => bytes = &bytes[count..],
                Err(error) => again(error)?,
            }
        }
        Ok(())
    }

    /// The next reply. A reply in the socket counts however late this process reads it: the deadline may have passed
    /// while the process was suspended.
    pub(super) fn next_reply(&mut self, deadline: Instant) -> io::Result<Reply> {
        let mut chunk = [0; 8192];
        loop {
            let message = self.inbox.next_message();
            if let Some(message) =
                message.map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error))?
            {
                return serde_json::from_slice(&message)
                    .map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error));
            }
            let read = match left(deadline) {
                Some(left) => {
                    self.stream.set_read_timeout(Some(left))?;
                    self.stream.read(&mut chunk)
                }
                None => match recv(self.stream.as_raw_fd(), &mut chunk, MsgFlags::MSG_DONTWAIT) {
                    Err(Errno::EAGAIN) => return Err(io::ErrorKind::TimedOut.into()),
                    lay_there => lay_there.map_err(io::Error::from),
                },
            };
            match read {
                Ok(0) => {
                    let closed = "pmacd closed the connection";
                    return Err(io::Error::new(io::ErrorKind::UnexpectedEof, closed));
                }
                Ok(count) => self.inbox.push(&chunk[..count]),
                Err(error) => again(error)?,
            }
        }
    }
}

impl AsFd for Link {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.stream.as_fd()
    }
}

/// The moment `timeout` from now; a day from now if the clock cannot count that far.
pub(super) fn after(timeout: Duration) -> Instant {
    let now = Instant::now();
    now.checked_add(timeout).unwrap_or(now + Duration::from_secs(86_400))
}

/// The time left until `deadline`, never zero, which a socket's time-out must not be; `None` after the deadline.
fn left(deadline: Instant) -> Option<Duration> {
    Some(deadline.saturating_duration_since(Instant::now())).filter(|left| !left.is_zero())
}

/// Passes errors that allow another try; the deadline bounds the tries.
fn again(error: io::Error) -> io::Result<()> {
    match error.kind() {
        io::ErrorKind::Interrupted | io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut => Ok(()),
        _ => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_that_came_while_this_process_was_suspended_is_taken() {
        let (ours, mut theirs) = UnixStream::pair().unwrap();
        let mut link = Link::new(ours);
        theirs.write_all(b"{\"parameters\":{\"lines\":[]}}\0{\"par").unwrap();
        // The process goes on after its deadline.
        let passed = Instant::now();
        assert!(link.next_reply(passed).unwrap().parameters.is_some());
        let error = link.next_reply(passed).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::TimedOut, "half a reply is none, and is not waited for");
        drop(theirs);
        assert_eq!(link.next_reply(passed).unwrap_err().kind(), io::ErrorKind::UnexpectedEof);
    }
}
