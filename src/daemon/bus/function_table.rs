//! The board's automatic functions as one table, which also passes each command to its function.
//!
//! The loop polls the rows in turn. It names three: the servo data, which come before all others, and the background
//! report and the command lines, whose polls also tell whether the board lives and which board it is.
//! [`crate::function`] says how to add a row.

use std::time::Instant;

use crate::clock::Clock;
use crate::daemon::bus::board_function::{BoardFunction, Context, Polled};
use crate::daemon::bus::memory_scan::Outcome as ScanOutcome;
use crate::daemon::bus::servo_sign::ServoSign;
use crate::daemon::bus::work::command_lines::CommandLines;
use crate::daemon::bus::work::open_words::write;
use crate::daemon::bus::work::panel::PanelQueue;
use crate::daemon::bus::work::rotary::{Batch, RotaryQueue};
use crate::daemon::bus::work::variables::Variables;
use crate::daemon::bus::work::write::WriteQueue;
use crate::daemon::shared::function_use::{FunctionState, FunctionUse, Pointers};
use crate::daemon::shared::job::Job;
use crate::daemon::shared::open_buffer::{ANSWER_AGE, ASKED_REPORT};
use crate::daemon::shared::queue::{Event, Outcome, Text, Ticket};
use crate::daemon::shared::status::{BoardStatus, MotorsStatus};
use crate::device::{Bus, BusError};
use crate::function::line_port::PortError;
use crate::function::rotary::RotarySetup;
use crate::function::variable_read::VariableReadBusError;
use crate::map::word_use::function_of;
use crate::map::{BufferLayout, Motors, WholeBoard};
use crate::mirror::{BackgroundMirror, GatherMirror, ServoMirror, UserMirror, VariableMirror};
use crate::protocol::{BoardSettings, CommandState, Enabled, Function, Functions, control};
use crate::segment::Counter;

/// The refusal of a job whose function the daemon does not use.
const NOT_NOW: &str = "M-variables of the board point into the words of this function; see pmacctl status";

/// A background report older than this says nothing about motion programs.
const REPORT_AGE_NS: u64 = 500_000_000;

/// The functions of a board, and which of them the daemon uses.
pub struct FunctionTable {
    clock: Clock,
    layout: BufferLayout,
    uses: FunctionUse,
    /// The functions that the daemon uses although M-variables point into their words.
    shared: Functions,
    servo_sign: ServoSign,
    /// Servo data, polled before all others.
    pub servo: ServoMirror,
    /// Background fixed data.
    pub background: BackgroundMirror,
    /// Command lines.
    pub ascii: CommandLines,
    panel: Option<PanelQueue>,
    gather: GatherMirror,
    variables: Variables,
    rotary: RotaryQueue,
    /// The site's own words: no function of the board.
    user: UserMirror,
}

/// Work on the board beside the servo data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Work {
    /// One of the board's functions.
    Function(Function),
    /// The site's own words.
    UserWords,
}

/// The mirrors that depend on the configuration.
pub struct Mirrors {
    /// Of the servo report.
    pub servo: ServoMirror,
    /// Of the background report.
    pub background: BackgroundMirror,
    /// Of variables that clients choose.
    pub variables: VariableMirror,
    /// Of the site's own words.
    pub user: UserMirror,
}

impl FunctionTable {
    /// The functions of a board whose buffers lie where `layout` says. The daemon leaves alone the words of functions
    /// that `settings` leave out.
    #[must_use]
    pub fn new(
        mirrors: Mirrors,
        ascii: CommandLines,
        layout: BufferLayout,
        settings: &BoardSettings,
        clock: Clock,
    ) -> Self {
        let Mirrors { servo, background, variables, user } = mirrors;
        let now = clock.now();
        let asks = ascii.queue.scan.is_wanted();
        let mut table = Self {
            uses: FunctionUse::new(settings, asks),
            shared: settings.shared_functions.clone(),
            servo_sign: ServoSign::default(),
            servo,
            background,
            ascii,
            panel: PanelQueue::new(layout.family(), now),
            gather: GatherMirror::new(layout.family(), clock.clone()),
            variables: Variables { read: variables, write: WriteQueue::new(&layout, now) },
            rotary: RotaryQueue::new(layout.family(), now),
            user,
            layout,
            clock,
        };
        table.keep_as_found();
        table
    }

    /// The functions' clock.
    #[must_use]
    pub const fn clock(&self) -> &Clock {
        &self.clock
    }

    /// Until the daemon knows where the board's M-variables point, it leaves the board's reports as it finds them.
    fn keep_as_found(&mut self) {
        let asks = self.ascii.queue.scan.is_wanted();
        self.servo.reader.keep_as_found(asks && !self.shared.has(Function::Servo));
        self.background.keep_as_found(asks && !self.shared.has(Function::Background));
    }

    /// Every function. Of functions due at the same time, the loop polls the first in this list first.
    fn rows<B: Bus>(&self) -> [(Function, &dyn BoardFunction<B>); 7] {
        [
            (Function::Servo, &self.servo),
            (Function::Panel, &self.panel),
            (Function::Gather, &self.gather),
            (Function::Variables, &self.variables),
            (Function::Rotary, &self.rotary),
            (Function::Ascii, &self.ascii),
            (Function::Background, &self.background),
        ]
    }

    fn row<B: Bus>(&mut self, function: Function) -> &mut dyn BoardFunction<B> {
        match function {
            Function::Servo => &mut self.servo,
            Function::Panel => &mut self.panel,
            Function::Gather => &mut self.gather,
            Function::Variables => &mut self.variables,
            Function::Rotary => &mut self.rotary,
            Function::Ascii => &mut self.ascii,
            Function::Background => &mut self.background,
        }
    }

    /// When the servo data are due, or a check whether the board makes servo data; never where the daemon does not use
    /// them.
    #[must_use]
    pub fn servo_due_ns(&self) -> u64 {
        match self.uses.of(Function::Servo) {
            FunctionState::On => self.servo.due_ns(),
            FunctionState::Waits => self.servo_sign.due_ns(),
            FunctionState::Off | FunctionState::Held => u64::MAX,
        }
    }

    /// The first due work beside the servo data, and when it is due. Only functions that watch the board if
    /// `only_watching`.
    #[must_use]
    pub fn next<B: Bus>(&self, only_watching: bool) -> Option<(u64, Work)> {
        let first = self.others::<B>(only_watching).min_by_key(|(due_ns, ..)| *due_ns);
        first.map(|(due_ns, _, work)| (due_ns, work))
    }

    /// When the first of that work is due, and until when all of it can wait; never where there is no work.
    #[must_use]
    pub fn times<B: Bus>(&self, only_watching: bool) -> [u64; 2] {
        self.others::<B>(only_watching).fold([u64::MAX; 2], |[due, latest], (due_ns, spare_ns, _)| {
            [due.min(due_ns), latest.min(due_ns.saturating_add(spare_ns))]
        })
    }

    /// The work beside the servo data, of the functions in use: when it is due, for how long it can wait, and which
    /// work.
    fn others<'a, B: Bus + 'a>(&'a self, only_watching: bool) -> impl Iterator<Item = (u64, u64, Work)> + 'a {
        let user = self.user.due_ns().filter(|_| !only_watching);
        let user = user.map(|due_ns| (due_ns, self.user.spare_ns(), Work::UserWords));
        let functions = self.rows::<B>().into_iter().filter_map(move |(function, row)| {
            let is_asked =
                function != Function::Servo && self.uses(function) && (row.watches() || !only_watching);
            if is_asked {
                Some((row.due_ns(&self.clock)?, row.spare_ns(), Work::Function(function)))
            } else {
                None
            }
        });
        functions.chain(user)
    }

    /// Does one bounded piece of a function's work.
    ///
    /// # Errors
    /// When the board cannot be reached.
    pub fn poll<B: Bus>(
        &mut self,
        function: Function,
        context: &mut Context<'_, B>,
    ) -> Result<Polled, PortError> {
        if function == Function::Servo && self.uses.of(function) == FunctionState::Waits {
            let report = &self.layout.family().servo;
            let runs = self.servo_sign.look(context.bus, report, context.clock.ns())?;
            self.begin(runs.then_some(Function::Servo).into_iter(), context)?;
            return Ok(Polled::default());
        }
        if let (Function::Panel, Some(panel)) = (function, &mut self.panel) {
            panel.see_kill(self.ascii.queue.kill());
        }
        let polled = self.row(function).poll(context)?;
        if let (Function::Servo | Function::Background, Some(panel)) = (function, &mut self.panel) {
            let off = if self.servo.is_live() { Motors::NONE } else { self.background.amplifiers_off() };
            panel.loops_mut().see_servo(self.servo.open_loops(), self.servo.updates());
            panel.loops_mut().see_background(off, self.background.reports());
        }
        if function == Function::Servo {
            let Context { bus, publisher, clock, .. } = context;
            self.user.follow_servo(self.servo.updates(), *bus, publisher, clock.ns())?;
        }
        Ok(polled)
    }

    /// Reads the site's own words.
    ///
    /// # Errors
    /// When the board cannot be reached.
    pub fn read_user_words<B: Bus>(&mut self, context: &mut Context<'_, B>) -> Result<(), BusError> {
        let Context { bus, publisher, clock, .. } = context;
        self.user.poll(*bus, publisher, clock.ns())
    }

    /// The counter for a function's accesses of the board.
    #[must_use]
    pub fn counter<B: Bus>(&mut self, function: Function) -> Option<Counter> {
        self.row::<B>(function).counter()
    }

    /// Takes over every function in use.
    ///
    /// # Errors
    /// When the board cannot be reached.
    pub fn acquire<B: Bus>(&mut self, context: &mut Context<'_, B>) -> Result<(), PortError> {
        self.used_ones().try_for_each(|function| self.row(function).acquire(context))
    }

    /// The board was reset or replaced: its M-variables may point elsewhere now.
    ///
    /// # Errors
    /// When the board cannot be reached.
    pub fn reset<B: Bus>(&mut self, context: &mut Context<'_, B>) -> Result<(), PortError> {
        self.keep_as_found();
        self.used_ones().try_for_each(|function| self.row(function).reset(context))
    }

    /// Leaves every function in use, even if leaving an earlier function fails.
    ///
    /// # Errors
    /// When the board cannot be reached.
    pub fn leave<B: Bus>(&mut self, bus: &mut B) -> Result<(), BusError> {
        self.used_ones().map(|function| self.row(function).leave(bus)).fold(Ok(()), Result::and)
    }

    fn used_ones(&self) -> impl Iterator<Item = Function> + use<> {
        let uses = self.uses;
        Function::ALL.into_iter().filter(move |function| uses.of(*function) == FunctionState::On)
    }

    /// Whether the board shows life, as far as the functions in use tell; `None` where none of them tells.
    #[must_use]
    pub fn is_live<B: Bus>(&self) -> Option<bool> {
        let used = self.rows::<B>().into_iter().filter(|(function, _)| self.uses(*function));
        used.filter_map(|(_, row)| row.is_live()).reduce(|one, other| one || other)
    }

    /// The state of the motors, from the reports. The panel knows more about open loops than the servo report.
    fn motors(&self) -> MotorsStatus {
        let (open_loops, loops_left_open, loops_untold) = match &self.panel {
            Some(panel) => (panel.open_loops(), panel.open_loops(), Motors::NONE),
            None => (Motors::NONE, self.servo.open_loops(), self.servo.reader.left_out()),
        };
        MotorsStatus { motion: self.servo.motion(), open_loops, loops_left_open, loops_untold }
    }

    /// The part of the servo report that the daemon passes on beside the data. The raw copies of the global status are
    /// not in this part: some of their bits come and go by themselves.
    #[must_use]
    pub fn servo_told(&self) -> (MotorsStatus, Option<WholeBoard>) {
        (self.motors(), self.servo.whole_board())
    }

    /// Writes the functions' state `now` into `status`; the counts only if `with_counts`.
    pub fn tell(&self, status: &mut BoardStatus, with_counts: bool, now: Instant) {
        let Self { servo, background, ascii, .. } = self;
        ascii.queue.tell(&mut status.lines, with_counts, now);
        status.motors = self.motors();
        let board = servo.whole_board().or_else(|| background.whole_board());
        status.gathers = board.map(|board| board.gathering);
        let programs = background.programs_run(self.clock.ns(), REPORT_AGE_NS);
        status.programs_run = programs.map(|(systems, _)| systems);
        status.uses = self.uses;
        let at_work = [
            (Enabled::SERVO, servo.is_live()),
            (Enabled::BACKGROUND, background.is_live()),
            (Enabled::ASCII, ascii.queue.state() == CommandState::Answers),
            (Enabled::INTERRUPT, ascii.queue.has_interrupt()),
            (Enabled::GATHER, status.gathers == Some(true)),
        ];
        status.enabled =
            at_work.into_iter().filter_map(|(function, is_on)| is_on.then_some(function)).collect();
        if let Some(counts) = ascii.host_port_counts().filter(|_| with_counts) {
            status.host_port = counts;
        }
    }

    /// Whether a program buffer is open on the board, and the number of the report that tells so; `None` while no
    /// report tells.
    #[must_use]
    fn program_buffer_open(&self) -> Option<(bool, u64)> {
        let Self { servo, background, clock, .. } = self;
        let age_ns = u64::try_from(ANSWER_AGE.as_nanos()).unwrap_or(u64::MAX);
        let by_servo = servo.whole_board().map(|board| (board.program_buffer_open, servo.updates()));
        by_servo.or_else(|| {
            let board = background.whole_board().filter(|_| background.is_new(clock.ns(), age_ns))?;
            Some((board.program_buffer_open, background.reports().saturating_mul(ASKED_REPORT)))
        })
    }

    /// Passes the reports' news about program buffers and motion programs to the command lines. The control panel
    /// starts motion programs, too.
    pub fn see_whole_board(&mut self) {
        let buffer = self.program_buffer_open();
        let told = self.background.programs_run(self.clock.ns(), REPORT_AGE_NS);
        let queue = &mut self.ascii.queue;
        queue.see_buffer(buffer);
        queue.see_programs(told.map(|(systems, asked_ns)| (!systems.is_empty(), asked_ns)));
        if self.panel.as_ref().is_some_and(PanelQueue::is_busy) {
            queue.may_start_program();
        }
    }

    /// Whether the daemon uses a function.
    #[must_use]
    pub fn uses(&self, function: Function) -> bool {
        self.uses.of(function) == FunctionState::On
    }

    /// The functions that the daemon uses, and the reasons against the others.
    #[must_use]
    pub const fn uses_of_all(&self) -> &FunctionUse {
        &self.uses
    }

    /// Uses these functions from now on: the board reports them as enabled, so the site does not use the words that the
    /// board writes. The daemon leaves the choice of reported motors and coordinate systems as it is until it knows
    /// where the M-variables point.
    ///
    /// # Errors
    /// When the board cannot be reached.
    pub fn begin<B: Bus>(
        &mut self,
        enabled: impl Iterator<Item = Function>,
        context: &mut Context<'_, B>,
    ) -> Result<(), PortError> {
        let before = self.uses;
        enabled.for_each(|function| self.uses.begin(function));
        self.follow_use(&before, context)
    }

    /// The board has told where its M-variables point, or does not tell. The daemon does not use, or stops using, a
    /// function if an M-variable points into its words, unless the configuration allows the function or it is at work
    /// now. The daemon uses command lines in any case: through them the board told its pointers.
    ///
    /// # Errors
    /// When the board cannot be reached.
    pub fn take_pointers<B: Bus>(
        &mut self,
        outcome: ScanOutcome,
        context: &mut Context<'_, B>,
    ) -> Result<(), PortError> {
        let before = self.uses;
        let pointers = self.pointers();
        let is_busy = Function::ALL.map(|function| {
            let row = self.rows::<B>().into_iter().find(|(other, _)| *other == function);
            let has_work = row.is_some_and(|(_, row)| row.due_ns(&self.clock).is_some());
            has_work && !matches!(function, Function::Servo | Function::Background)
        });
        let shared = &self.shared;
        self.uses.decide(pointers, outcome == ScanOutcome::Known, |function| {
            let in_use = before.of(function) == FunctionState::On && is_busy[function as usize];
            shared.has(function) || function == Function::Ascii || in_use
        });
        if matches!(outcome, ScanOutcome::Unknown | ScanOutcome::Unclear(_)) {
            // The daemon knows no M-variable that points into the words of the functions that still wait.
            Function::ALL.into_iter().for_each(|function| self.uses.begin(function));
        }
        if outcome != ScanOutcome::More {
            self.servo.reader.keep_as_found(false);
            self.background.keep_as_found(false);
        }
        self.follow_use(&before, context)
    }

    /// The M-variables that point into each function's words.
    fn pointers(&self) -> [Option<Pointers>; Function::ALL.len()] {
        let mut all = [None; Function::ALL.len()];
        let mut last = [None; Function::ALL.len()];
        for (word, variable) in self.ascii.queue.scan.words() {
            let Some(function) = function_of(&self.layout, word) else { continue };
            let own = &mut all[function as usize];
            match own {
                None => *own = Some(Pointers { variable, word, others: 0 }),
                Some(own) if last[function as usize] != Some(variable) => own.others += 1,
                Some(_) => {}
            }
            last[function as usize] = Some(variable);
        }
        all
    }

    /// Takes over the functions that have come into use since `before`, and leaves those no longer used.
    fn follow_use<B: Bus>(
        &mut self,
        before: &FunctionUse,
        context: &mut Context<'_, B>,
    ) -> Result<(), PortError> {
        for function in Function::ALL {
            match (before.of(function), self.uses.of(function)) {
                (FunctionState::Waits | FunctionState::Held, FunctionState::On) => {
                    self.row(function).acquire(context)?
                }
                (FunctionState::On, FunctionState::Held) => {
                    self.row(function).leave(context.bus)?;
                    match function {
                        Function::Servo => self.servo.end(context.publisher),
                        Function::Background => self.background.end(context.publisher),
                        _ => {}
                    }
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// The daemon has learnt the board's firmware, and so the place of the gather buffer; the other buffers stay in
    /// place.
    pub fn set_layout(&mut self, layout: BufferLayout) {
        self.layout = layout;
    }

    /// Takes a job in; returns the job's end if the job ends at once.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn submit<B: Bus>(
        &mut self,
        context: &mut Context<'_, B>,
        ticket: Ticket,
        job: Job,
        deadline: Instant,
    ) -> Result<Option<Event>, BusError> {
        let Context { bus, publisher, .. } = context;
        if let Some(function) = job.function()
            && !self.uses(function)
        {
            // The function was in use when the socket checked.
            return Ok(Some(Event::Done(ticket, Outcome::Refused(Text::of(&NOT_NOW)))));
        }
        let now = self.clock.now();
        let outcome = match job {
            Job::Panel(request) => {
                let Some(panel) = &mut self.panel else { return Ok(Some(Event::Done(ticket, no_panel()))) };
                panel.submit(ticket, request, deadline, now);
                return Ok(None);
            }
            Job::EndHold(motors) => {
                let Some(panel) = &mut self.panel else { return Ok(Some(Event::Done(ticket, no_panel()))) };
                panel.end_hold(ticket, motors, deadline, now);
                return Ok(None);
            }
            Job::RotarySend { buffer, first, lines } => {
                let batch = Batch { ticket, buffer, first, lines: lines.into(), deadline };
                return Ok(self.rotary.submit(batch, now));
            }
            Job::WriteVariables(records) => {
                self.variables.write.submit(ticket, records, deadline, now);
                return Ok(None);
            }
            Job::RotaryState(buffer) => return self.rotary.state(*bus, ticket, buffer).map(Some),
            Job::Override { coordinate_system, value } => match &mut self.panel {
                Some(panel) => panel.set_override(*bus, coordinate_system, value)?,
                None => no_panel(),
            },
            Job::Write { first, words, anywhere } => {
                match if anywhere { Ok(()) } else { self.layout.check_user_area(first, words.len()) } {
                    Ok(()) => write(*bus, first, &words)?,
                    Err(reason) => Outcome::Refused(Text::of(&reason)),
                }
            }
            Job::WatchVariables(entries) => match self.variables.read.begin(*bus, &entries, publisher, now) {
                Ok(()) => return Ok(Some(Event::Watching(ticket, self.variables.read.table()))),
                Err(VariableReadBusError::Refused(reason)) => Outcome::Refused(Text::of(&reason)),
                Err(VariableReadBusError::Bus(error)) => return Err(error),
            },
            Job::GatherBegin { buffer, clock } => {
                match self.layout.check_gather(buffer.place.buffer, buffer.size_longs, buffer.sample_longs) {
                    Err(reason) => Outcome::Refused(Text::of(&reason)),
                    Ok(()) => match self.gather.begin(*bus, buffer, clock, publisher, now)? {
                        Ok(()) => Outcome::Done,
                        Err(reason) => Outcome::Refused(Text::of(&reason)),
                    },
                }
            }
            Job::GatherEnd => {
                self.gather.end(now);
                Outcome::Done
            }
            Job::RotaryOpen { buffer, start, size_longs, coordinate_system, coordinate_system_base } => {
                let Some(kept) = self.layout.rotary().get(buffer).copied() else {
                    let reason = format_args!("the board has no rotary buffer {}", buffer + 1);
                    return Ok(Some(Event::Done(ticket, Outcome::Refused(Text::of(&reason)))));
                };
                let setup = RotarySetup {
                    start: start.unwrap_or(kept.start),
                    size_longs: size_longs.unwrap_or(kept.words() as u32 / 2),
                    coordinate_system,
                    coordinate_system_base,
                };
                match self.layout.check_rotary(buffer, setup.start, setup.size_longs) {
                    Ok(()) => self.rotary.open(*bus, buffer, &setup)?,
                    Err(reason) => Outcome::Refused(Text::of(&reason)),
                }
            }
            Job::RotaryFinish(buffer) => self.rotary.finish(buffer, now),
            Job::RotaryClose(buffer) => self.rotary.close(*bus, buffer)?,
        };
        Ok(Some(Event::Done(ticket, outcome)))
    }

    /// User `uid` is about to send a control character. The panel makes way for a character that stops all motion.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn make_way(
        &mut self,
        bus: &mut impl Bus,
        uid: u32,
        character: u8,
        now: Instant,
    ) -> Result<(), BusError> {
        let stops = matches!(character, control::ABORT | control::KILL);
        match self.panel.as_mut().filter(|_| stops) {
            Some(panel) => panel.make_way(bus, uid, character, now),
            None => Ok(()),
        }
    }

    /// At the daemon's end: keeps only the stops among the waiting panel requests.
    pub fn keep_stops(&mut self) {
        self.panel.iter_mut().for_each(PanelQueue::keep_stops);
    }

    /// At the daemon's end: hands the next remaining panel request to the board, if it is due. Returns when to call
    /// again; `None` when no request is left.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn finish_stops(&mut self, bus: &mut impl Bus) -> Result<Option<Instant>, BusError> {
        let (Some(panel), now) = (&mut self.panel, self.clock.now()) else { return Ok(None) };
        if panel.due().is_some_and(|due| due <= now) {
            panel.poll(bus, now)?;
        }
        Ok(panel.due())
    }
}

fn no_panel() -> Outcome {
    Outcome::Refused(Text::of(&"boards of this family have no control panel in their DPRAM"))
}
