//! Command lines for the board: many callers, one line at a time.
//!
//! Lines wait in order. Control characters overtake the lines that wait; what stops or cancels goes over the one that lies
//! there, too. When nobody else is being served the
//! board is asked who it is ([`crate::daemon::bus::identify`]). Everything is bounded: the queues by what the socket hands
//! over, a command by its deadline, a poll by the number of responses it takes.

mod announced;
mod answers;
mod buffer;
mod characters;
mod check;
mod controls;
mod expiry;
mod line_pace;
mod outbox;
mod page;
mod programs;
mod unsettled;
mod wait;
mod way;

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use announced::Announced;
use buffer::BufferQuestion;
use characters::Characters;
use check::Check;
use line_pace::LinePace;
use outbox::Outbox;
use page::PageAgain;
use programs::Programs;
use unsettled::Unsettled;
use wait::Wait;

use crate::clock::Clock;
use crate::daemon::bus::identify::Identifier;
use crate::daemon::bus::memory_scan::MemoryScan;
use crate::daemon::bus::ports::command_port::CommandPorts;
use crate::daemon::bus::ports::fallback::Fallback;
use crate::daemon::bus::scale_doubts::ScaleDoubts;
use crate::daemon::bus::timing::{
    LINES_POLL_IDLE, LINES_POLL_IDLE_WITH_INTERRUPT, LINES_POLL_LATER, LINES_POLL_SOON, LINES_POLLED_OFTEN,
    OWN_LINE, OWN_REPLY,
};
use crate::daemon::bus::work::kill::Kill;
use crate::daemon::shared::open_buffer::{Barred, OpenBuffer, Writer};
use crate::daemon::shared::queue::{Command, Event, Line, Origin, Outcome, Sender, Text, Ticket, at_once};
use crate::daemon::shared::rotary_address::AddressFirst;
use crate::device::{Bus, BusError};
use crate::function::ascii::control::control_has_reply;
use crate::function::line_port::PortError;
use crate::protocol::{CommandPort, CommandState, control};
use crate::segment::{Counter, Publisher};

/// Responses taken in one poll, so that a chattering board cannot hold up the servo data.
const STEPS_A_POLL: usize = 2;
/// I64=1 puts it before a text that nobody asked for (Turbo Software Reference p. 67). The control word says that already.
const STX: u8 = 0x02;

/// One poll of the queue: when it is, who is told what came of it, and where it is counted.
#[derive(Clone, Copy)]
struct Poll<'a> {
    events: &'a Sender<Event>,
    publisher: &'a Publisher,
    now: Instant,
}

/// A command under way, and so who it is for.
#[derive(Clone, Copy)]
#[expect(clippy::large_enum_variant, reason = "inline, so that the bus thread need not allocate")]
enum InFlight {
    Line(WaitingLine),
    Control(WaitingControl),
    /// A question of the identifier's.
    Identify,
    /// A question for definitions of M-variables.
    Scan,
    /// The question whether a program buffer is open.
    Buffer,
    /// The question which coordinate system is addressed.
    Address,
    /// Who opened the rotary buffers has his address back.
    PutBack,
    /// The question whether the board takes control characters by their word alone.
    Character,
    /// The line of our own after a command that was given up, or whose end is to be settled.
    Check,
}

#[derive(Clone, Copy)]
struct WaitingLine {
    ticket: Ticket,
    line: Line,
    origin: Origin,
    wait: Wait,
    writer: Writer,
    /// It is not to be sent any more: this user stopped all motion by this character.
    dropped_by: Option<(u32, u8)>,
}

#[derive(Clone, Copy)]
struct WaitingControl {
    ticket: Ticket,
    uid: u32,
    character: u8,
    wait: Wait,
}

#[derive(Clone, Copy)]
struct UnderWay {
    command: InFlight,
    deadline: Instant,
    since: Instant,
    /// The board has shown that it works on it.
    taken: bool,
    /// This control character has ended it.
    ended_by: Option<EndedBy>,
}

/// What ended a command before the board had answered it.
#[derive(Clone, Copy)]
struct EndedBy {
    uid: u32,
    /// `^X`, which the board has taken, or a stop.
    character: u8,
    /// The board was not given all of the line, and does nothing before that.
    unsent: bool,
}

/// The lines that wait, and the command under way.
pub struct AsciiQueue {
    /// The ports for command lines.
    pub ports: CommandPorts,
    fallback: Fallback,
    lines: VecDeque<WaitingLine>,
    controls: VecDeque<WaitingControl>,
    under_way: Option<UnderWay>,
    /// The command whose end is to be settled.
    unsettled: Option<Unsettled>,
    /// Whether an error may be a program's.
    programs: Programs,
    /// The control character that waits in its word until the board takes it.
    control_pending: Option<WaitingControl>,
    /// One that waited there when the board was reset, and whether that may have taken it; its caller is to be told.
    control_lost: Option<(Ticket, bool)>,
    /// How many `^K` the board has taken.
    kills: u64,
    /// What settles which responses are whose.
    check: Check,
    /// Whether the board takes control characters by their word alone.
    characters: Characters,
    /// Whether the board takes lines as program lines.
    buffer: OpenBuffer,
    /// When it is asked, and what it said.
    buffer_question: BufferQuestion,
    /// After a control character with a reply a line has its turn, if one waits.
    line_is_next: bool,
    /// After a question of our own, too.
    own_was_last: bool,
    /// What the socket is told. While it is full nothing more is taken from the board.
    outbox: Outbox,
    /// The identity, and when it is asked.
    pub identifier: Identifier,
    /// Where the board's own programs keep data, and when it is asked.
    pub scan: MemoryScan,
    state: CommandState,
    line_pace: LinePace,
    /// When the board last ended a command, whosever.
    answered: Option<Instant>,
    last_event: Instant,
    next_poll: Instant,
    announced: Announced,
    clock: Clock,
    page_again: PageAgain,
}

impl AsciiQueue {
    /// Nothing waits for `ports`.
    #[must_use]
    pub fn new(ports: CommandPorts, identifier: Identifier, scan: MemoryScan, clock: Clock) -> Self {
        let now = clock.now();
        Self {
            ports,
            fallback: Fallback::new(now),
            // One may come back from a port that did not take it.
            lines: VecDeque::with_capacity(at_once::LINES + at_once::STOPS + 1),
            controls: VecDeque::with_capacity(at_once::CONTROLS + at_once::QUERIES + at_once::STOPS + 1),
            under_way: None,
            unsettled: None,
            programs: Programs::default(),
            control_pending: None,
            control_lost: None,
            kills: 0,
            check: Check::new(now),
            characters: Characters::new(now),
            buffer: OpenBuffer::default(),
            buffer_question: BufferQuestion::new(now),
            line_is_next: false,
            own_was_last: false,
            outbox: Outbox::default(),
            identifier,
            scan,
            state: CommandState::Unknown,
            line_pace: LinePace::new(),
            answered: None,
            last_event: now,
            next_poll: now,
            announced: Announced::default(),
            clock,
            page_again: PageAgain::default(),
        }
    }

    /// Clears the host's words in the DPRAM. Another host, or the daemon before, may have left a line of our own kind there, whose
    /// reply is still to come.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn take_over(&mut self, bus: &mut impl Bus) -> Result<(), BusError> {
        let last: Text<{ check::LINE_MAX }> = self.ports.dpram.last_line(bus)?;
        self.check.follow(last.as_bytes());
        self.ports.dpram.look_for_half_a_line(bus)?;
        self.ports.dpram.release(bus)
    }

    /// Whether the port answers.
    #[must_use]
    pub fn state(&self) -> CommandState {
        self.state
    }

    /// Other data have stopped: that the port answered once says nothing any more. It is asked again if it may be.
    pub fn doubt(&mut self, now: Instant) {
        self.state = CommandState::Unknown;
        self.identifier.ask_again(now);
    }

    /// The board is another one, or was reset: no buffer is open, and what it had been told to send it has forgotten. The
    /// commands under way are given up, so that the new board does nothing of what the old one was told. A control character
    /// that lies untouched was not carried out; of everything else nobody knows: a flag may be cleared only when a line is done.
    ///
    /// # Errors
    /// When a port cannot be reached.
    pub fn reset(&mut self, bus: &mut impl Bus, now: Instant) -> Result<(), PortError> {
        self.buffer = OpenBuffer::after_reset();
        if let Some(pending) = self.control_pending.take() {
            let taken = self.ports.dpram.is_out_of_reach(bus)? || !self.ports.control_pending(bus, now)?;
            self.control_lost = Some((pending.ticket, taken));
            self.ports.current_mut().withdraw_control(bus, now)?;
        }
        if let Some(under_way) = &mut self.under_way {
            under_way.deadline = now;
            // Now, before a cleared flag is taken for the board's having taken the first half of a line.
            self.ports.give_up(bus, now)?;
        }
        if let Some(unsettled) = &mut self.unsettled {
            unsettled.under_way.deadline = now;
        }
        self.characters = Characters::new(now);
        self.ports.dpram.forget_characters();
        self.programs.may_have_started(self.clock.ns());
        self.ports.current_mut().withdraw(bus, now)?;
        self.check.reset();
        self.poll_now(now);
        self.ports.start(now)
    }

    /// Whether an answer waits for room in the socket's queue, so that nothing more is taken from the board.
    #[must_use]
    pub fn is_held_up(&self) -> bool {
        !self.outbox.is_empty()
    }

    /// How far `^K` is.
    #[must_use]
    pub fn kill(&self) -> Kill {
        let known = self.controls.iter().chain(&self.control_pending);
        let is_under_way = known.into_iter().any(|control| control.character == control::KILL);
        Kill { is_under_way, taken: self.kills }
    }

    /// Interrupts can announce responses, or not.
    pub fn set_interrupt(&mut self, is_connected: bool) {
        if self.announced.connect(is_connected) {
            self.next_poll = self.clock.now();
        }
    }

    /// An interrupt came: poll at once.
    pub fn interrupt_came(&mut self, now: Instant) {
        self.announced.interrupt(now);
        self.poll_now(now);
    }

    /// Whether interrupts announce responses.
    #[must_use]
    pub const fn has_interrupt(&self) -> bool {
        self.announced.is_proven()
    }

    /// When to poll next.
    #[must_use]
    pub fn due(&self) -> Instant {
        self.next_poll
    }

    /// A command came, or may have ended: poll at once.
    pub fn poll_now(&mut self, now: Instant) {
        self.last_event = now;
        self.next_poll = now;
    }

    /// Takes a line or control character in.
    pub fn submit(&mut self, command: &Command, now: Instant) {
        self.ports.begin_use(now);
        match *command {
            Command::Send { ticket, line, origin, deadline, writer } => {
                if ScaleDoubts::of(&line.meaning).is_some() {
                    self.fallback.ask_soon(&self.ports, now);
                }
                let dropped_by = None;
                let wait = if origin.stays {
                    Wait::to_the_last(now, deadline)
                } else {
                    Wait::for_answer(now, deadline)
                };
                let line = WaitingLine { ticket, line, origin, wait, writer, dropped_by };
                self.lines.push_back(line);
            }
            Command::First { ticket, line, origin, deadline } => {
                let (writer, dropped_by) = (Writer::Stop, None);
                let wait = Wait::to_the_last(now, deadline);
                let line = WaitingLine { ticket, line, origin, wait, writer, dropped_by };
                self.lines.push_front(line);
            }
            Command::Control { ticket, uid, drops_lines, character, deadline } => {
                if drops_lines {
                    let dropped = self.lines.iter_mut().filter(|line| !line.origin.stays);
                    dropped.for_each(|line| line.dropped_by = Some((uid, character)));
                }
                let wait = if control_has_reply(character) {
                    Wait::for_answer(now, deadline)
                } else {
                    Wait::to_the_last(now, deadline)
                };
                self.controls.push_back(WaitingControl { ticket, uid, character, wait });
            }
            Command::ReadWords { .. } | Command::Job { .. } => {}
        }
        self.poll_now(now);
    }

    /// The board is a recording: no program of it runs.
    #[must_use]
    pub const fn of_replay(mut self) -> Self {
        self.programs.is_replay = true;
        self
    }

    /// The last background report, asked for at a time on CLOCK_MONOTONIC, says whether a motion program runs; `None`: none tells.
    pub fn see_programs(&mut self, told: Option<(bool, u64)>) {
        self.programs.see(told);
    }

    /// Somebody may start a motion program otherwise than by a line.
    pub fn may_start_program(&mut self) {
        self.programs.may_have_started(self.clock.ns());
    }

    /// Does what can be done now.
    ///
    /// # Errors
    /// When a port cannot be reached.
    pub fn poll(
        &mut self,
        bus: &mut impl Bus,
        events: &Sender<Event>,
        publisher: &Publisher,
        now: Instant,
    ) -> Result<(), PortError> {
        let poll = Poll { events, publisher, now };
        self.outbox.retry(events);
        if self.outbox.is_empty() {
            self.serve_controls(bus, poll)?;
        }
        for _ in 0..STEPS_A_POLL {
            if !self.outbox.is_empty() {
                break;
            }
            let Some(event) = self.ports.poll(bus, now)? else { break };
            self.last_event = now;
            self.announced.see(&event, now);
            self.handle(poll, event);
        }
        self.announced.tend(now);
        self.consider_fallback(bus, now)?;
        if self.outbox.is_empty() {
            self.expire(bus, poll)?;
        }
        if self.ports.current().is_unheard() {
            self.state = CommandState::Silent;
        }
        self.keep_page(now)?;
        self.scan.pass(self.others_hold(), now);
        if self.outbox.is_empty() && self.under_way.is_none() && self.ports.current().is_idle() {
            self.begin_next(bus, poll)?;
        }
        self.next_poll = now + self.patience(now);
        Ok(())
    }

    /// Whether something is asked of the board, or waits to be.
    #[must_use]
    pub fn is_busy(&self) -> bool {
        self.under_way.is_some()
            || self.unsettled.is_some()
            || self.ports.is_waiting()
            || self.control_pending.is_some()
            || self.control_lost.is_some()
            || !self.outbox.is_empty()
            || !self.lines.is_empty()
            || !self.controls.is_empty()
    }

    fn patience(&self, now: Instant) -> Duration {
        // What cannot be asked now is not waited for.
        let question = if self.ports.in_doubt() {
            // Where all ones are read nothing can be begun, however often it is tried.
            self.check.due_in(now).max(LINES_POLL_LATER)
        } else {
            let due = self.identifier.due_in(now).min(self.scan_due_in(now)).min(self.characters_due_in(now));
            due.max(self.questions_barred_for(now))
        };
        match (self.is_busy(), self.announced.is_sure()) {
            // The mailboxes' interrupts tell everything; only time has to be watched.
            (true, _)
                if self.ports.in_use() == CommandPort::Dpram
                    && now.duration_since(self.last_event) < LINES_POLLED_OFTEN =>
            {
                LINES_POLL_SOON
            }
            (true, _) => LINES_POLL_LATER,
            (false, false) => LINES_POLL_IDLE.min(question),
            (false, true) => LINES_POLL_IDLE_WITH_INTERRUPT.min(question),
        }
    }

    /// Starts the next line: a caller's, or else a question of our own.
    fn begin_next(&mut self, bus: &mut impl Bus, poll: Poll<'_>) -> Result<(), PortError> {
        let now = poll.now;
        if self.ports.in_doubt() {
            return self.begin_check(bus, poll);
        }
        let waits = |control: &WaitingControl| control_has_reply(control.character);
        if !self.line_is_next && self.control_pending.is_none() && self.controls.iter().any(waits) {
            // Lines that always wait must not hold it up. It goes with the next poll.
            return Ok(());
        }
        let questions_wait = !self.questions_barred_for(now).is_zero();
        if let Some(&next) = self.lines.front()
            && (questions_wait || self.own_was_last || !self.is_question_overdue(now))
        {
            if now >= next.wait.begin_by {
                // Its caller may have been told by now that it was not done. So must it be; [`Self::expire`] takes it away.
                return Ok(());
            }
            let meaning = &next.line.meaning;
            if self.buffer.must_ask(meaning, next.writer, now) {
                return self.ask_buffer(bus, poll);
            }
            if let Some(barred) = self.buffer.bars(meaning, next.writer) {
                self.lines.pop_front();
                self.outbox.tell(poll.events, Event::Done(next.ticket, Outcome::Barred(barred)));
                return Ok(());
            }
            match self.buffer.address_first(meaning, next.writer) {
                Some(AddressFirst::Unknown) => {
                    self.lines.pop_front();
                    let outcome = Outcome::Barred(Barred::Addressed);
                    self.outbox.tell(poll.events, Event::Done(next.ticket, outcome));
                    return Ok(());
                }
                Some(AddressFirst::Ask) => return self.ask_address(bus, poll),
                Some(AddressFirst::PutBack(system)) => {
                    return self.put_address_back(bus, system, poll);
                }
                None => {}
            }
            if self.ports.current_mut().begin(bus, next.line.as_bytes())? {
                self.lines.pop_front();
                self.buffer.begin(meaning, next.writer, now);
                self.identifier.line_goes(meaning, now);
                self.scan.line_goes(meaning, now);
                self.start(InFlight::Line(next), next.wait.deadline, poll);
            }
        } else if !questions_wait {
            self.ask_own(bus, poll)?;
        }
        Ok(())
    }

    /// Asks a question of our own, if one is due: who the board is, or, when that is known, where its programs keep data.
    fn ask_own(&mut self, bus: &mut impl Bus, poll: Poll<'_>) -> Result<(), PortError> {
        let now = poll.now;
        if self.characters_due_in(now).is_zero() && self.ask_for_characters(bus, poll)? {
            return Ok(());
        }
        let identifies = self.identifier.due_in(now).is_zero();
        if !identifies && !self.scan_due_in(now).is_zero() {
            return Ok(());
        }
        if !self.buffer.is_known(now) {
            return self.ask_buffer(bus, poll);
        }
        let most_lines = self.line_pace.most_lines();
        if identifies {
            if let Some((line, patience)) = self.identifier.next_line(most_lines, now)
                && self.ports.current_mut().begin(bus, line.as_bytes())?
            {
                self.identifier.sent();
                self.start(InFlight::Identify, now + patience, poll);
            }
        } else if let Some((line, patience)) = self.scan.next_line(most_lines, now)
            && self.ports.current_mut().begin(bus, line.as_bytes())?
        {
            self.scan.sent(now);
            self.start(InFlight::Scan, now + patience, poll);
        }
        Ok(())
    }

    /// How long the board need not be asked for M-variables; a board that does not answer is not.
    fn scan_due_in(&self, now: Instant) -> Duration {
        if self.state == CommandState::Answers { self.scan.due_in(now) } else { Duration::MAX }
    }

    /// Whether a question of our own goes before the lines that wait.
    fn is_question_overdue(&self, now: Instant) -> bool {
        let scan_is_overdue = self.state == CommandState::Answers && self.scan.is_overdue(now);
        self.identifier.is_overdue(now) || scan_is_overdue
    }

    /// Whether the board cannot be asked because of others: their commands hold the port, at a board that answers them, or a program
    /// buffer is open.
    fn others_hold(&self) -> bool {
        let command = self.under_way.as_ref().map(|under_way| &under_way.command);
        let is_others = matches!(command, Some(InFlight::Line(_) | InFlight::Control(_)));
        self.state == CommandState::Answers && (self.buffer.is_open() || is_others || !self.lines.is_empty())
    }

    fn is_under_way(&self) -> bool {
        self.under_way.is_some() || self.unsettled.is_some() || self.control_pending.is_some()
    }

    fn start(&mut self, command: InFlight, deadline: Instant, poll: Poll<'_>) {
        let now = poll.now;
        self.under_way = Some(UnderWay { command, deadline, since: now, taken: false, ended_by: None });
        self.line_is_next = match command {
            // It settles the end of the one before.
            InFlight::Check => self.line_is_next,
            _ => matches!(command, InFlight::Control(_)),
        };
        self.own_was_last = match command {
            InFlight::Identify | InFlight::Scan | InFlight::Character => true,
            InFlight::Line(_) => false,
            InFlight::Control(_)
            | InFlight::Buffer
            | InFlight::Address
            | InFlight::PutBack
            | InFlight::Check => self.own_was_last,
        };
        self.line_pace.begin();
        self.last_event = now;
        poll.publisher.counters().add(Counter::AsciiCommands, 1);
    }
}

#[cfg(test)]
#[path = "ascii_tests.rs"]
mod tests;
