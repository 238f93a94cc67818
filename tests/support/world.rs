//! A simulated board and a daemon in one thread, in time that the test moves.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use clap::Parser;
use pmac_dpram::clock::ManualTime;
use pmac_dpram::daemon::bus::board_loop::BoardLoop;
use pmac_dpram::daemon::config::settings::Settings;
use pmac_dpram::daemon::exit::Failure;
use pmac_dpram::daemon::machine::Machine;
use pmac_dpram::daemon::options::Options;
use pmac_dpram::daemon::parts::{Parts, segment_options};
use pmac_dpram::daemon::recognise;
use pmac_dpram::daemon::socket::options::ServeOptions;
use pmac_dpram::daemon::socket::server::stepper::ServerStepper;
use pmac_dpram::device::{BoardSpec, Inherited, Trace};
use pmac_dpram::segment::Publisher;
use pmac_dpram::sim;
use pmac_dpram::sim::process::Simulator;

/// The world's start time, in nanoseconds, so that no daemon meets a time before its start.
const BEGIN_NS: u64 = 1_000_000_000_000;
/// The length of a step without a board, whose servo cycle sets it otherwise.
const STEP: Duration = Duration::from_micros(500);
/// The same with a replay, which is to be polled more than once an update.
const REPLAY_STEP: Duration = Duration::from_micros(50);
/// Time between polls of the simulator's sockets, as in `pmac-sim`.
const SOCKETS_EVERY_NS: u64 = 1_000_000;
/// The daemon's time limit for ending.
const LAST: Duration = Duration::from_secs(10);

/// So many bus accesses that a client has not taken yet are one reply's, a small part of what the daemon has room for.
const UNTAKEN: u64 = 4096;

/// The daemon's parts: the bus thread's and the command socket's.
pub struct Daemon {
    pub board_loop: BoardLoop,
    pub server: ServerStepper,
    trace: Arc<Trace>,
}

/// The board, the daemon, and their time.
pub struct World {
    time: ManualTime,
    pub simulator: Option<Simulator>,
    pub daemon: Option<Daemon>,
    /// The board does not execute, as if its process were stopped.
    pub board_stands_still: bool,
    /// The daemon does not execute, as if its process were stopped.
    pub daemon_stands_still: bool,
    sockets_due_ns: u64,
    /// The board is a replay.
    replays: bool,
}

/// Whether a configuration says something of the questions where M-variables point.
fn names_the_questions(config: &Path) -> bool {
    std::fs::read_to_string(config).is_ok_and(|text| text.contains("ask_m_variables"))
}

impl World {
    pub fn new() -> Self {
        Self {
            time: ManualTime::at(BEGIN_NS),
            simulator: None,
            daemon: None,
            board_stands_still: false,
            daemon_stands_still: false,
            sockets_due_ns: 0,
            replays: false,
        }
    }

    pub fn now(&self) -> Instant {
        self.time.clock().now()
    }

    pub fn now_ns(&self) -> u64 {
        self.time.ns()
    }

    /// The length of the next step.
    pub fn period(&self) -> Duration {
        let step = if self.replays { REPLAY_STEP } else { STEP };
        self.simulator.as_ref().map_or(step, Simulator::period)
    }

    /// Starts the simulator with the options of `pmac-sim`.
    pub fn start_simulator(&mut self, options: &[String]) {
        let options = std::iter::once("pmac-sim".to_owned()).chain(options.iter().cloned());
        let options = sim::process::options::Options::try_parse_from(options).unwrap();
        self.simulator = Some(Simulator::stepped(&options).unwrap());
    }

    /// Starts a daemon with the options of `pmacd`. Returns its error if it refuses to start.
    pub fn start_daemon(&mut self, options: &[String]) -> Result<(), String> {
        let options = std::iter::once("pmacd".to_owned()).chain(options.iter().cloned());
        let options = Options::try_parse_from(options).map_err(|error| error.to_string())?;
        let mut settings = Settings::decide(&options).map_err(|error| error.to_string())?;
        // A thousand questions more: what is not about them goes without.
        settings.ask_m_variables &= options.config.as_deref().is_some_and(names_the_questions);
        self.replays = matches!(settings.board, BoardSpec::Replay { .. });
        let failed = |failure: Failure| failure.to_string();
        let settings = self.look(settings, &options).map_err(failed)?;
        let segment = segment_options(&settings, &self.time.clock()).map_err(failed)?;
        let publisher = Publisher::create(&segment).map_err(|error| error.to_string())?;
        let machine = Machine::open(&settings, &Inherited::default(), &self.time.clock()).map_err(failed)?;
        let parts =
            Parts::new(&settings, machine, publisher, self.time.clock(), Arc::default()).map_err(failed)?;
        let serve_options = ServeOptions {
            mode: settings.socket_mode,
            group: settings.socket_group.clone(),
            roles: settings.roles.clone(),
            stop_all_after: settings.stop_all_after,
            ..ServeOptions::new(settings.socket.clone().unwrap())
        };
        let listener = serve_options.listen().map_err(|error| error.to_string())?;
        let trace = Arc::clone(&parts.backend.trace);
        let server =
            ServerStepper::new(&serve_options, listener, parts.backend).map_err(|error| error.to_string())?;
        self.daemon = Some(Daemon { board_loop: parts.board_loop, server, trace });
        self.poll();
        Ok(())
    }

    /// What the daemon does before it starts: it looks at the board, while that works.
    fn look(&mut self, settings: Settings, options: &Options) -> Result<Settings, Failure> {
        recognise::settled(settings, options, &Inherited::default(), || {
            let end = self.now() + recognise::PAUSE;
            while self.now() < end {
                self.step();
            }
            self.time.ns()
        })
    }

    /// Runs one servo cycle of the board, and everything that the daemon does meanwhile.
    pub fn step(&mut self) {
        let end = self.time.ns() + u64::try_from(self.period().as_nanos()).unwrap();
        if !self.board_stands_still
            && let Some(simulator) = &mut self.simulator
        {
            simulator.step();
            if end >= self.sockets_due_ns {
                self.sockets_due_ns = end + SOCKETS_EVERY_NS;
                simulator.poll();
            }
        }
        if let Some(daemon) = self.daemon.as_mut().filter(|_| !self.daemon_stands_still) {
            loop {
                let due = daemon.board_loop.poll();
                if due <= self.time.ns() || due >= end {
                    break;
                }
                self.time.move_to(due);
            }
            self.time.move_to(end);
            daemon.server.round(self.time.clock().now()).unwrap();
        }
        self.time.move_to(end);
    }

    /// Does what is due now, without letting time pass.
    pub fn poll(&mut self) {
        if !self.board_stands_still
            && let Some(simulator) = &mut self.simulator
        {
            simulator.poll();
        }
        if let Some(daemon) = self.daemon.as_mut().filter(|_| !self.daemon_stands_still) {
            daemon.board_loop.poll();
            daemon.server.round(self.time.clock().now()).unwrap();
        }
    }

    /// Lets `time` pass.
    pub fn run_for(&mut self, time: Duration) {
        let end = self.now() + time;
        while self.now() < end {
            self.step();
        }
    }

    /// Whether a client waits for an action of the board.
    pub fn is_waited_for(&self) -> bool {
        self.daemon.as_ref().is_some_and(|daemon| daemon.server.waits_for_board())
    }

    /// Whether a client that traces the bus accesses has many to take, and waits for nothing else.
    pub fn waits_for_trace_reader(&self) -> bool {
        let is_behind = self.daemon.as_ref().is_some_and(|daemon| daemon.trace.waiting() > UNTAKEN);
        is_behind && !self.is_waited_for()
    }

    /// Whether the next step stops a held jog or ends a sequence, unless its owner renews it before.
    pub fn is_lease_over(&self) -> bool {
        let end = self.daemon.as_ref().and_then(|daemon| daemon.server.first_hold_end());
        end.is_some_and(|end| end <= self.now() + 2 * self.period())
    }

    fn is_ending(&mut self, begun: Instant) -> bool {
        let now = self.now();
        self.daemon.as_mut().is_some_and(|daemon| daemon.server.is_ending(begun, now))
    }

    /// Stops the daemon gracefully. The motors that may still move, as it says.
    pub fn stop_daemon(&mut self) -> u32 {
        let begun = self.now();
        let latest = begun + LAST;
        if let Some(daemon) = &mut self.daemon {
            daemon.server.begin_end(begun);
        }
        while self.is_ending(begun) {
            self.step();
        }
        let Some(Daemon { mut board_loop, server, .. }) = self.daemon.take() else { return 0 };
        let may_move = server.end(self.now());
        board_loop.stop();
        while board_loop.poll() != u64::MAX {
            assert!(self.now() < latest, "the daemon does not end");
            self.step();
        }
        may_move.bits()
    }
}
