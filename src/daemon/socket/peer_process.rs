//! Whether the process that made a connection lives. The connection itself does not tell: a process forked from that one has the same
//! descriptor, and holds it open for as long as it runs. No jog, stream or gather may go on for that.

use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;

use nix::errno::Errno;
use nix::sys::eventfd::{EfdFlags, EventFd};
use nix::sys::socket::{getsockopt, sockopt::PeerPidfd};
use rustix::process::{Pid, PidfdFlags, pidfd_open};

/// A descriptor that is readable once the process that made the connection has ended, whose number is `pid`. `None` where the kernel
/// gives none: before Linux 6.5 of a process whose number the daemon's PID namespace does not have (0).
pub(super) fn peer_process(stream: &UnixStream, pid: i32) -> Option<OwnedFd> {
    match getsockopt(stream, PeerPidfd) {
        Err(Errno::ENOPROTOOPT) => by_number(pid),
        found => or_ended(found),
    }
}

/// As [`peer_process`], where the kernel does not tell a socket's process but by its number.
fn by_number(pid: i32) -> Option<OwnedFd> {
    let found = pidfd_open(Pid::from_raw(pid)?, PidfdFlags::empty());
    or_ended(found.map_err(|errno| Errno::from_raw(errno.raw_os_error())))
}

/// `found`; of a process that has ended already, one that is readable.
fn or_ended(found: nix::Result<OwnedFd>) -> Option<OwnedFd> {
    match found {
        Err(Errno::ESRCH | Errno::EINVAL) => {
            EventFd::from_value_and_flags(1, EfdFlags::EFD_CLOEXEC).ok().map(OwnedFd::from)
        }
        found => found.ok(),
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
        assert!(!is_readable(&peer_process(&stream, 0).unwrap()), "it is this process");
        let mut child = Command::new("cat").stdin(Stdio::piped()).spawn().unwrap();
        let pid = child.id().cast_signed();
        let process = by_number(pid).unwrap();
        assert!(!is_readable(&process));
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(is_readable(&process) && is_readable(&by_number(pid).unwrap()));
        assert!(by_number(0).is_none());
    }
}
