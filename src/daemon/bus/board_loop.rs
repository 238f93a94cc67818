//! The one thread that owns the board: one poll over timer, interrupt and command queue.
//!
//! Nobody else touches the bus, so no lock guards it. Servo data come first: every other piece of work is bounded and
//! short, and before each the servo's due time is looked at. After start the thread neither allocates per pass nor
//! logs per pass nor waits for a client; it says when something changes, once.

use std::os::fd::{AsFd, BorrowedFd};
use std::sync::Arc;
use std::time::{Duration, Instant};

use log::{error, info, warn};
use nix::poll::{PollFd, PollFlags, ppoll};
use nix::sys::eventfd::EventFd;
use nix::sys::time::TimeSpec;

use crate::clock::Clock;
use crate::daemon::bus::board::{BoardBus, OpenBus};
use crate::daemon::bus::board_function::{Context, Polled};
use crate::daemon::bus::function_table::FunctionTable;
use crate::daemon::bus::guard_time::Room;
use crate::daemon::bus::identify::Identifier;
use crate::daemon::bus::phase::Phase;
use crate::daemon::bus::ports::command_port::PortError;
use crate::daemon::bus::ports::interrupt::InterruptLink;
use crate::daemon::bus::ports::mailbox::MailboxLink;
use crate::daemon::bus::presence::Condition;
use crate::daemon::bus::report::Told;
use crate::daemon::config::board_settings::Uncertain;
use crate::daemon::shared::info::{InfoReport, Pulse};
use crate::daemon::shared::queue::{Command, Event, Outcome, READ_MAX, Receive, Sender};
use crate::device::{Bus, BusError};
use crate::map::HostOffset;
use crate::protocol::Function;
use crate::segment::{Counter, Publisher, State};

/// How often the segment's heartbeat is written.
const HEARTBEAT_NS: u64 = 50_000_000;
/// How often the memory behind the bus is checked to be still the board's.
const BOARD_CHECK_NS: u64 = 1_000_000_000;
/// How long a board may take to give its first sign of life before it is called stale.
const FIRST_SIGN_NS: u64 = 1_000_000_000;
/// Rounds in a row that the servo may take while other work is due.
const STARVING_ROUNDS: u32 = 8;
/// How long an unreachable bus is left alone.
const BUS_ERROR_PAUSE_NS: u64 = 10_000_000;
/// Commands taken from the queue in one round.
const COMMANDS_A_ROUND: usize = 4;
/// Pieces of work that one [`BoardLoop::poll`] does at most.
const STEPS_A_POLL: usize = 10_000;

/// Everything the thread works with.
pub struct BoardLoop {
    /// The board.
    pub bus: BoardBus,
    /// Opens it again when its memory was replaced.
    pub open: OpenBus,
    /// Its automatic functions.
    pub functions: FunctionTable,
    /// Where their buffers lie, which the firmware has a say in.
    pub uncertain: Uncertain,
    /// The board's interrupt, if it has one.
    pub interrupt: Option<InterruptLink>,
    /// The segment.
    pub publisher: Publisher,
    /// From the socket.
    pub commands: Receive<Command>,
    /// To the socket.
    pub events: Sender<Event>,
    /// What the socket's thread is told of the board.
    pub info: InfoReport,
    /// Its heartbeat.
    pub pulse: Arc<Pulse>,
    /// Readable when the thread shall end.
    pub stop: Arc<EventFd>,
    /// Motors to read while the board has not said how many it reports.
    pub default_motors: usize,
    /// An answer the socket's queue had no room for; no command is taken and no job goes on until it is gone.
    pub answer: Option<Event>,
    /// The time.
    pub clock: Clock,
    /// When it began.
    pub began_ns: u64,
    /// Between start and end.
    pub phase: Phase,
    /// When the segment's heartbeat is due.
    pub heartbeat_due_ns: u64,
    /// When the board is to be checked.
    pub check_due_ns: u64,
    /// The bus could not be reached, and is left alone until then.
    pub paused_until_ns: u64,
    /// Rounds in a row that went to the servo.
    pub rounds_for_servo: u32,
    /// What is left free before servo updates.
    pub room: Room,
    /// Whether the board is there, as far as was seen.
    pub condition: Condition,
    /// What is to be said when it changes.
    pub told: Told,
}

/// Which descriptors became readable.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Readable {
    stop: bool,
    commands: bool,
    interrupt: bool,
    /// One of the mailboxes' interrupts.
    mailbox: bool,
}

impl BoardLoop {
    /// Runs until told to stop, then leaves the board as it should be left: no bit of the host's set.
    pub fn run(mut self) {
        // Without it the kernel adds up to 50 µs to every sleep.
        let _ = nix::sys::prctl::set_timerslack(1);
        let mut readable = Readable::default();
        loop {
            self.step(&readable);
            if self.phase == Phase::Ended {
                return;
            }
            let due_ns = self.due_ns();
            readable = self.wait(Duration::from_nanos(due_ns.saturating_sub(self.clock.ns())));
        }
    }

    /// Does everything that is due now, and returns when something is due next, in nanoseconds of the loop's clock:
    /// `u64::MAX` when it has ended. For whoever drives the loop instead of [`BoardLoop::run`]; to be called again then, or
    /// when a command or an interrupt has come. Where what is due does not end, it returns after so much of it.
    pub fn poll(&mut self) -> u64 {
        self.publisher.set_now(self.clock.ns());
        for _ in 0..STEPS_A_POLL {
            let readable = self.wait(Duration::ZERO);
            self.step(&readable);
            let due_ns = self.due_ns();
            if readable == Readable::default() && due_ns > self.clock.ns() {
                return due_ns;
            }
        }
        self.clock.ns()
    }

    /// One piece of work, after what became readable.
    fn step(&mut self, readable: &Readable) {
        if readable.stop {
            self.stop();
        }
        match self.phase {
            Phase::Begin => {
                self.page_again();
                self.phase = Phase::reaching(self.clock.now());
                self.reach_dpram();
            }
            Phase::Reaching { .. } => self.reach_dpram(),
            Phase::Running => self.running(readable),
            Phase::Stopping { until, .. } => self.finish_stops(until),
            Phase::Ended => {}
        }
    }

    fn running(&mut self, readable: &Readable) {
        if !self.is_paused() {
            self.attend(readable);
            self.pulse.count_round();
            if let Err(error) = self.one_round() {
                self.bus_failed(&error);
            }
        }
        let now = self.clock.ns();
        // Who waits for the board to be live shall not have to wait for the next beat.
        let beats = now >= self.heartbeat_due_ns;
        if beats || self.shows_life() && self.told.state != Some(State::Live) {
            self.heartbeat_due_ns = now + HEARTBEAT_NS;
            self.beat(now);
        }
        if now >= self.check_due_ns {
            self.check_due_ns = now + BOARD_CHECK_NS;
            self.check_board();
        }
        let enabling = self.functions.ascii.desk.identifier.enabling();
        self.info.set(|status| status.enabling = enabling);
        self.info.poll(&self.events, beats);
    }

    /// Whether the bus is left alone for a moment, because it could not be reached.
    fn is_paused(&self) -> bool {
        self.clock.ns() < self.paused_until_ns
    }

    /// The most urgent piece of work that is due: servo data, else what has waited longest.
    fn one_round(&mut self) -> Result<(), PortError> {
        let now = self.clock.ns();
        let work = self.next_work().filter(|(due_ns, _)| *due_ns <= now);
        let servo_due = now >= self.functions.servo_due_ns();
        // On a slow bus, or at a high servo rate, there may never be room. What stops a machine goes out all the same.
        let starving = self.rounds_for_servo >= STARVING_ROUNDS && work.is_some();
        if (servo_due || self.has_no_room(now)) && !starving {
            if servo_due {
                self.rounds_for_servo += 1;
                self.poll_function(Function::Servo)?;
            }
            return Ok(());
        }
        self.rounds_for_servo = 0;
        let Some((_, function)) = work else { return Ok(()) };
        if function == Function::Ascii && self.condition.out_of_reach {
            // Nothing is begun in words that are still to be put in order.
            self.guard_page()?;
        }
        let (accesses, began_ns) = (self.bus.accesses(), self.clock.ns());
        self.poll_function(function)?;
        let took = Duration::from_nanos(self.clock.ns().saturating_sub(began_ns));
        self.room.took(self.bus.accesses() - accesses, took);
        Ok(())
    }

    fn poll_function(&mut self, function: Function) -> Result<(), PortError> {
        let accesses = self.bus.accesses();
        let (functions, mut context) = self.functions_in_context();
        let polled = functions.poll(function, &mut context)?;
        if let Some(counter) = functions.counter::<BoardBus>(function) {
            self.count(counter, accesses);
        }
        self.react(function, polled)
    }

    /// The functions, and what they work with.
    pub(in crate::daemon) fn functions_in_context(&mut self) -> (&mut FunctionTable, Context<'_, BoardBus>) {
        let Self { functions, bus, publisher, events, clock, .. } = self;
        (functions, Context { bus, publisher, events, clock })
    }

    /// What follows from what a function found.
    fn react(&mut self, function: Function, polled: Polled) -> Result<(), PortError> {
        let Polled { answer, transition, was_reset } = polled;
        if let Some(event) = answer {
            self.reply(event);
        }
        match function {
            Function::Servo => {
                self.tell_servo(transition);
                let open = self.functions.servo.program_buffer_open();
                self.functions.ascii.desk.see_buffer(open);
                if was_reset {
                    info!("the board was reset, or its memory cleared");
                    self.after_reset(!self.condition.reset_known)?;
                }
                self.condition.reset_known &= !self.functions.servo.is_live();
            }
            Function::Background => self.tell_background(transition),
            Function::Ascii => {
                if let Some(host_port) = &self.functions.ascii.host_port {
                    let counts = host_port.counts();
                    self.info.set(|status| status.host_port = counts);
                }
                self.tell_port();
                self.take_identity();
            }
            Function::Variables | Function::Gather | Function::Panel | Function::Rotary => {}
        }
        Ok(())
    }

    /// Whether what is begun at `ns` might delay the servo data.
    fn has_no_room(&self, ns: u64) -> bool {
        self.functions.servo.is_live() && ns.saturating_add(self.room.ns()) > self.functions.servo_due_ns()
    }

    /// Of the work that can wait for the servo, that which is due first, and when. While an answer finds no room, and while
    /// what would be read is no board's, only what watches the board goes on.
    fn next_work(&self) -> Option<(u64, Function)> {
        self.functions.next::<BoardBus>(self.answer.is_some() || self.condition.silent)
    }

    /// Adds the accesses made since there were `before` of them.
    fn count(&self, counter: Counter, before: u64) {
        self.publisher.counters().add(counter, self.bus.accesses() - before);
    }

    /// When something is due next. Never later than the next heartbeat.
    fn due_ns(&self) -> u64 {
        match self.phase {
            Phase::Begin => 0,
            Phase::Reaching { due_ns, .. } | Phase::Stopping { due_ns, .. } => due_ns,
            Phase::Ended => u64::MAX,
            Phase::Running if self.is_paused() => self.paused_until_ns.min(self.heartbeat_due_ns),
            Phase::Running => {
                let others = self.next_work().map_or(u64::MAX, |(due_ns, _)| due_ns);
                // Work that would not fit before the servo data waits until after them, unless it starves.
                let (servo, now) = (self.functions.servo_due_ns(), self.clock.ns());
                let starving = self.rounds_for_servo >= STARVING_ROUNDS && others <= now;
                let waits = self.has_no_room(others.max(now)) && !starving;
                let due = if waits { servo } else { servo.min(others) };
                due.min(self.heartbeat_due_ns)
            }
        }
    }

    /// Waits so long, or until there is something to read.
    fn wait(&self, timeout: Duration) -> Readable {
        let works = self.phase == Phase::Running && !self.is_paused();
        let commands_wait = self.has_no_room(self.clock.ns()) && self.rounds_for_servo < STARVING_ROUNDS;
        fn watched(fd: BorrowedFd<'_>) -> PollFd<'_> {
            PollFd::new(fd, PollFlags::POLLIN)
        }
        let interrupt = self.interrupt.as_ref().filter(|_| works).and_then(InterruptLink::descriptor);
        let stop = self.stop.as_fd();
        let commands = (works && self.answer.is_none() && !commands_wait).then(|| self.commands.descriptor());
        // A place without a descriptor of its own watches the first one again, which is harmless.
        let mailbox = self.functions.ascii.desk.port().mailbox.as_ref().filter(|_| works);
        let [taken, reply] = mailbox.map_or([None, None], MailboxLink::descriptors);
        let mut watched =
            [Some(stop), commands, interrupt, taken, reply].map(|fd| watched(fd.unwrap_or(stop)));
        if ppoll(&mut watched, Some(TimeSpec::from_duration(timeout)), None).is_err() {
            // A signal, or no memory: the next round looks again.
            return Readable::default();
        }
        let [stop, second, third, fourth, fifth] = watched.map(|fd| fd.any().unwrap_or(false));
        Readable {
            stop,
            commands: second && commands.is_some(),
            interrupt: third && interrupt.is_some(),
            mailbox: fourth && taken.is_some() || fifth && reply.is_some(),
        }
    }

    /// Takes what became readable.
    fn attend(&mut self, readable: &Readable) {
        let now = self.clock.now();
        if let Some(answer) = self.answer.take() {
            self.reply(answer);
        }
        if readable.interrupt
            && let Some(link) = &mut self.interrupt
        {
            let taken = link.take(now);
            self.publisher.counters().add(Counter::Interrupts, u64::from(taken.interrupts));
            if let Some(host_port) = self.functions.ascii.host_port.as_mut().filter(|_| taken.interrupts > 0)
            {
                host_port.interrupted(self.functions.ascii.desk.port().responses());
            }
            self.functions.ascii.desk.look_now(now);
        }
        self.attend_mailbox(readable.mailbox, now);
        if let Some(link) = &mut self.interrupt {
            link.tend(now);
            let connected = link.is_connected();
            if connected != self.told.interrupt {
                self.told.interrupt = connected;
                self.tell_interrupt();
            }
        }
        if readable.commands {
            self.take_commands(now);
        }
    }

    fn take_commands(&mut self, now: Instant) {
        // The socket wakes once a command: leave the wake set while some may be left.
        self.commands.clear();
        let starving = self.rounds_for_servo >= STARVING_ROUNDS;
        for taken in 0..COMMANDS_A_ROUND {
            // Many words may be asked for: on a slow bus reading them could cost the next servo update.
            let no_room = (taken > 0 || !starving) && self.has_no_room(self.clock.ns());
            if self.answer.is_some() || no_room {
                break;
            }
            let Some(command) = self.commands.try_receive() else { return };
            match command {
                Command::ReadWords { ticket, first, count } => {
                    let event = match self.read_words(first, count) {
                        Ok((time_ns, words)) => Event::Words { ticket, time_ns, words, count },
                        Err(BusError::OutOfRange { .. }) => Event::Done(ticket, Outcome::OutOfRange),
                    };
                    self.reply(event);
                }
                Command::Job { ticket, job, deadline } => {
                    match self.functions.submit(&mut self.bus, &self.publisher, ticket, *job, deadline) {
                        Ok(None) => {}
                        Ok(Some(event)) => self.reply(event),
                        Err(error) => {
                            self.bus_failed(&error);
                            self.reply(Event::Done(ticket, Outcome::Unavailable));
                        }
                    }
                }
                Command::Send { line, .. } if Identifier::may_be_changed_by(line.as_bytes()) => {
                    self.functions.ascii.desk.identifier.ask_again(now);
                    self.functions.ascii.desk.submit(&command, now);
                }
                Command::Send { .. } | Command::Control { .. } => {
                    self.functions.ascii.desk.submit(&command, now)
                }
            }
        }
        self.commands.keep_awake();
    }

    /// Answers the socket, or keeps the answer until there is room.
    fn reply(&mut self, event: Event) {
        self.answer = self.events.try_send(event).err();
    }

    fn read_words(&mut self, first: HostOffset, count: usize) -> Result<(u64, [u16; READ_MAX]), BusError> {
        let mut words = [0; READ_MAX];
        let time_ns = self.clock.ns();
        self.bus.read_block(first, &mut words[..count.min(READ_MAX)])?;
        Ok((time_ns, words))
    }

    /// The heartbeat: what must be seen even when no data come.
    fn beat(&mut self, now: u64) {
        self.publisher.counters().set(Counter::BusAccesses, self.bus.accesses());
        let alive = self.shows_life();
        let state = match (alive, self.told.state) {
            (true, _) => State::Live,
            (false, None) if now < self.began_ns + FIRST_SIGN_NS => State::Init,
            (false, _) => State::Stale,
        };
        self.publisher.beat(now);
        if state == State::Init {
            return;
        }
        if self.told.state.replace(state) != Some(state) {
            self.publisher.set_state(state);
            self.info.set(|status| status.state = state);
            if alive {
                info!("board: live");
            } else {
                warn!("board: stale, no servo data, no background data and no ASCII reply");
            }
        }
        if let Err(error) = self.guard_page() {
            self.bus_failed(&error);
        }
    }

    /// Whether the board does something, as far as what is used of it can tell.
    fn shows_life(&self) -> bool {
        let live = self.functions.is_live::<BoardBus>();
        live.unwrap_or(!self.condition.silent && !self.condition.gone)
    }

    pub(in crate::daemon) fn bus_failed(&mut self, error: &dyn std::fmt::Display) {
        self.publisher.counters().add(Counter::BusErrors, 1);
        if !std::mem::replace(&mut self.told.bus_error, true) {
            error!("bus: {error}; further bus errors are only counted");
        }
        self.paused_until_ns = self.clock.ns() + BUS_ERROR_PAUSE_NS;
    }
}
