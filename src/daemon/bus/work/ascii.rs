//! Command lines for the board: many callers, one line at a time.
//!
//! Lines wait in order. Control characters overtake waiting lines; a stop or a cancel also replaces a control character
//! that the board has not yet taken. When no client waits, the daemon asks the board for its identity
//! ([`crate::daemon::bus::identify`]). Everything has a bound: the queues by the socket's hand-over, a command by its
//! deadline, a poll by its number of responses.

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

/// Most responses a poll takes: a chattering board must not hold up the servo data.
const STEPS_A_POLL: usize = 2;
/// With I64=1 the board puts this byte before an unsolicited text (Turbo Software Reference p. 67). The control word
/// tells the same.
const STX: u8 = 0x02;

/// One poll of the queue: its time, the receiver of its events, and the counters.
#[derive(Clone, Copy)]
struct Poll<'a> {
    events: &'a Sender<Event>,
    publisher: &'a Publisher,
    now: Instant,
}

/// The command under way; its kind names its owner.
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
    /// The line that gives the rotary buffers' opener the address back.
    PutBack,
    /// The question whether the board takes control characters by their word alone.
    Character,
    /// The daemon's line after an abandoned command, or behind a command whose end is open.
    Check,
}

#[derive(Clone, Copy)]
struct WaitingLine {
    ticket: Ticket,
    line: Line,
    origin: Origin,
    wait: Wait,
    writer: Writer,
    /// The user and character of the stop that dropped the line: the daemon no longer sends it.
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
    /// The board has shown that it works on the command.
    taken: bool,
    /// The control character that has ended the command.
    ended_by: Option<EndedBy>,
}

/// The control character that ended a command before the board answered.
#[derive(Clone, Copy)]
struct EndedBy {
    uid: u32,
    /// `^X`, which the board has taken, or a stop.
    character: u8,
    /// The board got only a part of the line, so it carries out nothing.
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
    /// The command whose end the probe settles.
    unsettled: Option<Unsettled>,
    /// Whether an error may be a program's.
    programs: Programs,
    /// The control character that waits in its word until the board takes it.
    control_pending: Option<WaitingControl>,
    /// The control character that waited at a reset, and whether the board may have taken it. The daemon still has to
    /// tell its caller.
    control_lost: Option<(Ticket, bool)>,
    /// How many `^K` the board has taken.
    kills: u64,
    /// Settles which command a response belongs to.
    check: Check,
    /// Whether the board takes control characters by their word alone.
    characters: Characters,
    /// Whether the board takes lines as program lines.
    buffer: OpenBuffer,
    /// When the daemon asks for an open buffer, and the answer.
    buffer_question: BufferQuestion,
    /// After a control character with a reply, a line has its turn if one waits.
    line_is_next: bool,
    /// After a question of the daemon's, too.
    own_was_last: bool,
    /// Events for the socket. While the outbox is full, the daemon takes nothing more from the board.
    outbox: Outbox,
    /// The identity, and when the daemon asks for it.
    pub identifier: Identifier,
    /// Where the board's own programs keep data, and when the daemon asks for that.
    pub scan: MemoryScan,
    state: CommandState,
    line_pace: LinePace,
    /// When the board last ended a command, the daemon's or a caller's.
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
            // A command may come back from a port that did not take it.
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

    /// Clears the host's words in the DPRAM. An earlier daemon may have left a line of the daemon's own there, with its
    /// reply still to come.
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

    /// Other data have stopped, so an earlier answer of the port proves nothing. The daemon asks the board again if it
    /// may.
    pub fn doubt(&mut self, now: Instant) {
        self.state = CommandState::Unknown;
        self.identifier.ask_again(now);
    }

    /// The board was reset or replaced: no buffer is open, and the board has forgotten the texts that it had to send.
    /// The daemon gives up the commands under way, so that the new board carries out none of the old board's. The board
    /// has not carried out a control character that is still in its word. The outcome of everything else is unknown: a
    /// board may clear a flag only when the line is done.
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
            // Now: the reset clears the flag, which would look like a taken first half of a line.
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

    /// Whether an answer waits for room in the socket's queue, so that the daemon takes nothing more from the board.
    #[must_use]
    pub fn is_held_up(&self) -> bool {
        !self.outbox.is_empty()
    }

    /// The progress of `^K`.
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

    /// Accepts a line or a control character.
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

    /// The board is a recording: it runs no program.
    #[must_use]
    pub const fn of_replay(mut self) -> Self {
        self.programs.is_replay = true;
        self
    }

    /// The last background report, asked for at a time on CLOCK_MONOTONIC, says whether a motion program runs; `None`:
    /// none tells.
    pub fn see_programs(&mut self, told: Option<(bool, u64)>) {
        self.programs.see(told);
    }

    /// A client or the panel may start a motion program without a line.
    pub fn may_start_program(&mut self) {
        self.programs.may_have_started(self.clock.ns());
    }

    /// Does the work that is due.
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

    /// Whether the daemon has asked the board something, or a question waits.
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
        // The loop does not wake up for a question that the daemon may not ask now.
        let question = if self.ports.in_doubt() {
            // While the window reads all ones, no line can begin; trying more often does not help.
            self.check.due_in(now).max(LINES_POLL_LATER)
        } else {
            let due = self.identifier.due_in(now).min(self.scan_due_in(now)).min(self.characters_due_in(now));
            due.max(self.questions_barred_for(now))
        };
        match (self.is_busy(), self.announced.is_sure()) {
            // The mailboxes' interrupts announce everything; the daemon watches only the time.
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

    /// Starts the next line: a caller's, or else a question of the daemon's.
    fn begin_next(&mut self, bus: &mut impl Bus, poll: Poll<'_>) -> Result<(), PortError> {
        let now = poll.now;
        if self.ports.in_doubt() {
            return self.begin_check(bus, poll);
        }
        let waits = |control: &WaitingControl| control_has_reply(control.character);
        if !self.line_is_next && self.control_pending.is_none() && self.controls.iter().any(waits) {
            // A steady stream of lines must not hold a control character up. It goes with the next poll.
            return Ok(());
        }
        let questions_wait = !self.questions_barred_for(now).is_zero();
        if let Some(&next) = self.lines.front()
            && (questions_wait || self.own_was_last || !self.is_question_overdue(now))
        {
            if now >= next.wait.begin_by {
                // The caller may already know the line as not done, so it must not start; [`Self::expire`] removes it.
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

    /// Asks a question of the daemon's own if one is due: for the identity, or, once the daemon knows that, where the
    /// board's programs keep data.
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

    /// How long until the daemon asks for M-variables; it never asks a board that does not answer.
    fn scan_due_in(&self, now: Instant) -> Duration {
        if self.state == CommandState::Answers { self.scan.due_in(now) } else { Duration::MAX }
    }

    /// Whether a question of the daemon's goes before the waiting lines.
    fn is_question_overdue(&self, now: Instant) -> bool {
        let scan_is_overdue = self.state == CommandState::Answers && self.scan.is_overdue(now);
        self.identifier.is_overdue(now) || scan_is_overdue
    }

    /// Whether other users keep the daemon from asking: the board answers their commands, or a program buffer is open.
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
            // This line settles the end of the command before it.
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
