//! The daemon's knowledge of the board. The bus thread reports it by events, the socket's thread answers `GetInfo` from
//! it, and the first thread shows it to the service manager.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::function_use::FunctionState;
use super::origin::GivenUp;
use super::status::{BoardStatus, Enabling, KnownIdentity};
use crate::function::servo::Motion;
use crate::map::{Family, Function, Motors, Systems};
use crate::protocol::board::{Elsewhere, Replay};
use crate::protocol::program_words::waits_for;
use crate::protocol::{BoardInfo, BoardSettings, Enabled, State};
use crate::recording::Replies;

/// How long the board answers no command line before the daemon tells the clients: a single line may be slow.
const SILENT: Duration = Duration::from_secs(2);

/// The socket's side: the daemon's present knowledge of its board, and its settings.
#[derive(Debug)]
pub struct Info {
    family: &'static Family,
    board: BoardInfo,
    settings: BoardSettings,
    status: BoardStatus,
    /// When the board told, for a client's question, that background variables are switched on.
    confirmed: Option<Instant>,
    pulse: Arc<Pulse>,
    /// The recording's replies, in a replay.
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

    /// The same for a replay, whose recording answers `replies`.
    #[must_use]
    pub fn of_replay(mut self, replies: Arc<Replies>) -> Self {
        self.board.replay = Some(Replay::default());
        self.replies = Some(replies);
        self
    }

    /// The recording's replies, in a replay.
    #[must_use]
    pub fn replies(&self) -> Option<&Replies> {
        self.replies.as_deref()
    }

    /// The first thread's view.
    #[must_use]
    pub fn pulse(&self) -> Arc<Pulse> {
        Arc::clone(&self.pulse)
    }

    /// The answer to `GetInfo`.
    #[must_use]
    pub fn board(&self) -> &BoardInfo {
        &self.board
    }

    /// The board's family.
    #[must_use]
    pub fn family(&self) -> &'static Family {
        self.family
    }

    /// The answer to `GetSettings`.
    #[must_use]
    pub fn settings(&self) -> &BoardSettings {
        &self.settings
    }

    /// Why the daemon cannot use `function` now, if it cannot.
    #[must_use]
    pub fn why_not(&self, function: Function) -> Option<String> {
        let functions = &self.settings.functions;
        if !functions.has(function) {
            return Some(functions.why_not(function, self.family));
        }
        match self.status.uses.of(function) {
            FunctionState::Off | FunctionState::On => None,
            FunctionState::Waits => Some(format!(
                "the function `{}` is not used yet: {}",
                function.name(),
                waits_for(self.status.lines.buffer.is_open, &self.status.lines.info.definitions)
            )),
            FunctionState::Held => {
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
        self.status.motors.loops_left_open
    }

    /// The motors of whose loops the daemon knows nothing yet.
    #[must_use]
    pub fn loops_untold(&self) -> Motors {
        self.status.motors.loops_untold
    }

    /// The command that holds the port for command lines: a given-up command, or a slow line.
    #[must_use]
    pub fn holds_port(&self) -> Option<GivenUp> {
        self.status.lines.holds_port
    }

    /// Which motors move.
    #[must_use]
    pub fn motion(&self) -> Motion {
        self.status.motors.motion
    }

    /// The coordinate systems that run a motion program; `None` while no report tells of all.
    #[must_use]
    pub fn programs_run(&self) -> Option<Systems> {
        self.status.programs_run
    }

    /// Whether the board gathers; `None` while no report tells.
    #[must_use]
    pub fn gathers(&self) -> Option<bool> {
        self.status.gathers
    }

    /// The work of other senders on the board by `now`, and their changes there. `gathers`: the daemon's own gather
    /// runs.
    #[must_use]
    pub fn elsewhere(&self, gathers: bool, now: Instant) -> Vec<Elsewhere> {
        let ago_ms = |since: Instant| u64::try_from(now.saturating_duration_since(since).as_millis()).ok();
        let changes = self.status.lines.changes.iter().flatten();
        let mut all: Vec<Elsewhere> = changes
            .map(|change| Elsewhere {
                what: format!("I{}", change.variable),
                was: Some(change.was.into()),
                is: Some(change.is.into()),
                ago_ms: ago_ms(change.since),
            })
            .collect();
        let plain = |what: &str| Elsewhere { what: what.to_owned(), was: None, is: None, ago_ms: None };
        if self.status.lines.buffer.is_open && self.status.lines.buffer.opened.is_none() {
            all.push(plain("program_buffer"));
        }
        if self.gathers() == Some(true) && !gathers {
            all.push(plain("gather"));
        }
        let silent = self.status.lines.silent_since.filter(|since| now >= *since + SILENT);
        if let Some(since) = silent.filter(|_| self.status.state == State::Live) {
            all.push(Elsewhere { ago_ms: ago_ms(since), ..plain("command_lines") });
        }
        all
    }

    /// The board's I-variables that switch functions on.
    #[must_use]
    pub fn enabling(&self) -> Enabling {
        let Enabling { asked, .. } = self.status.lines.enabling;
        Enabling { asked: asked.max(self.confirmed), ..self.status.lines.enabling }
    }

    /// The board has said at `now` that background variables are switched on.
    pub fn confirm_variables(&mut self, now: Instant) {
        self.confirmed = Some(now);
    }

    /// Takes the bus thread's report. Returns the motors whose loop has opened.
    pub fn take(&mut self, status: BoardStatus) -> Motors {
        let opened = status.motors.open_loops.without(self.status.motors.open_loops);
        self.status = status;
        let board = &mut self.board;
        board.state = status.state;
        board.enabled = status.enabled.names();
        board.lines = status.lines.info;
        board.open_buffer = status.lines.buffer.info();
        board.replay = status.replay.or(board.replay);
        board.waiting = status.uses.waiting().collect();
        board.program_words = status.uses.program_words(self.family).collect();
        if let Some(host_port) = &mut board.host_port {
            host_port.counts = status.host_port;
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

/// A thread that reports its life to the first thread.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WatchedThread {
    /// The bus thread, which owns the board.
    Bus,
    /// The socket's thread: without it no stop reaches the board.
    Socket,
}

impl WatchedThread {
    /// All watched threads.
    pub const ALL: [Self; 2] = [Self::Bus, Self::Socket];

    /// The thread's name in the log.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Bus => "bus",
            Self::Socket => "socket's",
        }
    }
}

/// The first thread's knowledge for the service manager: the other threads' heartbeats, and the board.
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

    /// The rounds of each of [`WatchedThread::ALL`] so far: a living thread makes at least four a second.
    #[must_use]
    pub fn rounds(&self) -> [u64; WatchedThread::ALL.len()] {
        self.rounds.each_ref().map(|rounds| rounds.load(Ordering::Relaxed))
    }

    /// The board, as `GetInfo` answers. The bus thread must not call this: it could then wait for the socket's thread.
    #[must_use]
    pub fn board(&self) -> BoardInfo {
        self.board.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}
