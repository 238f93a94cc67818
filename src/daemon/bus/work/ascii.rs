//! The desk in front of the board's ports for command lines: many callers, one line at a time.
//!
//! Lines wait in order; control characters do not wait, they overtake every line. The desk also asks the board who it
//! is ([`crate::daemon::bus::identify`]) when nobody else is being served. Which port the lines go through is `desk_ways.rs`'s. Everything is bounded: the queues by what the socket hands over,
//! a command by its deadline, a pass by the number of responses it takes.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use crate::clock::Clock;
use crate::daemon::bus::identify::Identifier;
use crate::daemon::bus::ports::command_port::{PortError, ResponsePort};
use crate::daemon::shared::queue::{
    Command, Event, LINE_MAX, Outcome, Sender, Text, Ticket, Unsolicited, at_once,
};
use crate::device::Bus;
use crate::function::ascii::{AsciiEvent, ResponseText, control_has_reply};
use crate::protocol::{CommandPort, CommandState, MessageKind, OpenBuffer};
use crate::segment::{Counter, Publisher};

/// Lines of a reply that the socket's thread is told at once: a long listing must not fill its queue.
const LINES_UNHEARD: u32 = 64;
/// Responses taken in one pass, so that a chattering board cannot hold up the servo data.
const STEPS_A_PASS: usize = 2;
/// How often to look while the board owes something: first soon, then less often.
const LOOK_SOON: Duration = Duration::from_micros(100);
const LOOK_LATER: Duration = Duration::from_millis(1);
/// How long it is looked for soon after the last thing that happened.
const SOON: Duration = Duration::from_millis(20);
/// How often to look for unsolicited texts when nothing is owed: without an interrupt, and with one that may be lost.
const LOOK_IDLE: Duration = Duration::from_millis(20);
const LOOK_IDLE_WITH_INTERRUPT: Duration = Duration::from_secs(1);

/// A command under way, and so who it is for.
#[derive(Clone, Copy)]
pub(in crate::daemon) enum Begun {
    Line(Waiting),
    Control(WaitingControl),
    Question,
}

impl Begun {
    fn ticket(&self) -> Option<Ticket> {
        match self {
            Self::Line(line) => Some(line.ticket),
            Self::Control(control) => Some(control.ticket),
            Self::Question => None,
        }
    }
}

#[derive(Clone, Copy)]
pub(in crate::daemon) struct Waiting {
    ticket: Ticket,
    line: Text<LINE_MAX>,
    deadline: Instant,
    question: bool,
}

#[derive(Clone, Copy)]
pub(in crate::daemon) struct WaitingControl {
    ticket: Ticket,
    character: u8,
    deadline: Instant,
}

#[derive(Clone, Copy)]
pub(in crate::daemon) struct UnderWay {
    pub(in crate::daemon) begun: Begun,
    deadline: Instant,
    /// The board has shown that it works on it, or may do so.
    pub(in crate::daemon) taken: bool,
    /// Its time is over, and the port waits for what may still come of it.
    given_up: bool,
}

/// The desk.
pub struct AsciiDesk {
    pub(in crate::daemon) port: ResponsePort,
    pub(in crate::daemon) lines: VecDeque<Waiting>,
    pub(in crate::daemon) controls: VecDeque<WaitingControl>,
    pub(in crate::daemon) under_way: Option<UnderWay>,
    /// The control character that lies in its word, until the board takes it.
    pub(in crate::daemon) control_lies: Option<WaitingControl>,
    /// One that lay there when the board was forgotten, and whether that may have taken it; its caller is to be told.
    control_lost: Option<(Ticket, bool)>,
    /// Whether the board takes lines as program lines.
    pub(in crate::daemon) buffer: OpenBuffer,
    /// Lines of a reply told since something else was.
    lines_unheard: u32,
    /// An event the socket's queue had no room for. Until it is gone nothing more is taken from the board.
    outbox: Option<Event>,
    /// The identity, and when it is asked.
    pub identifier: Identifier,
    pub(in crate::daemon) state: CommandState,
    /// Since when the DPRAM's port has left something lying.
    pub(in crate::daemon) stuck_since: Option<Instant>,
    /// When the board may be asked again which port it looks at.
    pub(in crate::daemon) next_ask: Instant,
    last_event: Instant,
    next_look: Instant,
    has_interrupt: bool,
    clock: Clock,
}

impl AsciiDesk {
    /// A desk for `port`.
    #[must_use]
    pub fn new(port: ResponsePort, identifier: Identifier, clock: Clock) -> Self {
        let now = clock.now();
        Self {
            port,
            // One may come back from a port that did not take it.
            lines: VecDeque::with_capacity(at_once::LINES + 1),
            controls: VecDeque::with_capacity(at_once::CONTROLS + 1),
            under_way: None,
            control_lies: None,
            control_lost: None,
            buffer: OpenBuffer::default(),
            lines_unheard: 0,
            outbox: None,
            identifier,
            state: CommandState::Unknown,
            stuck_since: None,
            next_ask: now,
            last_event: now,
            next_look: now,
            has_interrupt: false,
            clock,
        }
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
    /// commands under way are given up, so that the new board does nothing of what the old one was told. What lies untouched
    /// was not carried out; of everything else nobody knows.
    ///
    /// # Errors
    /// When a port cannot be reached.
    pub fn forget(&mut self, bus: &mut impl Bus, now: Instant) -> Result<(), PortError> {
        self.buffer = OpenBuffer::default();
        if let Some(lying) = self.control_lies.take() {
            let taken = self.port.dpram.is_out_of_reach(bus)? || !self.port.control_lies(bus)?;
            self.control_lost = Some((lying.ticket, taken));
            self.port.withdraw_control(bus, now)?;
        }
        if let Some(under_way) = &mut self.under_way {
            under_way.deadline = now;
            match self.port.way() {
                CommandPort::Mailbox => under_way.taken = true,
                // Now, before a cleared flag is taken for the board's having taken the first half of a line.
                CommandPort::Dpram if !std::mem::replace(&mut under_way.given_up, true) => {
                    under_way.taken |= self.port.give_up(bus, now)?;
                }
                CommandPort::Dpram => {}
            }
        }
        self.look_now(now);
        self.port.start(now)
    }

    /// Whether an answer waits for room in the socket's queue, so that nothing more is taken from the board.
    #[must_use]
    pub fn is_held_up(&self) -> bool {
        self.outbox.is_some()
    }

    /// The ports for command lines.
    #[must_use]
    pub fn port(&self) -> &ResponsePort {
        &self.port
    }

    /// The ports for command lines.
    pub fn port_mut(&mut self) -> &mut ResponsePort {
        &mut self.port
    }

    /// What a report of the board says of its program buffers, which others may open too.
    pub fn see_buffer(&mut self, open: bool) {
        self.buffer.see(open);
    }

    /// Whether interrupts announce responses, so that they need not be looked for so often.
    pub fn set_interrupt(&mut self, has_interrupt: bool) {
        self.has_interrupt = has_interrupt;
        self.next_look = self.clock.now();
    }

    /// When to pass next.
    #[must_use]
    pub fn due(&self) -> Instant {
        self.next_look
    }

    /// An interrupt came, or a command: look at once.
    pub fn look_now(&mut self, now: Instant) {
        self.last_event = now;
        self.next_look = now;
    }

    /// Takes a line or control character in.
    pub fn submit(&mut self, command: &Command, now: Instant) {
        match *command {
            Command::Send { ticket, line, deadline, question } => {
                self.lines.push_back(Waiting { ticket, line, deadline, question });
            }
            Command::Control { ticket, character, deadline } => {
                self.controls.push_back(WaitingControl { ticket, character, deadline });
            }
            Command::ReadWords { .. } | Command::Job { .. } => {}
        }
        if let Command::Send { line, .. } = command
            && Identifier::may_be_changed_by(line.as_bytes())
        {
            self.ask_way_soon(now);
        }
        self.look_now(now);
    }

    /// Does what can be done now.
    ///
    /// # Errors
    /// When a port cannot be reached.
    pub fn pass(
        &mut self,
        bus: &mut impl Bus,
        events: &Sender<Event>,
        publisher: &Publisher,
        now: Instant,
    ) -> Result<(), PortError> {
        if let Some(event) = self.outbox.take() {
            self.tell(events, event);
        }
        if self.outbox.is_none() {
            self.serve_controls(bus, events, publisher, now)?;
        }
        for _ in 0..STEPS_A_PASS {
            if self.outbox.is_some() {
                break;
            }
            let Some(event) = self.port.step(bus, now)? else { break };
            self.last_event = now;
            self.handle(events, publisher, event);
        }
        self.consider_ways(bus, now)?;
        if self.outbox.is_none() {
            self.expire(bus, events, publisher, now)?;
        }
        if self.outbox.is_none() && self.under_way.is_none() && self.port.is_idle() {
            self.begin_next(bus, events, publisher, now)?;
        }
        self.next_look = now + self.patience(now);
        Ok(())
    }

    fn patience(&self, now: Instant) -> Duration {
        let owed = self.under_way.is_some()
            || self.port.is_waiting()
            || self.control_lies.is_some()
            || self.control_lost.is_some()
            || self.outbox.is_some()
            || !self.lines.is_empty()
            || !self.controls.is_empty();
        // What cannot be asked now is not waited for.
        let question = if self.buffer.is_open() { Duration::MAX } else { self.identifier.due_in(now) };
        match (owed, self.has_interrupt) {
            // The mailboxes' interrupts tell everything; only time has to be watched.
            (true, _)
                if self.port.way() == CommandPort::Dpram && now.duration_since(self.last_event) < SOON =>
            {
                LOOK_SOON
            }
            (true, _) => LOOK_LATER,
            (false, false) => LOOK_IDLE.min(question),
            (false, true) => LOOK_IDLE_WITH_INTERRUPT.min(question),
        }
    }

    /// Hands over control characters, the first that can go first.
    fn serve_controls(
        &mut self,
        bus: &mut impl Bus,
        events: &Sender<Event>,
        publisher: &Publisher,
        now: Instant,
    ) -> Result<(), PortError> {
        if let Some((ticket, taken)) = self.control_lost.take() {
            self.fail(events, publisher, ticket, taken);
            return Ok(());
        }
        if let Some(lying) = self.control_lies {
            if !self.port.control_lies(bus)? {
                self.control_lies = None;
                self.state = CommandState::Answers;
                self.tell(events, Event::Done(lying.ticket, Outcome::Done));
            } else if now >= lying.deadline {
                self.port.withdraw_control(bus, now)?;
                self.control_lies = None;
                self.fail(events, publisher, lying.ticket, false);
            }
            return Ok(());
        }
        // One with a reply has to wait until the port is idle. What stops a machine does not wait behind it.
        let ready = |control: &WaitingControl| self.port.is_idle() || !control_has_reply(control.character);
        if let Some(&oldest) = self.controls.front()
            && now >= oldest.deadline
        {
            self.controls.pop_front();
            self.fail(events, publisher, oldest.ticket, false);
            return Ok(());
        }
        let Some(index) = self.controls.iter().position(ready) else { return Ok(()) };
        let Some(&first) = self.controls.get(index) else { return Ok(()) };
        let has_reply = control_has_reply(first.character);
        if self.port.control(bus, first.character, has_reply, now)? {
            self.controls.remove(index);
            self.buffer.follow_control(first.character);
            self.last_event = now;
            publisher.counters().add(Counter::AsciiCommands, 1);
            if has_reply {
                let begun = Begun::Control(first);
                self.under_way =
                    Some(UnderWay { begun, deadline: first.deadline, taken: false, given_up: false });
            } else {
                self.control_lies = Some(first);
                let settles = self.port.mailbox.as_ref().is_some_and(|mailbox| mailbox.port.is_settling());
                if let Some(under_way) = self.under_way.as_mut().filter(|it| settles && !it.given_up)
                    && self.port.way() == CommandPort::Mailbox
                {
                    // It went over a line that lay too long; whether the board had taken that nobody knows.
                    (under_way.taken, under_way.given_up, under_way.deadline) = (true, true, now);
                }
            }
        }
        Ok(())
    }

    /// Starts the next line: a caller's, or else the identifier's.
    fn begin_next(
        &mut self,
        bus: &mut impl Bus,
        events: &Sender<Event>,
        publisher: &Publisher,
        now: Instant,
    ) -> Result<(), PortError> {
        if let Some(&next) = self.lines.front()
            && (self.buffer.is_open() || !self.identifier.is_overdue(now))
        {
            if next.question && self.buffer.is_open() {
                self.lines.pop_front();
                self.tell(events, Event::Done(next.ticket, Outcome::Unavailable));
                return Ok(());
            }
            // Its caller has been told by now that it was not done. So must it be; [`Self::expire`] takes it away.
            if now < next.deadline && self.port.begin(bus, next.line.as_bytes())? {
                self.lines.pop_front();
                self.buffer.follow(next.line.as_bytes());
                self.start(Begun::Line(next), next.deadline, publisher, now);
            }
        } else if !self.buffer.is_open()
            && let Some((line, patience)) = self.identifier.next_line(now)
            && self.port.begin(bus, line.as_bytes())?
        {
            self.identifier.sent();
            self.start(Begun::Question, now + patience, publisher, now);
        }
        Ok(())
    }

    fn start(&mut self, begun: Begun, deadline: Instant, publisher: &Publisher, now: Instant) {
        self.under_way = Some(UnderWay { begun, deadline, taken: false, given_up: false });
        self.last_event = now;
        publisher.counters().add(Counter::AsciiCommands, 1);
    }

    /// Gives up on what is past its deadline.
    fn expire(
        &mut self,
        bus: &mut impl Bus,
        events: &Sender<Event>,
        publisher: &Publisher,
        now: Instant,
    ) -> Result<(), PortError> {
        if let Some(under_way) = &mut self.under_way
            && now >= under_way.deadline
        {
            if !std::mem::replace(&mut under_way.given_up, true) {
                under_way.taken |= self.port.give_up(bus, now)?;
                // A board clears the flag only when it has done the line. One that answered the line before may be at this one.
                under_way.taken |=
                    self.port.way() == CommandPort::Dpram && self.state != CommandState::Silent;
            }
            // Who hears that it was not taken may send it again, so that is said only after a silence.
            if under_way.taken || self.port.is_idle() {
                let UnderWay { begun, taken, .. } = *under_way;
                self.under_way = None;
                match begun.ticket() {
                    Some(ticket) => self.fail(events, publisher, ticket, taken),
                    None => {
                        self.identifier.failed(now);
                        self.state = CommandState::Silent;
                    }
                }
                return Ok(());
            }
        }
        if let Some(&first) = self.lines.front()
            && now >= first.deadline
        {
            self.lines.pop_front();
            if self.under_way.is_some() {
                // That it waited for another one says nothing of the board.
                self.tell(events, Event::Done(first.ticket, Outcome::Busy));
                return Ok(());
            }
            if self.port.is_idle() {
                // Nothing of ours is under way, yet the line could not be begun: an earlier one still lies in the
                // buffer with nobody to take it. It must not be carried out by surprise later.
                self.port.withdraw_line(bus)?;
            }
            self.fail(events, publisher, first.ticket, false);
        }
        Ok(())
    }

    fn fail(&mut self, events: &Sender<Event>, publisher: &Publisher, ticket: Ticket, taken: bool) {
        publisher.counters().add(Counter::AsciiTimeouts, 1);
        self.state = CommandState::Silent;
        let outcome = if taken { Outcome::TimedOut } else { Outcome::Unavailable };
        self.tell(events, Event::Done(ticket, outcome));
    }

    fn handle(&mut self, events: &Sender<Event>, publisher: &Publisher, event: AsciiEvent) {
        let counters = publisher.counters();
        match event {
            AsciiEvent::Line(text) => {
                counters.add(Counter::AsciiReplies, 1);
                if let Some(under_way) = &mut self.under_way {
                    under_way.taken = true;
                    match under_way.begun.ticket() {
                        Some(ticket) => self.tell(events, Event::Line(ticket, text)),
                        None => self.identifier.line(text.as_bytes()),
                    }
                }
            }
            AsciiEvent::Done(result) => {
                counters.add(Counter::AsciiErrors, u64::from(result.is_err()));
                self.state = CommandState::Answers;
                match self.under_way.take().map(|under_way| under_way.begun.ticket()) {
                    Some(Some(ticket)) => {
                        let outcome = result.map_or_else(Outcome::Error, |()| Outcome::Done);
                        self.tell(events, Event::Done(ticket, outcome));
                    }
                    Some(None) => self.identifier.done(),
                    None => {}
                }
            }
            AsciiEvent::ProgramResponse(text) => self.unsolicited(events, publisher, MessageKind::Cmd, &text),
            AsciiEvent::ProgramMessage(text) => self.unsolicited(events, publisher, MessageKind::Send, &text),
            AsciiEvent::Stale(_) => {
                counters.add(Counter::AsciiUnsolicited, 1);
                if let Some(under_way) = self.under_way.as_mut().filter(|under_way| under_way.given_up) {
                    under_way.taken = true;
                }
            }
        }
    }

    fn unsolicited(
        &mut self,
        events: &Sender<Event>,
        publisher: &Publisher,
        kind: MessageKind,
        text: &ResponseText,
    ) {
        publisher.counters().add(Counter::AsciiUnsolicited, 1);
        self.tell(events, Event::Unsolicited(Unsolicited { time_ns: self.clock.ns(), kind, text: *text }));
    }

    /// Puts an event into the socket's queue, or keeps it until there is room. A line of a reply is told with the reply's end.
    fn tell(&mut self, events: &Sender<Event>, event: Event) {
        debug_assert!(self.outbox.is_none(), "what waits for room is told first");
        let is_line = matches!(event, Event::Line(..));
        self.lines_unheard = if is_line { self.lines_unheard + 1 } else { 0 };
        let wakes = self.lines_unheard.is_multiple_of(LINES_UNHEARD);
        self.outbox = if wakes { events.try_send(event) } else { events.try_put(event) }.err();
    }
}

#[cfg(test)]
#[path = "ascii_tests.rs"]
mod tests;
