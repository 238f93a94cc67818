//! The board's interrupt as a descriptor that yields 4-byte counts, the way a UIO device does.
//!
//! A simulated board announces its interrupts over a Unix socket in the same form: the native-endian total since it
//! started. The count tells how many interrupts there were, so one that was not seen is known to be missing.

use std::io::{ErrorKind, Read};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd};
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::str::FromStr;

use nix::sys::socket::{AddressFamily, SockFlag, SockType, UnixAddr, connect, socket};

/// Announcements taken in one go: a source that never stops must not hold up the servo data.
const TAKEN_MAX: usize = 64;

/// Where interrupts come from.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum InterruptSource {
    /// A Unix stream socket a simulator listens on.
    Unix(PathBuf),
}

impl FromStr for InterruptSource {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once(':') {
            Some(("unix", path)) if !path.is_empty() => Ok(Self::Unix(path.into())),
            _ => Err(format!("irq={text} is not understood, write irq=unix:PATH")),
        }
    }
}

/// An open interrupt descriptor.
pub struct Interrupt {
    stream: UnixStream,
    /// Bytes of a count that arrived without its rest.
    partial: [u8; 4],
    filled: usize,
    /// The last total; `None` until the first count, whose distance from zero says nothing about us.
    total: Option<u32>,
}

/// What a look at the descriptor gave.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Taken {
    /// Interrupts announced since the last look.
    pub interrupts: u32,
    /// Of these, how many came without an announcement of their own.
    pub missed: u32,
    /// The other end is gone; connect again.
    pub closed: bool,
}

impl Interrupt {
    /// Connects to `source`. Does not wait: a socket nobody listens on, or whose listener is stopped and has no room for
    /// one more, is an error at once.
    ///
    /// # Errors
    /// What the kernel says about the path.
    pub fn connect(source: &InterruptSource) -> std::io::Result<Self> {
        let InterruptSource::Unix(path) = source;
        let address = UnixAddr::new(path)?;
        let flags = SockFlag::SOCK_CLOEXEC | SockFlag::SOCK_NONBLOCK;
        let socket = socket(AddressFamily::Unix, SockType::Stream, flags, None)?;
        connect(socket.as_raw_fd(), &address)?;
        let stream = UnixStream::from(socket);
        Ok(Self { stream, partial: [0; 4], filled: 0, total: None })
    }

    /// Readable when an interrupt is waiting, or the other end is gone.
    #[must_use]
    pub fn descriptor(&self) -> BorrowedFd<'_> {
        self.stream.as_fd()
    }

    /// Takes the announced interrupts, a bounded number of announcements of them; the descriptor stays readable while
    /// there are more. Never waits.
    pub fn take(&mut self) -> Taken {
        let mut taken = Taken::default();
        for _ in 0..TAKEN_MAX {
            match self.stream.read(&mut self.partial[self.filled..]) {
                Ok(0) => {
                    taken.closed = true;
                    return taken;
                }
                Ok(bytes) => {
                    self.filled += bytes;
                    if self.filled == 4 {
                        self.filled = 0;
                        let total = u32::from_ne_bytes(self.partial);
                        // A first count, or one that went back (the board restarted), stands for itself alone.
                        let step = self.total.map_or(1, |last| total.wrapping_sub(last));
                        let step = if step == 0 || step > u32::MAX / 2 { 1 } else { step };
                        self.total = Some(total);
                        taken.interrupts = taken.interrupts.saturating_add(step);
                        taken.missed = taken.missed.saturating_add(step - 1);
                    }
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => return taken,
                Err(_) => {
                    taken.closed = true;
                    return taken;
                }
            }
        }
        taken
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;
    use std::os::unix::net::UnixListener;

    #[test]
    fn counts_gaps_partial_counts_and_the_end_are_seen() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("irq");
        let listener = UnixListener::bind(&path).unwrap();
        let mut interrupt = Interrupt::connect(&InterruptSource::Unix(path.clone())).unwrap();
        let (mut board, _) = listener.accept().unwrap();
        assert_eq!(interrupt.take(), Taken::default());
        board.write_all(&7u32.to_ne_bytes()).unwrap();
        assert_eq!(interrupt.take(), Taken { interrupts: 1, missed: 0, closed: false });
        board.write_all(&8u32.to_ne_bytes()).unwrap();
        board.write_all(&11u32.to_ne_bytes()).unwrap();
        assert_eq!(interrupt.take(), Taken { interrupts: 4, missed: 2, closed: false });
        board.write_all(&12u32.to_ne_bytes()[..3]).unwrap();
        assert_eq!(interrupt.take(), Taken::default());
        board.write_all(&12u32.to_ne_bytes()[3..]).unwrap();
        assert_eq!(interrupt.take().interrupts, 1);
        board.write_all(&1u32.to_ne_bytes()).unwrap();
        assert_eq!(interrupt.take(), Taken { interrupts: 1, missed: 0, closed: false });
        drop(board);
        assert!(interrupt.take().closed);
        drop(listener);
        assert!(Interrupt::connect(&InterruptSource::Unix(path)).is_err());
    }

    #[test]
    fn a_source_that_never_stops_and_one_that_never_accepts_hold_nobody_up() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("irq");
        let listener = UnixListener::bind(&path).unwrap();
        let source = InterruptSource::Unix(path);
        let mut interrupt = Interrupt::connect(&source).unwrap();
        let (mut board, _) = listener.accept().unwrap();
        for count in 1..=200u32 {
            board.write_all(&count.to_ne_bytes()).unwrap();
        }
        assert_eq!(interrupt.take().interrupts as usize, TAKEN_MAX);
        assert_eq!(interrupt.take().interrupts as usize, TAKEN_MAX, "the rest is still there");
        nix::sys::socket::listen(&listener, nix::sys::socket::Backlog::new(1).unwrap()).unwrap();
        let mut waiting = Vec::new();
        let refused = loop {
            match Interrupt::connect(&source) {
                Ok(interrupt) => waiting.push(interrupt),
                Err(error) => break error,
            }
        };
        assert_eq!(refused.kind(), ErrorKind::WouldBlock, "its backlog is full");
    }
}
