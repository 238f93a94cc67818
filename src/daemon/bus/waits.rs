//! How the bus thread waits: in a sleep, or in a poll of its descriptors.
//!
//! A poll costs more processor time than a sleep, and a descriptor is seldom readable. So a short wait is a sleep if
//! nobody has asked anything for a while. After the sleep the bus thread finds a command in its queue, and hears of all
//! else by the [`Doorbell`].

use std::io;
use std::os::fd::{AsRawFd, RawFd};
use std::time::Duration;

use nix::sys::eventfd::EventFd;

use crate::clock::sleep_until;
use crate::daemon::bus::doorbell::Doorbell;
use crate::daemon::bus::readable::{Descriptors, Interrupts, Readable};

/// The longest wait that may be a sleep: longer than the 2 ms of 500 Hz. A command that comes meanwhile waits for the
/// sleep's end.
const LONGEST_SLEEP_NS: u64 = 2_500_000;
/// For this long after the last command or interrupt every wait is a poll: another may follow.
const ATTENTIVE_NS: u64 = 10_000_000;
/// The longest time without a poll.
const POLL_NS: u64 = 200_000_000;

/// How to wait next.
pub struct Waits {
    /// Without a doorbell every wait is a poll.
    doorbell: Option<Doorbell>,
    /// The descriptors that the doorbell listens to.
    heard: Interrupts<RawFd>,
    /// Before this time every wait is a poll.
    sleeps_from_ns: u64,
    /// Every sleep ends by this time.
    sleeps_until_ns: u64,
    poll_ns: u64,
}

impl Default for Waits {
    fn default() -> Self {
        Self { doorbell: None, heard: [None; 3], sleeps_from_ns: 0, sleeps_until_ns: 0, poll_ns: POLL_NS }
    }
}

impl Waits {
    /// From now on short waits are sleeps. All later [`Descriptors`] must have this `stop`.
    ///
    /// # Errors
    /// The kernel gives no doorbell: every wait stays a poll.
    pub fn allow_sleeps(&mut self, stop: &EventFd) -> io::Result<()> {
        self.doorbell = Some(Doorbell::new(stop)?);
        Ok(())
    }

    /// Waits from `now` until `due_ns`, or until a descriptor is readable. After a sleep no descriptor counts as
    /// readable. The wait is a poll if not `is_quiet`: somebody has asked something, or the board is not at work.
    pub fn wait(&mut self, now: u64, due_ns: u64, is_quiet: bool, descriptors: &Descriptors<'_>) -> Readable {
        if !is_quiet {
            self.sleeps_from_ns = now.saturating_add(ATTENTIVE_NS);
        }
        let is_short = now < due_ns && due_ns <= now.saturating_add(LONGEST_SLEEP_NS);
        let doorbell = self.doorbell.as_ref().filter(|_| is_short && self.sleeps_from_ns <= now);
        let interrupts = descriptors.interrupts;
        if let Some(doorbell) = doorbell {
            let is_heard = self.heard == interrupts.map(|fd| fd.map(|fd| fd.as_raw_fd()));
            if is_heard && due_ns <= self.sleeps_until_ns && !doorbell.has_rung() {
                sleep_until(due_ns);
                return Readable::default();
            }
            doorbell.silence();
        }
        let readable = descriptors.wait(Duration::from_nanos(due_ns.saturating_sub(now)));
        if readable != Readable::default() {
            self.sleeps_from_ns = due_ns.max(now).saturating_add(ATTENTIVE_NS);
            self.sleeps_until_ns = 0;
        } else if let Some(doorbell) = doorbell {
            // The bus thread polls the descriptors that the doorbell cannot listen to.
            self.heard =
                interrupts.map(|fd| fd.filter(|fd| doorbell.listen(*fd).is_ok()).map(|fd| fd.as_raw_fd()));
            self.sleeps_until_ns = now.saturating_add(self.poll_ns);
        }
        readable
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};
    use std::os::fd::AsFd;
    use std::os::unix::net::UnixStream;
    use std::sync::Arc;
    use std::thread;
    use std::time::Instant;

    use nix::sys::eventfd::EfdFlags;

    use super::*;
    use crate::segment::monotonic_ns;

    /// A time long past the end of a test.
    const NEVER_NS: u64 = u64::MAX / 2;
    const WAIT_NS: u64 = 200_000;

    /// Waits that are sleeps, except the first. No poll comes by itself.
    fn sleeping(stop: &EventFd) -> Waits {
        let mut waits = Waits { poll_ns: NEVER_NS, ..Waits::default() };
        waits.allow_sleeps(stop).unwrap();
        waits
    }

    fn stop() -> Arc<EventFd> {
        Arc::new(EventFd::from_value_and_flags(0, EfdFlags::EFD_CLOEXEC | EfdFlags::EFD_NONBLOCK).unwrap())
    }

    /// Waits, quietly and for a short time each, until a descriptor is readable; 10 s at most.
    fn wait(waits: &mut Waits, stop: &EventFd, interrupts: [Option<&UnixStream>; 3]) -> Readable {
        let interrupts = interrupts.map(|stream| stream.map(AsFd::as_fd));
        let until = Instant::now() + Duration::from_secs(10);
        loop {
            let now = monotonic_ns();
            let descriptors = Descriptors { stop: stop.as_fd(), commands: None, interrupts };
            let readable = waits.wait(now, now + WAIT_NS, true, &descriptors);
            if readable != Readable::default() || Instant::now() > until {
                return readable;
            }
        }
    }

    #[test]
    fn the_end_is_seen_behind_a_sleep_whenever_it_comes() {
        for run in 0..50 {
            let stop = stop();
            let mut waits = sleeping(&stop);
            let writer = Arc::clone(&stop);
            let writer = thread::spawn(move || {
                // Some ends come before the first poll, some during it, some during a sleep.
                thread::sleep(Duration::from_micros(run * 10));
                writer.write(1).unwrap();
            });
            assert!(wait(&mut waits, &stop, [None; 3]).stop, "run {run}");
            writer.join().unwrap();
        }
    }

    #[test]
    fn what_comes_right_behind_a_poll_is_seen_behind_the_sleep() {
        for _ in 0..20 {
            let stop = stop();
            let mut waits = sleeping(&stop);
            let writer = Arc::clone(&stop);
            let writer = thread::spawn(move || {
                thread::sleep(Duration::from_millis(1));
                writer.write(1).unwrap();
            });
            // A poll that does not see the end, like a poll that has just looked.
            let (now, unseen) = (monotonic_ns(), self::stop());
            let descriptors = Descriptors { stop: unseen.as_fd(), commands: None, interrupts: [None; 3] };
            assert!(!waits.wait(now, now + LONGEST_SLEEP_NS, true, &descriptors).stop);
            assert!(wait(&mut waits, &stop, [None; 3]).stop);
            writer.join().unwrap();
        }
    }

    #[test]
    fn each_interrupt_is_seen_behind_a_sleep() {
        let stop = stop();
        let mut waits = sleeping(&stop);
        let (mut board, mut interrupt) = UnixStream::pair().unwrap();
        let (mut bus, mailbox) = UnixStream::pair().unwrap();
        for round in 0..20 {
            // After a while without an interrupt, short waits are sleeps again.
            let from_ns = monotonic_ns() + 2 * ATTENTIVE_NS;
            while monotonic_ns() < from_ns {
                let now = monotonic_ns();
                let interrupts = [Some(interrupt.as_fd()), None, (round > 9).then_some(mailbox.as_fd())];
                let descriptors = Descriptors { stop: stop.as_fd(), commands: None, interrupts };
                assert_eq!(waits.wait(now, now + WAIT_NS, true, &descriptors), Readable::default());
            }
            assert!(waits.sleeps_from_ns <= monotonic_ns() && waits.sleeps_until_ns >= NEVER_NS, "it sleeps");
            board.write_all(&[1]).unwrap();
            assert!(wait(&mut waits, &stop, [Some(&interrupt), None, None]).interrupt, "round {round}");
            interrupt.read_exact(&mut [0]).unwrap();
        }
        // The mailbox's interrupt, which the first rounds lacked.
        bus.write_all(&[1]).unwrap();
        assert!(wait(&mut waits, &stop, [Some(&interrupt), None, Some(&mailbox)]).mailbox);
    }

    #[test]
    fn a_wait_is_a_sleep_only_if_it_is_short_and_nobody_has_asked() {
        let stop = stop();
        stop.write(1).unwrap();
        let descriptors = Descriptors { stop: stop.as_fd(), commands: None, interrupts: [None; 3] };
        let now = monotonic_ns();
        let polls =
            |waits: &mut Waits, due_ns, is_quiet| waits.wait(now, due_ns, is_quiet, &descriptors).stop;
        // The wait is a sleep although the end has come: the doorbell has not rung.
        let asleep = || {
            let waits = sleeping(&self::stop());
            Waits { sleeps_until_ns: NEVER_NS, ..waits }
        };
        assert!(!polls(&mut asleep(), now + LONGEST_SLEEP_NS, true));
        assert!(polls(&mut asleep(), now + LONGEST_SLEEP_NS + 1, true), "too long");
        assert!(polls(&mut asleep(), now, true), "nothing to wait for");
        assert!(polls(&mut asleep(), now + LONGEST_SLEEP_NS, false), "somebody has asked");
        let mut waits = Waits { sleeps_from_ns: now + 1, ..asleep() };
        assert!(polls(&mut waits, now + LONGEST_SLEEP_NS, true), "somebody has asked a moment ago");
        let mut waits = Waits { sleeps_until_ns: now, ..asleep() };
        assert!(polls(&mut waits, now + LONGEST_SLEEP_NS, true), "a poll is due");
        assert!(polls(&mut Waits::default(), now + LONGEST_SLEEP_NS, true), "there is no doorbell");
    }
}
