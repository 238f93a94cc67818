//! What is known of the board. The bus thread reports it by events, the socket's thread answers `GetInfo` from it, and the
//! first thread shows it to the service manager.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::function_use::Use;
use super::queue::{Event, GivenUp, Sender};
use super::status::{BoardStatus, Enabling, HostPortCounts, KnownIdentity};
use crate::function::servo::Motion;
use crate::map::{Family, Function, Motors};
use crate::protocol::board::{Elsewhere, Replay};
use crate::protocol::program_words::waits_for;
use crate::protocol::{BoardInfo, BoardSettings, Enabled, State};
use crate::recording::Replies;

/// How long no command line is answered until that is told: a single one may be slow.
const SILENT: Duration = Duration::from_secs(2);

/// The bus thread's side: reports what has changed.
#[derive(Debug, Default)]
pub struct InfoReport {
    now: BoardStatus,
    reported: BoardStatus,
    /// The queue had no room for the last change.
    is_untold: bool,
}

impl InfoReport {
    /// Takes note of a change. [`Self::poll`] reports it.
    pub fn set(&mut self, change: impl FnOnce(&mut BoardStatus)) {
        change(&mut self.now);
    }

    /// Reports what has changed since the last report, in one event. A full queue is tried again by the next call.
    pub fn poll(&mut self, events: &Sender<Event>) {
        // Compared where they lie: most calls find no change, and a copy costs more than they do.
        let is_new = self.now != self.reported;
        self.is_untold = is_new && events.try_send(Event::Info(self.now)).is_err();
        if is_new && !self.is_untold {
            self.reported = self.now;
        }
    }

    /// Whether the last call of [`Self::poll`] found no room for a change.
    #[must_use]
    pub const fn is_untold(&self) -> bool {
        self.is_untold
    }
}

/// The socket's side: the daemon's present knowledge of its board, and its settings.
#[derive(Debug)]
pub struct Info {
    family: &'static Family,
    board: BoardInfo,
    settings: BoardSettings,
    status: BoardStatus,
    /// When the board said, asked for a client, that background variables are switched on.
    confirmed: Option<Instant>,
    pulse: Arc<Pulse>,
    /// Of a replay.
    replies: Option<Arc<Replies>>,
}

impl Info {
    /// Starts with `board`, which is of `family`. The `settings` stay.
    #[must_use]
    pub fn new(family: &'static Family, board: BoardInfo, settings: BoardSettings) -> Self {
        let pulse = Arc::new(Pulse { board: Mutex::new(board.clone()), ..Pulse::default() });
        Self {
            family,
            board,
            settings,
            status: BoardStatus::default(),
            confirmed: None,
            pulse,
            replies: None,
        }
    }

    /// Of a replay whose recording answers `replies`.
    #[must_use]
    pub fn of_replay(mut self, replies: Arc<Replies>) -> Self {
        self.board.replay = Some(Replay::default());
        self.replies = Some(replies);
        self
    }

    /// Of a replay, what its recording answers.
    #[must_use]
    pub fn replies(&self) -> Option<&Replies> {
        self.replies.as_deref()
    }

    /// What the first thread sees.
    #[must_use]
    pub fn pulse(&self) -> Arc<Pulse> {
        Arc::clone(&self.pulse)
    }

    /// What `GetInfo` answers.
    #[must_use]
    pub fn board(&self) -> &BoardInfo {
        &self.board
    }

    /// The board's family.
    #[must_use]
    pub fn family(&self) -> &'static Family {
        self.family
    }

    /// What `GetSettings` answers.
    #[must_use]
    pub fn settings(&self) -> &BoardSettings {
        &self.settings
    }

    /// Why `function` cannot be used now, if it cannot.
    #[must_use]
    pub fn why_not(&self, function: Function) -> Option<String> {
        let functions = &self.settings.functions;
        if !functions.has(function) {
            return Some(functions.why_not(function, self.family));
        }
        match self.status.uses.of(function) {
            Use::Off | Use::On => None,
            Use::Waits => Some(format!(
                "the function `{}` is not used yet: {}",
                function.name(),
                waits_for(self.status.buffer.is_open, &self.status.definitions)
            )),
            Use::Held => {
                let all = &self.board.program_words;
                all.iter().find(|words| words.function == function).map(ToString::to_string)
            }
        }
    }

    /// Whether an automatic function is at work.
    #[must_use]
    pub fn is_enabled(&self, function: Enabled) -> bool {
        self.status.enabled.contains(function)
    }

    /// The motors that a jog leaves alone, because it would close their loop.
    #[must_use]
    pub fn loops_left_open(&self) -> Motors {
        Motors::from_bits(self.status.loops_left_open)
    }

    /// The motors of whose loops nothing is known yet.
    #[must_use]
    pub fn loops_untold(&self) -> Motors {
        Motors::from_bits(self.status.loops_untold)
    }

    /// The command that holds the port for command lines: one that was given up, or a slow line.
    #[must_use]
    pub fn holds_port(&self) -> Option<GivenUp> {
        self.status.holds_port
    }

    /// Which motors move.
    #[must_use]
    pub fn motion(&self) -> Motion {
        self.status.motion
    }

    /// The coordinate systems that run a motion program, bit 0 being number 1; `None` while no report tells of all.
    #[must_use]
    pub fn programs_run(&self) -> Option<u32> {
        self.status.programs_run
    }

    /// Whether the board gathers; `None` while no report tells.
    #[must_use]
    pub fn gathers(&self) -> Option<bool> {
        self.status.gathers
    }

    /// What somebody else does on the board, or has changed there, by `now`; `gathers`: a gather of our own runs.
    #[must_use]
    pub fn elsewhere(&self, gathers: bool, now: Instant) -> Vec<Elsewhere> {
        let ago_ms = |since: Instant| u64::try_from(now.saturating_duration_since(since).as_millis()).ok();
        let changes = self.status.changes.iter().flatten();
        let mut all: Vec<Elsewhere> = changes
            .map(|change| Elsewhere {
                what: format!("I{}", change.variable),
                was: Some(change.was.into()),
                is: Some(change.is.into()),
                ago_ms: ago_ms(change.since),
            })
            .collect();
        let plain = |what: &str| Elsewhere { what: what.to_owned(), was: None, is: None, ago_ms: None };
        if self.status.buffer.is_open && self.status.buffer.opened.is_none() {
            all.push(plain("program_buffer"));
        }
        if self.gathers() == Some(true) && !gathers {
            all.push(plain("gather"));
        }
        let silent = self.status.silent_since.filter(|since| now >= *since + SILENT);
        if let Some(since) = silent.filter(|_| self.status.state == State::Live) {
            all.push(Elsewhere { ago_ms: ago_ms(since), ..plain("command_lines") });
        }
        all
    }

    /// What the board said of the I-variables that switch functions on.
    #[must_use]
    pub fn enabling(&self) -> Enabling {
        let Enabling { asked, .. } = self.status.enabling;
        Enabling { asked: asked.max(self.confirmed), ..self.status.enabling }
    }

    /// The board has said at `now` that background variables are switched on.
    pub fn confirm_variables(&mut self, now: Instant) {
        self.confirmed = Some(now);
    }

    /// Takes what the bus thread reports. Gives the motors whose loop has opened.
    pub fn take(&mut self, status: BoardStatus) -> Motors {
        let opened = Motors::from_bits(status.open_loops & !self.status.open_loops);
        self.status = status;
        let board = &mut self.board;
        board.state = status.state;
        board.enabled = status.enabled.names();
        board.command_port = status.command_port;
        board.command_state = status.command_state;
        board.reply_end_missing = status.reply_end_missing;
        board.answers_otherwise = status.answers_otherwise;
        board.control_characters = status.control_characters;
        board.open_buffer = status.buffer.info();
        board.open_buffer_unsaid = status.buffer.is_unsaid;
        board.replay = status.replay.or(board.replay);
        board.waiting = status.uses.waiting().collect();
        board.definitions = status.definitions;
        board.program_words = status.uses.program_words(self.family).collect();
        if let Some(host_port) = &mut board.host_port {
            let HostPortCounts { served, old, unannounced } = status.host_port;
            (host_port.served, host_port.old, host_port.unannounced) = (served, old, unannounced);
        }
        if let Some(KnownIdentity { firmware, board_type, motors, servo_period_ns }) = status.identity {
            board.firmware = firmware.as_deref().map(str::to_owned);
            board.board_type = board_type.as_deref().map(str::to_owned);
            (board.motors, board.servo_period_ns) = (motors, servo_period_ns);
        }
        *self.pulse.board.lock().unwrap_or_else(PoisonError::into_inner) = board.clone();
        opened
    }
}

/// A thread that shows the first thread that it lives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WatchedThread {
    /// It owns the board.
    Bus,
    /// It serves the command socket: without it no stop reaches the board.
    Socket,
}

impl WatchedThread {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Bus, Self::Socket];

    /// As the log names it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Bus => "bus",
            Self::Socket => "socket's",
        }
    }
}

/// What the first thread tells the service manager of: the other threads' heartbeats, and the board.
#[derive(Debug, Default)]
pub struct Pulse {
    rounds: [AtomicU64; WatchedThread::ALL.len()],
    board: Mutex<BoardInfo>,
}

impl Pulse {
    /// `thread` has made another round. Never waits.
    pub fn count_round(&self, thread: WatchedThread) {
        self.rounds[thread as usize].fetch_add(1, Ordering::Relaxed);
    }

    /// Rounds of each of [`WatchedThread::ALL`] so far: while it lives, at least four a second.
    #[must_use]
    pub fn rounds(&self) -> [u64; WatchedThread::ALL.len()] {
        self.rounds.each_ref().map(|rounds| rounds.load(Ordering::Relaxed))
    }

    /// The board, as `GetInfo` answers. Not for the bus thread: it may wait for the socket's.
    #[must_use]
    pub fn board(&self) -> BoardInfo {
        self.board.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::shared::queue::queue;
    use crate::map::PMAC;
    use crate::protocol::{CommandState, State};

    #[test]
    fn what_changes_is_reported_once_and_read() {
        let (events, told) = queue(1).unwrap();
        let mut report = InfoReport::default();
        let board = BoardInfo {
            name: "pmac0".to_owned(),
            firmware: Some("1.16D".to_owned()),
            ..BoardInfo::default()
        };
        let mut info = Info::new(&PMAC, board, BoardSettings::default());
        let mut take = |report: &mut InfoReport| {
            report.poll(&events);
            let event = told.try_receive();
            if let Some(Event::Info(status)) = event {
                info.take(status);
            }
            (event.is_some(), info.board().clone(), info.pulse().board())
        };
        assert!(!take(&mut report).0, "nothing has changed");
        report.set(|status| {
            status.state = State::Live;
            status.enabled = Enabled::SERVO | Enabled::INTERRUPT;
            status.command_state = CommandState::Silent;
        });
        let (reported, board, seen) = take(&mut report);
        assert!(reported && board == seen);
        assert_eq!((board.state, board.command_state), (State::Live, CommandState::Silent));
        assert_eq!(
            (board.enabled, board.firmware.as_deref()),
            (vec!["servo".to_owned(), "interrupt".to_owned()], Some("1.16D"))
        );
        assert!(!take(&mut report).0, "it was told");
        report.set(|status| {
            let identity =
                KnownIdentity { firmware: None, board_type: None, motors: 4, servo_period_ns: Some(5) };
            status.identity = Some(identity);
        });
        assert!(events.try_send(Event::Info(BoardStatus::default())).is_ok());
        report.poll(&events);
        assert!(report.is_untold());
        told.try_receive();
        let (reported, board, _) = take(&mut report);
        assert!(reported && !report.is_untold(), "a full queue is tried again");
        assert_eq!((board.motors, board.servo_period_ns, board.firmware), (4, Some(5), None));
    }
}
