//! Connects to a Unix stream socket without waiting longer than asked.
//!
//! A plain `connect` on a Unix socket waits without bound while the listener's backlog is full. A stopped daemon's
//! backlog becomes full.

use std::io;
use std::os::fd::AsRawFd;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::{Duration, Instant};

use nix::errno::Errno;
use nix::sys::socket::{AddressFamily, SockFlag, SockType, UnixAddr, connect as raw_connect, socket};

/// How long to wait before trying a full backlog again.
const RETRY: Duration = Duration::from_millis(10);

/// Connects to the socket at `path`, trying until `deadline` while its backlog is full. The stream blocks.
///
/// # Errors
/// The kernel's error; `TimedOut` if the backlog stayed full.
pub fn connect(path: &Path, deadline: Instant) -> io::Result<UnixStream> {
    let address = UnixAddr::new(path)?;
    let flags = SockFlag::SOCK_CLOEXEC | SockFlag::SOCK_NONBLOCK;
    let socket = socket(AddressFamily::Unix, SockType::Stream, flags, None)?;
    loop {
        match raw_connect(socket.as_raw_fd(), &address) {
            Ok(()) => break,
            Err(Errno::EINTR) => {}
            Err(Errno::EAGAIN) if Instant::now() < deadline => std::thread::sleep(RETRY),
            Err(Errno::EAGAIN) => {
                return Err(io::Error::new(
                    io::ErrorKind::TimedOut,
                    "the daemon does not accept connections",
                ));
            }
            Err(errno) => return Err(errno.into()),
        }
    }
    let stream = UnixStream::from(socket);
    stream.set_nonblocking(false)?;
    Ok(stream)
}
