//! Ends commands that are past their deadline or cancelled.

use std::time::Instant;

use super::wait::Wait;
use super::{AsciiQueue, EndedBy, InFlight, Poll, UnderWay, WaitingControl, WaitingLine};
use crate::daemon::bus::timing::LINE_IS_SLOW;
use crate::daemon::shared::queue::{Event, GivenUp, Origin, Outcome, Text, Ticket, dropped_by, stopped_by};
use crate::daemon::shared::status::LinesStatus;
use crate::device::Bus;
use crate::function::line_port::PortError;
use crate::protocol::CommandState;
use crate::protocol::control::{self, CANCEL};
use crate::segment::Counter;

impl AsciiQueue {
    /// Gives up commands that are past their deadline or cancelled, and drops waiting lines after a stop.
    pub(super) fn expire(&mut self, bus: &mut impl Bus, poll: Poll<'_>) -> Result<(), PortError> {
        let now = poll.now;
        if let Some(under_way) = self.under_way
            && (now >= under_way.deadline || under_way.ended_by.is_some())
        {
            if under_way.ended_by.is_none() && self.check_lies() {
                self.expire_unsettled(poll, true);
                return self.expire_waiting(bus, poll);
            }
            self.under_way = None;
            // Without the probe's reply the board no longer settles the command.
            self.expire_unsettled(poll, true);
            self.give_up(bus, poll, &under_way)?;
        }
        self.expire_unsettled(poll, false);
        self.expire_waiting(bus, poll)
    }

    /// Answers callers whose lines waited in vain.
    fn expire_waiting(&mut self, bus: &mut impl Bus, poll: Poll<'_>) -> Result<(), PortError> {
        let now = poll.now;
        while self.outbox.is_empty() {
            let dropped = self.lines.iter().position(|line| line.dropped_by.is_some());
            if let Some(line) = dropped.and_then(|index| self.lines.remove(index))
                && let Some((uid, character)) = line.dropped_by
            {
                let outcome = Outcome::Dropped(dropped_by(uid, character));
                self.outbox.tell(poll.events, Event::Done(line.ticket, outcome));
                continue;
            }
            // Search the whole queue: a line with a later deadline may stand in front.
            let late = self.lines.iter().position(|line| now >= line.wait.begin_by);
            let Some(late) = late.and_then(|index| self.lines.remove(index)) else { break };
            if self.under_way.is_none() && self.ports.current().is_idle() {
                self.ports.clear_flag(bus, now)?;
            }
            self.not_begun(poll, late.ticket, late.wait);
        }
        Ok(())
    }

    /// Ends a command that the board may have carried out or may yet carry out.
    fn give_up(&mut self, bus: &mut impl Bus, poll: Poll<'_>, under_way: &UnderWay) -> Result<(), PortError> {
        let now = poll.now;
        self.ports.give_up(bus, now)?;
        if under_way.ended_by.is_some_and(|ended| ended.character == CANCEL) {
            // "<CTRL-X> will empty the command and response queues; it will also clear the control words" (manual p.
            // 27).
            self.ports.current_mut().withdraw(bus, now)?;
        }
        self.end_given_up(poll, under_way);
        Ok(())
    }

    /// Tells the caller that the daemon has given the command up.
    pub(super) fn end_given_up(&mut self, poll: Poll<'_>, under_way: &UnderWay) {
        let now = poll.now;
        let UnderWay { command, since, ended_by, .. } = *under_way;
        let Some((ticket, origin)) = self.caller_in_doubt(&command) else {
            return self.give_up_own(command, ended_by.is_some(), now);
        };
        match ended_by {
            Some(EndedBy { uid, character, unsent }) => {
                let outcome = if unsent {
                    Outcome::Dropped(dropped_by(uid, character))
                } else {
                    Outcome::Interrupted(stopped_by(uid, character))
                };
                self.outbox.tell(poll.events, Event::Done(ticket, outcome));
            }
            None => {
                self.check.give_up(GivenUp { by: origin, since });
                self.fail(poll, ticket, true);
            }
        }
    }

    /// The caller of a command that the board may have carried out; `None`: the daemon itself.
    pub(super) fn caller_in_doubt(&mut self, command: &InFlight) -> Option<(Ticket, Origin)> {
        match command {
            InFlight::Line(line) => {
                self.line_over(line);
                self.buffer.doubt(&line.line.meaning);
                Some((line.ticket, line.origin))
            }
            InFlight::Control(WaitingControl { ticket, uid, character, .. }) => {
                let shown = Text::of(&format_args!("^{}", control::letter(*character)));
                Some((*ticket, Origin { uid: *uid, shown, stays: false, may_move: true }))
            }
            InFlight::Identify
            | InFlight::Scan
            | InFlight::Buffer
            | InFlight::Address
            | InFlight::PutBack
            | InFlight::Character
            | InFlight::Check => None,
        }
    }

    /// Ends a line of the daemon's.
    pub(super) fn give_up_own(&mut self, command: InFlight, is_cancelled: bool, now: Instant) {
        match command {
            InFlight::Identify if is_cancelled => self.identifier.not_sent(),
            InFlight::Identify => {
                self.state = CommandState::Silent;
                self.identifier.failed(now);
            }
            InFlight::Scan if is_cancelled => self.scan.not_sent(),
            InFlight::Scan => {
                self.state = CommandState::Silent;
                self.scan.failed(now);
            }
            InFlight::Buffer if !is_cancelled => {
                self.state = CommandState::Silent;
                self.buffer_not_answered(now);
            }
            InFlight::Check if !is_cancelled => self.fail_check(now),
            InFlight::Address | InFlight::PutBack => self.buffer.told_address(None),
            InFlight::Character if is_cancelled => self.characters.not_taken(now),
            InFlight::Character => self.characters_not_taken(now),
            InFlight::Buffer | InFlight::Check | InFlight::Line(_) | InFlight::Control(_) => {}
        }
    }

    /// The board has taken this user's `^X` and works on nothing any more.
    pub(super) fn cancelled_by(&mut self, uid: u32, now: Instant) {
        self.check.reset();
        self.ports.follow_cancel(now);
        let unsettled = self.unsettled.as_mut().map(|unsettled| &mut unsettled.under_way);
        for under_way in self.under_way.iter_mut().chain(unsettled) {
            under_way.ended_by = Some(EndedBy { uid, character: CANCEL, unsent: false });
        }
    }

    /// The command that others wait for: an abandoned command, or the line under way.
    fn holds_port(&self) -> Option<GivenUp> {
        let unsettled = self.unsettled.as_ref().map(|unsettled| unsettled.under_way);
        let line = match unsettled.or(self.under_way) {
            Some(UnderWay { command: InFlight::Line(WaitingLine { origin, .. }), since, .. }) => {
                Some(GivenUp { by: origin, since })
            }
            _ => None,
        };
        self.check.given_up().or(line)
    }

    /// Writes the queue's part of `status`; the progress of the M-variables only `with_counts`. A line counts as
    /// holding the port only when it is slow, so that a quick line causes no two updates.
    pub fn tell(&self, status: &mut LinesStatus, with_counts: bool, now: Instant) {
        let is_given_up = self.check.given_up().is_some();
        status.holds_port =
            self.holds_port().filter(|holds| is_given_up || now >= holds.since + LINE_IS_SLOW);
        status.buffer = self.buffer.standing();
        status.enabling = self.identifier.enabling();
        status.changes = self.identifier.changes();
        let is_silent = self.state == CommandState::Silent;
        status.silent_since = status.silent_since.or(Some(now)).filter(|_| is_silent);
        let info = &mut status.info;
        info.command_port = self.ports.in_use();
        info.command_state = self.state;
        info.reply_end_missing = self.check.marks_no_end();
        info.answers_otherwise = self.check.is_answered_otherwise();
        info.control_characters = self.takes_characters();
        info.open_buffer_unsaid = status.buffer.is_unsaid;
        if with_counts {
            info.definitions = self.scan.progress();
        }
    }

    /// Tells a caller that the daemon sent nothing of the command, and why.
    pub(super) fn not_begun(&mut self, poll: Poll<'_>, ticket: Ticket, wait: Wait) {
        let now = poll.now;
        // A line that waited for other lines proves nothing about the board.
        let waited = self.under_way.is_some() || self.answered.is_some_and(|answered| answered >= wait.since);
        if let Some(holds) = self.holds_port() {
            self.outbox.tell(poll.events, Event::Done(ticket, Outcome::Refused(holds.reason(now))));
        } else if waited && (!self.ports.in_doubt() || self.ports.only_end_in_doubt()) {
            self.outbox.tell(poll.events, Event::Done(ticket, Outcome::Busy));
        } else {
            self.fail(poll, ticket, false);
        }
    }

    /// Tells a caller that the board does not answer. With `taken` the board may have the whole command.
    pub(super) fn fail(&mut self, poll: Poll<'_>, ticket: Ticket, taken: bool) {
        poll.publisher.counters().add(Counter::AsciiTimeouts, 1);
        self.state = CommandState::Silent;
        let (port, page) = (self.ports.in_use(), self.ports.page());
        let outcome = if taken { Outcome::TimedOut } else { Outcome::Unavailable { port, page } };
        self.outbox.tell(poll.events, Event::Done(ticket, outcome));
    }
}
