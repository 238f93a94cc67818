//! The first thread's work: waits for signals, and keeps the service manager informed.

use std::io;
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use log::{error, info, warn};
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::signal::{SigSet, Signal};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::backend::SignalDelivery;
use signal_hook::iterator::exfiltrator::SignalOnly;

use super::notify::{Notifier, Watchdog};
use crate::daemon::shared::info::{Pulse, WatchedThread};
use crate::protocol::{BoardInfo, State};

/// Period of the checks for a new state and for a thread that ended by itself.
const SUPERVISOR_LOOK: Duration = Duration::from_millis(500);

/// Collects the signals that end the daemon.
pub struct Signals(SignalDelivery<UnixStream, SignalOnly>);

impl Signals {
    /// Queues SIGTERM, SIGINT and SIGHUP from now on.
    ///
    /// # Errors
    /// The system gives no descriptors.
    pub fn take() -> io::Result<Self> {
        // A parent may have blocked these signals, and a process inherits blocked signals.
        SigSet::from_iter([Signal::SIGTERM, Signal::SIGINT, Signal::SIGHUP]).thread_unblock()?;
        let (read, write) = UnixStream::pair()?;
        SignalDelivery::with_pipe(read, write, SignalOnly, [SIGTERM, SIGINT, SIGHUP]).map(Self)
    }

    /// Waits until `deadline` for a signal that ends the daemon.
    fn wait(&mut self, deadline: Instant) -> Option<i32> {
        // Round up: rounding down would spin for the last millisecond.
        let left = deadline.saturating_duration_since(Instant::now()) + Duration::from_millis(1);
        let timeout = PollTimeout::try_from(left).unwrap_or(PollTimeout::MAX);
        let _ = poll(&mut [PollFd::new(self.0.get_read().as_fd(), PollFlags::POLLIN)], timeout);
        let mut end = None;
        for signal in self.0.pending() {
            if signal == SIGHUP {
                warn!("SIGHUP is ignored: restart the daemon to read the configuration again");
            } else {
                end = Some(signal);
            }
        }
        end
    }
}

/// Informs the service manager, if there is one.
pub struct Manager {
    notifier: Option<Notifier>,
    watchdog: Option<Watchdog>,
    told: String,
    stuck: Option<WatchedThread>,
}

impl Manager {
    /// Opens the connection that the environment names.
    #[must_use]
    pub fn from_environment() -> Self {
        let notifier = Notifier::from_environment().unwrap_or_else(|error| {
            warn!("NOTIFY_SOCKET: {error}; the service manager gets no notifications");
            None
        });
        let watchdog = notifier.as_ref().and_then(|_| Watchdog::from_environment(Instant::now()));
        Self { notifier, watchdog, told: String::new(), stuck: None }
    }

    fn send(&self, assignments: &str) {
        if let Some(notifier) = &self.notifier
            && let Err(error) = notifier.send(assignments)
        {
            warn!("cannot notify the service manager: {error}");
        }
    }

    /// Reports that the segment is published and the socket listens.
    pub fn ready(&mut self, pulse: &Pulse) {
        self.told = status(&pulse.board());
        self.send(&format!("READY=1\nSTATUS={}", self.told));
    }

    /// Reports that the daemon is stopping.
    pub fn stopping(&self) {
        // Add a last watchdog notification: stopping has its own time limit.
        self.send("STOPPING=1\nWATCHDOG=1\nSTATUS=stopping");
    }

    /// Sends the status and the watchdog notification, if due.
    fn look(&mut self, pulse: &Pulse, now: Instant) {
        if self.notifier.is_none() {
            return;
        }
        let status = status(&pulse.board());
        if status != self.told {
            self.send(&format!("STATUS={status}"));
            self.told = status;
        }
        if let Some(watchdog) = &mut self.watchdog
            && now >= watchdog.next()
        {
            let stuck = watchdog.stuck(now, pulse.rounds());
            match stuck {
                None => self.send("WATCHDOG=1"),
                Some(thread) if self.stuck != stuck => {
                    let thread = thread.name();
                    error!(
                        "the {thread} thread makes no rounds: watchdog notifications stop until it goes on"
                    );
                }
                Some(_) => {}
            }
            self.stuck = stuck;
        }
    }

    fn next(&self, now: Instant) -> Instant {
        let look = now + SUPERVISOR_LOOK;
        self.watchdog.as_ref().map_or(look, |watchdog| watchdog.next().min(look))
    }
}

/// Waits for the end. Returns the signal, or `None` if `ended` reports that a thread or the simulator ended.
pub fn until_asked_to_end(
    signals: &mut Signals,
    manager: &mut Manager,
    pulse: &Pulse,
    mut ended: impl FnMut() -> bool,
) -> Option<i32> {
    loop {
        let now = Instant::now();
        manager.look(pulse, now);
        if let Some(signal) = signals.wait(manager.next(now)) {
            info!("signal {signal}: stopping");
            return Some(signal);
        }
        if ended() {
            return None;
        }
    }
}

/// One line for `systemctl status`: board, state, type, firmware and servo rate.
fn status(info: &BoardInfo) -> String {
    let state = match info.state {
        State::Init => "no data yet",
        State::Live => "live",
        State::Stale => "stale",
        State::Dead => "ended",
    };
    let mut text = format!("{}: {state}", info.board);
    if let Some(board_type) = &info.board_type {
        text += &format!(", {board_type}");
    }
    if let Some(firmware) = &info.firmware {
        text += &format!(", firmware {firmware}");
    }
    if let Some(period) = info.servo_period_ns.filter(|period| *period > 0) {
        text += &format!(", servo {:.1} Hz", 1e9 / period as f64);
    }
    // Each line of a message is an assignment, so the board's text must not contain a line end.
    text.replace(|c: char| c.is_control(), " ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::shared::info::Info;
    use crate::daemon::shared::status::{BoardStatus, KnownIdentity};
    use std::os::unix::net::UnixDatagram;

    #[test]
    fn the_manager_learns_of_each_change_once_and_of_a_stuck_thread_by_silence() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("notify");
        let socket = UnixDatagram::bind(&path).unwrap();
        socket.set_nonblocking(true).unwrap();
        let said = || {
            let mut text = [0; 512];
            socket.recv(&mut text).ok().map(|length| String::from_utf8_lossy(&text[..length]).into_owned())
        };
        let start = Instant::now();
        let mut manager = Manager {
            notifier: Some(Notifier::to(path.to_str().unwrap().as_bytes()).unwrap()),
            watchdog: Watchdog::new(Duration::from_secs(2), start),
            told: String::new(),
            stuck: None,
        };
        let info = BoardInfo { board: "sim".to_owned(), ..BoardInfo::default() };
        let mut info = Info::new(&crate::map::PMAC, info, crate::protocol::BoardSettings::default());
        let pulse = info.pulse();
        manager.ready(&pulse);
        assert_eq!(said().as_deref(), Some("READY=1\nSTATUS=sim: no data yet"));
        manager.look(&pulse, start);
        assert_eq!(said().as_deref(), Some("WATCHDOG=1"));
        info.take(BoardStatus {
            state: State::Live,
            identity: Some(KnownIdentity {
                firmware: Some("1.16D\nREADY=0".into()),
                board_type: None,
                motors: 8,
                servo_period_ns: Some(442_708),
            }),
            ..BoardStatus::default()
        });
        for _ in 0..2 {
            manager.look(&pulse, start);
        }
        assert_eq!(said().as_deref(), Some("STATUS=sim: live, firmware 1.16D READY=0, servo 2258.8 Hz"));
        let mut second = 1;
        let mut seconds = |count: u64, living: &[WatchedThread]| {
            for now in second..second + count {
                living.iter().for_each(|thread| pulse.count_round(*thread));
                manager.look(&pulse, start + Duration::from_secs(now));
            }
            second += count;
        };
        for living in [&[][..], &[WatchedThread::Bus], &[WatchedThread::Socket]] {
            seconds(10, living);
            assert_eq!(said(), None, "only {living:?} made rounds");
            seconds(1, &WatchedThread::ALL);
            assert_eq!(said().as_deref(), Some("WATCHDOG=1"));
        }
    }
}
