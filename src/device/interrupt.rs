//! The board's interrupt as a descriptor that yields 4-byte counts. The descriptor is a UIO device, or a Unix socket
//! on which a simulated board announces its interrupts in the same form: the total since the board started, in native
//! byte order.
//!
//! The count includes every interrupt, so the host notices a missed one.

use std::fmt;
use std::io::{ErrorKind, Read};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use nix::sys::socket::{AddressFamily, SockFlag, SockType, UnixAddr, connect, socket};

use crate::device::refusal::OpenError;
use crate::device::system::System;
use crate::device::system::inherited::Inherited;
use crate::device::uio::UioDevice;
use crate::device::uio::interrupt::{Count, NoInterrupt, UioInterrupt};

/// The most announcements that the host takes at once: a source that never stops must not hold up the servo data.
const TAKEN_MAX: usize = 64;

/// The source of interrupts.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum InterruptSource {
    /// A Unix stream socket on which a simulator listens.
    Unix(PathBuf),
    /// The node of a UIO device.
    Uio(PathBuf),
}

impl FromStr for InterruptSource {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once(':') {
            Some(("unix", path)) if !path.is_empty() => Ok(Self::Unix(path.into())),
            Some(("uio", node)) if node.starts_with('/') => Ok(Self::Uio(node.into())),
            _ => Err(format!("irq={text} is not understood, write irq=uio:/dev/uioN or irq=unix:PATH")),
        }
    }
}

impl fmt::Display for InterruptSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unix(path) => write!(f, "unix:{}", path.display()),
            Self::Uio(node) => write!(f, "uio:{}", node.display()),
        }
    }
}

/// Why the host could not open an interrupt.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum InterruptError {
    /// The socket.
    #[error(transparent)]
    Socket(#[from] std::io::Error),
    /// The UIO device.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The UIO device has no usable interrupt.
    #[error(transparent)]
    None(#[from] NoInterrupt),
}

/// An open interrupt descriptor.
pub struct Interrupt {
    line: InterruptLine,
    /// The last total; `None` before the first count, which may include interrupts from before.
    total: Option<u32>,
}

enum InterruptLine {
    Socket {
        stream: UnixStream,
        /// The bytes of a count that have arrived.
        partial: [u8; 4],
        filled: usize,
    },
    Uio(UioInterrupt),
}

/// The result of one poll of the descriptor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Taken {
    /// Interrupts since the last poll.
    pub interrupts: u32,
    /// The interrupts among them without an announcement of their own.
    pub missed: u32,
    /// The other end is gone; connect again.
    pub closed: bool,
    /// The device is there, but the host could not re-arm its interrupt: no more interrupts will come.
    pub disarmed: bool,
}

impl Taken {
    fn add(&mut self, last: &mut Option<u32>, total: u32) {
        // A first count, or one that went back (the board restarted), counts as one interrupt.
        let step = last.map_or(1, |last| total.wrapping_sub(last));
        let step = if step == 0 || step > u32::MAX / 2 { 1 } else { step };
        *last = Some(total);
        self.interrupts = self.interrupts.saturating_add(step);
        self.missed = self.missed.saturating_add(step - 1);
    }
}

impl From<UioInterrupt> for Interrupt {
    fn from(interrupt: UioInterrupt) -> Self {
        Self { total: interrupt.total(), line: InterruptLine::Uio(interrupt) }
    }
}

impl Interrupt {
    /// Opens `source` on this machine. Does not wait: a socket without a listener, or with one that is stopped and has
    /// a full queue, is an error at once.
    ///
    /// # Errors
    /// When the host cannot open the source, or the source cannot give interrupts.
    pub fn connect(source: &InterruptSource) -> Result<Self, InterruptError> {
        Self::open(source, &System::here(), &Inherited::default())
    }

    /// Opens `source` on `system`, from an inherited descriptor if the service manager handed one over.
    ///
    /// # Errors
    /// When the host cannot open the source, or the source cannot give interrupts.
    pub fn open(
        source: &InterruptSource,
        system: &System,
        inherited: &Inherited,
    ) -> Result<Self, InterruptError> {
        match source {
            InterruptSource::Unix(path) => Ok(Self::over(dial(path)?)),
            InterruptSource::Uio(node) => {
                Ok(UioDevice::open(system, inherited, node)?.interrupt().map(Self::from)?)
            }
        }
    }

    /// The interrupts announced on an open socket.
    fn over(stream: UnixStream) -> Self {
        Self { line: InterruptLine::Socket { stream, partial: [0; 4], filled: 0 }, total: None }
    }

    /// Readable when an interrupt is waiting, or the other end is gone.
    #[must_use]
    pub fn descriptor(&self) -> BorrowedFd<'_> {
        match &self.line {
            InterruptLine::Socket { stream, .. } => stream.as_fd(),
            InterruptLine::Uio(interrupt) => interrupt.file().as_fd(),
        }
    }

    /// Takes the announced interrupts, up to a limit; the descriptor stays readable while there are more. Re-arms a UIO
    /// device after each. Never waits.
    pub fn take(&mut self) -> Taken {
        let mut taken = Taken::default();
        match &mut self.line {
            InterruptLine::Socket { stream, partial, filled } => {
                for _ in 0..TAKEN_MAX {
                    match stream.read(&mut partial[*filled..]) {
                        Ok(0) => {
                            taken.closed = true;
                            break;
                        }
                        Ok(bytes) => {
                            *filled += bytes;
                            if *filled == 4 {
                                *filled = 0;
                                taken.add(&mut self.total, u32::from_ne_bytes(*partial));
                            }
                        }
                        Err(error) if error.kind() == ErrorKind::Interrupted => {}
                        Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                        Err(_) => {
                            taken.closed = true;
                            break;
                        }
                    }
                }
            }
            // One read gives the total; an interrupt that fires again at once must not keep the thread here.
            InterruptLine::Uio(interrupt) => match interrupt.read() {
                Count::Nothing => {}
                Count::Total(total) => taken.add(&mut self.total, total),
                Count::Last(total) => {
                    taken.add(&mut self.total, total);
                    taken.disarmed = true;
                }
                Count::Gone => taken.closed = true,
            },
        }
        taken
    }
}

fn dial(path: &Path) -> std::io::Result<UnixStream> {
    let address = UnixAddr::new(path)?;
    let flags = SockFlag::SOCK_CLOEXEC | SockFlag::SOCK_NONBLOCK;
    let socket = socket(AddressFamily::Unix, SockType::Stream, flags, None)?;
    connect(socket.as_raw_fd(), &address)?;
    Ok(UnixStream::from(socket))
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
        assert_eq!(interrupt.take(), Taken { interrupts: 1, ..Taken::default() });
        board.write_all(&8u32.to_ne_bytes()).unwrap();
        board.write_all(&11u32.to_ne_bytes()).unwrap();
        assert_eq!(interrupt.take(), Taken { interrupts: 4, missed: 2, ..Taken::default() });
        board.write_all(&12u32.to_ne_bytes()[..3]).unwrap();
        assert_eq!(interrupt.take(), Taken::default());
        board.write_all(&12u32.to_ne_bytes()[3..]).unwrap();
        assert_eq!(interrupt.take().interrupts, 1);
        board.write_all(&1u32.to_ne_bytes()).unwrap();
        assert_eq!(interrupt.take(), Taken { interrupts: 1, ..Taken::default() });
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
        let InterruptError::Socket(refused) = refused else { panic!("{refused}") };
        assert_eq!(refused.kind(), ErrorKind::WouldBlock, "its backlog is full");
    }
}
