//! The one thread that owns the board. It waits for the time, for commands and for interrupts.
//!
//! No other thread touches the bus, so no lock guards the bus. Servo data come first: every other piece of work is
//! bounded and short, and before each piece the loop looks at the servo's due time ([`GuardTime`]). After start the
//! thread neither allocates nor logs in each round, and waits for no client. It reports each change once
//! ([`Reporter`]).
//!
//! Only the loop reacts: here, in `rounds` and in `life`. Its parts return their findings as values. They put answers
//! to commands into the queue to the socket.

mod life;
mod rounds;
mod virtual_time;

use std::os::fd::AsFd;
use std::sync::Arc;
use std::time::Instant;

use log::warn;
use nix::sys::eventfd::EventFd;

use self::rounds::Ahead;
use crate::clock::Clock;
use crate::daemon::bus::board::BoardBus;
use crate::daemon::bus::board_function::{Context, Polled};
use crate::daemon::bus::command_intake::CommandIntake;
use crate::daemon::bus::function_table::FunctionTable;
use crate::daemon::bus::guard_time::GuardTime;
use crate::daemon::bus::phase::LoopPhase;
use crate::daemon::bus::presence::BoardPresence;
use crate::daemon::bus::readable::{Descriptors, Readable};
use crate::daemon::bus::report::Reporter;
use crate::daemon::bus::waits::Waits;
use crate::daemon::config::board_settings::CheckedSettings;
use crate::daemon::shared::info::Pulse;
use crate::daemon::shared::queue::{Command, Event, Outcome, READ_MAX};
use crate::daemon::shared::status::MotorsStatus;
use crate::device::{Bus, BusError, Presence};
use crate::function::line_port::PortError;
use crate::map::{HostOffset, Motors, WholeBoard};
use crate::mirror::Transition;
use crate::protocol::{Function, State};
use crate::segment::{Counter, Publisher, RegionId, RegionState, Stamp};

/// How often the loop writes the segment's heartbeat, in the nearest round.
const HEARTBEAT_NS: u64 = 50_000_000;
/// How often the loop checks that the memory behind the bus is still the board's.
const BOARD_CHECK_NS: u64 = 1_000_000_000;
/// How long a board may take for its first sign of life before the daemon calls the board stale.
const FIRST_SIGN_NS: u64 = 1_000_000_000;
/// How long the loop leaves an unreachable bus alone.
const BUS_ERROR_PAUSE_NS: u64 = 10_000_000;
/// Commands taken from the queue in one round.
const COMMANDS_A_ROUND: usize = 4;
/// Rounds that one [`BoardLoop::poll`] does at most.
const ROUNDS_A_POLL: usize = 10_000;

/// The part of the configuration that describes the board.
pub struct Configured {
    /// The places of the board's buffers, which also depend on the firmware.
    pub settings: CheckedSettings,
    /// Number of motors to read until the board has told how many it reports.
    pub motors: usize,
}

/// The loop's links to other threads and processes.
pub struct Connections {
    /// The segment, as its writer.
    pub publisher: Publisher,
    /// Commands from the socket, and the answers to the socket.
    pub intake: CommandIntake,
    /// The loop's heartbeat, for the service manager.
    pub pulse: Arc<Pulse>,
    /// Becomes readable when the loop has to end.
    pub stop: Arc<EventFd>,
}

/// The bus thread.
pub struct BoardLoop {
    bus: BoardBus,
    presence: BoardPresence,
    functions: FunctionTable,
    configured: Configured,
    connections: Connections,
    reporter: Reporter,
    guard: GuardTime,
    clock: Clock,
    phase: LoopPhase,
    ahead: Ahead,
    /// The servo report's content at the last whole round.
    told: (MotorsStatus, Option<WholeBoard>),
    /// Short rounds have polled the servo report since then, without passing anything on.
    is_unseen: bool,
    began_ns: u64,
    heartbeat_due_ns: u64,
    check_due_ns: u64,
    /// The bus was out of reach: the loop leaves the bus alone until then.
    paused_until_ns: u64,
    waits: Waits,
}

impl BoardLoop {
    /// A loop over the `functions` of the board on `bus`. The loop does not touch the board before the first poll.
    #[must_use]
    pub fn new(
        bus: BoardBus,
        presence: BoardPresence,
        functions: FunctionTable,
        configured: Configured,
        connections: Connections,
    ) -> Self {
        let clock = functions.clock().clone();
        let reporter = Reporter::new(configured.settings.family(), clock.clone());
        Self {
            reporter: if bus.replay().is_some() { reporter.of_replay() } else { reporter },
            bus,
            presence,
            told: functions.servo_told(),
            functions,
            configured,
            connections,
            guard: GuardTime::default(),
            phase: LoopPhase::Begin,
            ahead: Ahead::NOW,
            is_unseen: false,
            began_ns: clock.ns(),
            heartbeat_due_ns: 0,
            check_due_ns: clock.ns(),
            paused_until_ns: 0,
            waits: Waits::default(),
            clock,
        }
    }

    /// Runs until the daemon stops the loop, then leaves the board with no bit of the host's set.
    pub fn run(mut self) {
        // By default the kernel adds up to 50 µs to every sleep.
        let _ = nix::sys::prctl::set_timerslack(1);
        if let Err(error) = self.waits.allow_sleeps(&self.connections.stop) {
            warn!(
                "no thread listens for interrupts ({error}): the bus thread polls instead, and uses more of the processor"
            );
        }
        let mut readable = Readable::default();
        loop {
            self.step(&readable);
            if self.phase == LoopPhase::Ended {
                return;
            }
            let now = self.clock.ns();
            readable = self.wait(now, self.due_ns(now));
        }
    }

    /// Does all work that is due now. Returns when the next work is due, in nanoseconds of the loop's clock: `u64::MAX`
    /// once the loop has ended. For a caller that drives the loop in place of [`BoardLoop::run`]. The caller calls
    /// again at the time returned, or when a command or an interrupt has come. Returns after `ROUNDS_A_POLL` rounds
    /// even if work is left.
    pub fn poll(&mut self) -> u64 {
        self.connections.publisher.set_now(self.clock.ns());
        for _ in 0..ROUNDS_A_POLL {
            let now = self.clock.ns();
            let readable = self.wait(now, now);
            self.step(&readable);
            let now = self.clock.ns();
            let due_ns = self.due_ns(now);
            if readable == Readable::default() && due_ns > now {
                return due_ns;
            }
        }
        self.clock.ns()
    }

    /// One round of the loop; `readable` names the descriptors that woke it.
    fn step(&mut self, readable: &Readable) {
        if readable.stop {
            self.stop();
        }
        match self.phase {
            LoopPhase::Begin => {
                self.write_page();
                self.phase = LoopPhase::reaching(self.clock.now());
                self.reach_dpram();
            }
            LoopPhase::Reaching { .. } => self.reach_dpram(),
            LoopPhase::Running => self.running(readable),
            LoopPhase::Stopping { until, .. } => self.finish_stops(until),
            LoopPhase::Ended => {}
        }
    }

    /// Tells the clients the changes; includes the counts only if `with_counts`.
    fn tell_clients(&mut self, with_counts: bool, now: Instant) {
        self.functions.tell(&mut self.reporter.status, with_counts, now);
        self.reporter.status.replay = self.bus.replay();
        self.reporter.send(self.connections.intake.events());
    }

    /// Whether the loop leaves the bus alone for a moment, after the bus was out of reach.
    fn is_paused(&self, now: u64) -> bool {
        now < self.paused_until_ns
    }

    /// The functions, and the context for their work.
    fn functions_in_context(&mut self) -> (&mut FunctionTable, Context<'_, BoardBus>) {
        let Self { functions, bus, connections: Connections { publisher, intake, .. }, clock, .. } = self;
        (functions, Context { bus, publisher, intake, clock })
    }

    /// Acts on the findings of a function's poll.
    fn react(&mut self, function: Function, polled: Polled) -> Result<(), PortError> {
        let Polled { transition, was_reset } = polled;
        match function {
            Function::Servo => {
                if let Some(transition) = transition {
                    self.reporter.data(function, transition, self.functions.servo.freshness.limit_ns());
                    if transition == Transition::Stale {
                        self.doubt_board();
                        let change = self.presence.check_answers(&mut self.bus);
                        change.map_or(Ok(()), |change| self.follow(change))?;
                    } else {
                        self.functions.ascii.queue.identifier.ask_again(self.clock.now());
                    }
                }
                self.see_servo();
                if was_reset {
                    self.reporter.reset();
                    self.after_reset(!self.presence.is_reset_known)?;
                }
                self.presence.servo_polled(self.functions.servo.is_live());
            }
            Function::Background => {
                if let Some(transition) = transition {
                    self.reporter.data(function, transition, self.functions.background.freshness.limit_ns());
                    if transition == Transition::Stale {
                        self.doubt_board();
                    }
                }
                self.functions.see_whole_board();
            }
            Function::Ascii => {
                let queue = &self.functions.ascii.queue;
                self.reporter.port(queue.ports.in_use(), queue.state());
                self.take_identity();
                self.take_pointers()?;
            }
            Function::Variables | Function::Gather | Function::Panel | Function::Rotary => {}
        }
        Ok(())
    }

    /// Passes on the content of the servo report, for all updates since the last call.
    fn see_servo(&mut self) {
        self.functions.see_whole_board();
        if let Some(motors) = self.functions.servo.reader.take_taken_out() {
            self.reporter.taken_out(motors);
        }
    }

    /// The board's data have stopped: the board may have been reset, or be gone.
    fn doubt_board(&mut self) {
        self.functions.ascii.queue.doubt(self.clock.now());
        self.write_page();
    }

    /// Publishes the board's new identity, and sets the functions and the buffer layout by it.
    fn take_identity(&mut self) {
        let identifier = &mut self.functions.ascii.queue.identifier;
        let on_request = identifier.on_request();
        let identity = identifier.take_update();
        self.functions.servo.set_on_request(on_request);
        let Some(identity) = identity else { return };
        if !self.reporter.is_new(&identity) {
            return;
        }
        let motors = identity.reported_motors().map_or(self.configured.motors, |motors| motors as usize);
        self.functions.servo.configure(
            identity.motor_mask.map_or(Motors::first(motors), Motors::from_bits),
            identity.servo_period_ps.map(|ps| ps / 1000),
            identity.servo_report_cycles,
        );
        self.functions.background.configure(motors);
        match self.configured.settings.layout_for(identity.firmware.as_deref()) {
            Ok(layout) => self.functions.set_layout(layout),
            Err(reason) => warn!("{reason}; the buffer layout for boards of unknown firmware stays in force"),
        }
        let stamp = Stamp { time_ns: self.clock.ns(), servo_timer: 0, valid: true };
        self.connections.publisher.publish_bytes(RegionId::Board, stamp, &identity.encode());
        self.connections.publisher.set_region_state(RegionId::Board, RegionState::Live);
        self.reporter.identity(identity, motors);
    }

    /// Begins to use the functions that the board reports as enabled, and those whose words the board's own programs
    /// leave free.
    fn take_pointers(&mut self) -> Result<(), PortError> {
        let now = self.clock.now();
        let enabling = self.functions.ascii.queue.identifier.enabling();
        let reports = self.reporter.reports();
        let enabled = [
            (Function::Servo, reports[0]),
            (Function::Background, reports[1]),
            (Function::Panel, enabling.panel == Some(true)),
            (Function::Variables, enabling.variables == Some(true)),
        ];
        let outcome = self.functions.ascii.queue.scan.take_outcome(now);
        let (functions, mut context) = self.functions_in_context();
        let enabled = enabled.into_iter().filter_map(|(function, is_on)| is_on.then_some(function));
        functions.begin(enabled, &mut context)?;
        if let Some(outcome) = outcome {
            functions.take_pointers(outcome, &mut context)?;
            self.reporter.pointers(outcome, self.functions.uses_of_all());
        }
        Ok(())
    }

    /// Whether work begun at `ns` might delay the servo data.
    fn is_servo_near(&self, ns: u64) -> bool {
        self.functions.servo.is_live() && self.guard.is_near(ns, self.functions.servo_due_ns())
    }

    /// Whether only the functions that watch the board go on: an answer finds no room in the queue to the socket, or no
    /// board answers on the bus.
    fn only_watches(&self) -> bool {
        self.connections.intake.is_held_up() || self.presence.is_silent
    }

    /// When work is due next, seen from `now`. No later than the next heartbeat can wait.
    fn due_ns(&self, now: u64) -> u64 {
        match self.phase {
            LoopPhase::Begin => 0,
            LoopPhase::Reaching { due_ns, .. } | LoopPhase::Stopping { due_ns, .. } => due_ns,
            LoopPhase::Ended => u64::MAX,
            LoopPhase::Running if self.is_paused(now) => self.paused_until_ns.min(self.heartbeat_due_ns),
            LoopPhase::Running => {
                let Ahead { due_ns, latest_ns } = self.ahead;
                // Work that would not fit before the servo data waits until after them, unless it starves.
                let servo = self.functions.servo_due_ns();
                let starving = self.guard.is_starving() && due_ns <= now;
                let waits = self.is_servo_near(due_ns.max(now)) && !starving;
                // One wake serves both, if the work can wait as long.
                if waits || servo <= latest_ns { servo } else { due_ns }
            }
        }
    }

    /// Waits from `now` until `due_ns`, or until a descriptor becomes readable.
    fn wait(&mut self, now: u64, due_ns: u64) -> Readable {
        let works = self.phase == LoopPhase::Running && !self.is_paused(now);
        let is_quiet = works && !self.is_asked();
        let stand_back = self.is_servo_near(now) && !self.guard.is_starving();
        let Connections { intake, stop, .. } = &self.connections;
        let descriptors = Descriptors {
            stop: stop.as_fd(),
            commands: if works && !stand_back { intake.descriptor() } else { None },
            interrupts: if works { self.functions.ascii.descriptors() } else { [None; 3] },
        };
        self.waits.wait(now, due_ns, is_quiet, &descriptors)
    }

    /// Whether commands wait, or the daemon has asked the board something.
    fn is_asked(&self) -> bool {
        self.connections.intake.has_waiting() || self.functions.ascii.queue.is_busy()
    }

    /// Takes the interrupts and commands that became `readable`.
    fn attend(&mut self, readable: &Readable, now: u64) {
        let now = self.clock.at(now);
        self.connections.intake.retry();
        let interrupts = self.functions.ascii.take_interrupts(readable, now);
        self.connections.publisher.counters().add(Counter::Interrupts, u64::from(interrupts));
        if readable.commands {
            self.take_commands(now);
        }
    }

    fn take_commands(&mut self, now: Instant) {
        // The socket wakes the loop once a command: leave the wake set while commands may be left.
        self.connections.intake.clear();
        let starving = self.guard.is_starving();
        for taken in 0..COMMANDS_A_ROUND {
            // A client may ask for many words: on a slow bus reading them could cost the next servo update.
            let stand_back = (taken > 0 || !starving) && self.is_servo_near(self.clock.ns());
            if self.connections.intake.is_held_up() || stand_back {
                break;
            }
            let Some(command) = self.connections.intake.take() else { return };
            if let Some(event) = self.carry_out(command, now) {
                self.connections.intake.answer(event);
            }
        }
        self.connections.intake.keep_awake();
    }

    /// Carries out a command, or puts it into the queue of its function. Returns the answer if the answer is known
    /// already.
    fn carry_out(&mut self, command: Command, now: Instant) -> Option<Event> {
        match command {
            Command::ReadWords { ticket, first, count } => {
                self.guard.others_had_turn();
                Some(match self.read_words(first, count) {
                    Ok((time_ns, words)) => Event::Words { ticket, time_ns, words, count },
                    Err(BusError::OutOfRange { .. }) => Event::Done(ticket, Outcome::OutOfRange),
                })
            }
            Command::Job { ticket, job, deadline } => {
                let (functions, mut context) = self.functions_in_context();
                match functions.submit(&mut context, ticket, *job, deadline) {
                    Ok(answer) => answer,
                    Err(error) => {
                        self.bus_failed(&error);
                        // The daemon may have written a part of the job before the bus failed.
                        Some(Event::Done(ticket, Outcome::TimedOut))
                    }
                }
            }
            Command::Send { .. } | Command::First { .. } | Command::Control { .. } => {
                if let Command::Control { uid, character, .. } = command
                    && let Err(error) = self.functions.make_way(&mut self.bus, uid, character, now)
                {
                    self.bus_failed(&error);
                }
                self.functions.ascii.queue.submit(&command, now);
                None
            }
        }
    }

    fn read_words(&mut self, first: HostOffset, count: usize) -> Result<(u64, [u16; READ_MAX]), BusError> {
        let mut words = [0; READ_MAX];
        let time_ns = self.clock.ns();
        self.bus.read_block(first, &mut words[..count.min(READ_MAX)])?;
        Ok((time_ns, words))
    }

    /// The heartbeat: clients must see it even when no data come.
    fn beat(&mut self, now: u64) {
        self.connections.publisher.move_if_asked();
        self.connections.publisher.counters().set(Counter::BusAccesses, self.bus.accesses());
        self.connections.publisher.beat(now);
        // A function that waits has had no time yet to show life.
        let waits = self.functions.uses_of_all().waiting().next().is_some();
        let may_begin = waits || now < self.began_ns + FIRST_SIGN_NS;
        if let Some(state) = self.reporter.board(self.shows_life(), may_begin) {
            self.connections.publisher.set_state(state);
        }
        if self.reporter.status.state != State::Init {
            let result = self.check_page();
            self.note_failure(result);
        }
    }

    /// Whether the board shows life, as far as the functions in use can tell.
    fn shows_life(&self) -> bool {
        let is_over = self.bus.replay().is_some_and(|replay| replay.over);
        !is_over && self.functions.is_live::<BoardBus>().unwrap_or(self.presence.is_there())
    }

    fn note_failure(&mut self, result: Result<(), PortError>) {
        if let Err(error) = result {
            self.bus_failed(&error);
        }
    }

    fn bus_failed(&mut self, error: &dyn std::fmt::Display) {
        self.connections.publisher.counters().add(Counter::BusErrors, 1);
        self.reporter.bus_error(error);
        self.paused_until_ns = self.clock.ns() + BUS_ERROR_PAUSE_NS;
    }
}
