//! Notifies the service manager by sd_notify(3): one datagram per message to the socket `$NOTIFY_SOCKET`.

use std::io;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::time::{Duration, Instant};

use crate::daemon::shared::info::WatchedThread;

/// The connection to the service manager.
#[derive(Debug)]
pub struct Notifier {
    socket: UnixDatagram,
    manager: SocketAddr,
}

impl Notifier {
    /// Opens the socket in `$NOTIFY_SOCKET`; `None` without one.
    ///
    /// # Errors
    /// The address is invalid, or the system gives no socket.
    pub fn from_environment() -> io::Result<Option<Self>> {
        std::env::var_os("NOTIFY_SOCKET").map(|address| Self::to(address.as_bytes())).transpose()
    }

    /// Opens the socket at a path, or after an `@` in the abstract namespace.
    ///
    /// # Errors
    /// The address is neither, or the system gives no socket.
    pub fn to(address: &[u8]) -> io::Result<Self> {
        let manager = match address {
            [b'@', name @ ..] => SocketAddr::from_abstract_name(name)?,
            [b'/', ..] => SocketAddr::from_pathname(std::ffi::OsStr::from_bytes(address))?,
            _ => return Err(io::Error::new(io::ErrorKind::InvalidInput, "neither a path nor @name")),
        };
        let socket = UnixDatagram::unbound()?;
        // Do not wait for a manager that does not read.
        socket.set_nonblocking(true)?;
        Ok(Self { socket, manager })
    }

    /// Sends assignments, one on each line.
    ///
    /// # Errors
    /// The manager is gone or does not read.
    pub fn send(&self, assignments: &str) -> io::Result<()> {
        self.socket.send_to_addr(assignments.as_bytes(), &self.manager).map(drop)
    }
}

/// Decides when to send a watchdog notification: twice in the manager's limit, and only if each of the other threads
/// has made rounds since the last one. So the manager notices a thread that hangs.
#[derive(Debug)]
pub struct Watchdog {
    every: Duration,
    next: Instant,
    /// The rounds at the last notification.
    rounds: Option<[u64; WatchedThread::ALL.len()]>,
}

impl Watchdog {
    /// Reads the limit from `$WATCHDOG_USEC`, if it is for this process (`$WATCHDOG_PID`) or for any.
    #[must_use]
    pub fn from_environment(now: Instant) -> Option<Self> {
        let number = |name: &str| std::env::var(name).ok().map(|text| text.parse::<u64>().ok());
        match number("WATCHDOG_PID") {
            Some(pid) if pid != Some(std::process::id().into()) => None,
            _ => Self::new(Duration::from_micros(number("WATCHDOG_USEC").flatten()?), now),
        }
    }

    /// A watchdog with this `limit`. Zero means no limit.
    #[must_use]
    pub fn new(limit: Duration, now: Instant) -> Option<Self> {
        (!limit.is_zero()).then_some(Self { every: limit / 2, next: now, rounds: None })
    }

    /// The next time to call [`Self::stuck`].
    #[must_use]
    pub fn next(&self) -> Instant {
        self.next
    }

    /// The thread that hinders a notification at `now`, as
    /// [`Pulse::rounds`](crate::daemon::shared::info::Pulse::rounds) count its rounds; `None`: notify. Behind a thread
    /// without progress it is time again soon: the thread may only be late.
    pub fn stuck(&mut self, now: Instant, rounds: [u64; WatchedThread::ALL.len()]) -> Option<WatchedThread> {
        let last = self.rounds;
        let stuck = WatchedThread::ALL
            .into_iter()
            .find(|thread| last.is_some_and(|last| last[*thread as usize] == rounds[*thread as usize]));
        if stuck.is_none() {
            self.rounds = Some(rounds);
        }
        self.next = now + if stuck.is_none() { self.every } else { self.every / 8 };
        stuck
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_arrives_at_a_path_and_at_an_abstract_address() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("notify");
        let name = format!("pmac-test-notify-{}", std::process::id());
        let abstract_address = SocketAddr::from_abstract_name(&name).unwrap();
        for (manager, address) in [
            (UnixDatagram::bind(&path).unwrap(), path.as_os_str().as_bytes().to_vec()),
            (UnixDatagram::bind_addr(&abstract_address).unwrap(), format!("@{name}").into_bytes()),
        ] {
            Notifier::to(&address).unwrap().send("READY=1\nSTATUS=on").unwrap();
            let mut message = [0; 64];
            let length = manager.recv(&mut message).unwrap();
            assert_eq!(&message[..length], b"READY=1\nSTATUS=on");
        }
        assert!(Notifier::to(b"vsock:2:1").is_err());
        assert!(Notifier::to(b"/nonexistent/socket").unwrap().send("READY=1").is_err());
    }

    #[test]
    fn a_thread_that_stands_still_starves_the_watchdog() {
        let start = Instant::now();
        let at = |milliseconds| start + Duration::from_millis(milliseconds);
        for (thread, stood) in [(WatchedThread::Bus, [900, 1]), (WatchedThread::Socket, [1, 900])] {
            let mut watchdog = Watchdog::new(Duration::from_secs(2), start).unwrap();
            assert_eq!(watchdog.stuck(at(0), [0, 0]), None, "the start is a sign of life");
            assert_eq!(watchdog.next(), at(1000));
            assert_eq!(watchdog.stuck(at(1000), [900, 900]), None);
            let other = |rounds: u64| stood.map(|stood| if stood == 900 { 900 } else { 900 + rounds });
            for late in [2000, 2200, 2400, 9000] {
                assert_eq!(watchdog.stuck(at(late), other(late)), Some(thread), "no round since");
            }
            assert_eq!(watchdog.next(), at(9125), "it may only be late");
            assert_eq!(watchdog.stuck(at(9200), [9901, 9901]), None);
        }
        assert!(Watchdog::new(Duration::ZERO, start).is_none());
    }
}
