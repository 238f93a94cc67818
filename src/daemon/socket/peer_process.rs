//! Whether the process that made a connection lives. The connection itself does not tell: a forked process has the same
//! descriptor, and holds the connection open for as long as it runs. No jog, stream or gather may go on for a forked
//! process.

use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;

use nix::errno::Errno;
use nix::sys::eventfd::{EfdFlags, EventFd};
use nix::sys::socket::{getsockopt, sockopt::PeerPidfd};
use rustix::process::{Pid, PidfdFlags, pidfd_open};

/// A descriptor that becomes readable once the process `pid` that made the connection has ended. `None` before Linux
/// 6.5 if the process is outside the daemon's PID namespace (`pid` is 0).
///
/// # Errors
/// The system gives no descriptor.
pub(super) fn peer_process(stream: &UnixStream, pid: i32) -> nix::Result<Option<OwnedFd>> {
    match getsockopt(stream, PeerPidfd) {
        Err(Errno::ENOPROTOOPT) => by_number(pid),
        found => or_ended(found).map(Some),
    }
}

/// As [`peer_process`], if the kernel tells a socket's process only by its number.
fn by_number(pid: i32) -> nix::Result<Option<OwnedFd>> {
    let Some(pid) = Pid::from_raw(pid) else { return Ok(None) };
    let found = pidfd_open(pid, PidfdFlags::empty());
    or_ended(found.map_err(|errno| Errno::from_raw(errno.raw_os_error()))).map(Some)
}

/// The descriptor `found`; for a process that has already ended, a readable descriptor.
fn or_ended(found: nix::Result<OwnedFd>) -> nix::Result<OwnedFd> {
    match found {
        Err(Errno::ESRCH | Errno::EINVAL) => {
            EventFd::from_value_and_flags(1, EfdFlags::EFD_CLOEXEC).map(OwnedFd::from)
        }
        found => found,
    }
}

#[cfg(test)]
mod tests {
    use std::os::fd::AsFd;
    use std::process::{Command, Stdio};

    use nix::poll::{PollFd, PollFlags, PollTimeout, poll};

    use super::*;

    fn is_readable(process: &OwnedFd) -> bool {
        poll(&mut [PollFd::new(process.as_fd(), PollFlags::POLLIN)], PollTimeout::ZERO).unwrap() > 0
    }

    #[test]
    fn the_end_of_a_process_is_seen_before_and_after_it_is_waited_for() {
        let (stream, _other) = UnixStream::pair().unwrap();
        assert!(!is_readable(&peer_process(&stream, 0).unwrap().unwrap()), "it is this process");
        let mut child = Command::new("cat").stdin(Stdio::piped()).spawn().unwrap();
        let pid = child.id().cast_signed();
        let process = by_number(pid).unwrap().unwrap();
        assert!(!is_readable(&process));
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(is_readable(&process) && is_readable(&by_number(pid).unwrap().unwrap()));
        assert!(by_number(0).unwrap().is_none());
    }
}
