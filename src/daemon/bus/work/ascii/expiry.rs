//! What becomes of commands whose deadline is over.

use std::time::Instant;

use super::{AsciiQueue, UnderWay};
use crate::daemon::bus::ports::command_port::PortError;
use crate::daemon::shared::queue::{Event, Outcome, Sender, Ticket};
use crate::device::Bus;
use crate::protocol::{CommandPort, CommandState};
use crate::segment::{Counter, Publisher};

impl AsciiQueue {
    /// Gives up on what is past its deadline.
    pub(super) fn expire(
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
                under_way.taken |= self.ports.give_up(bus, now)?;
                // A board clears the flag only when it has done the line. One that answered the line before may be at this one.
                under_way.taken |=
                    self.ports.in_use() == CommandPort::Dpram && self.state != CommandState::Silent;
            }
            // Who hears that it was not taken may send it again, so that is said only after a silence.
            if under_way.taken || self.ports.is_idle() {
                let UnderWay { command, taken, .. } = *under_way;
                self.under_way = None;
                match command.ticket() {
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
                self.outbox.tell(events, Event::Done(first.ticket, Outcome::Busy));
                return Ok(());
            }
            if self.ports.is_idle() {
                // Nothing of ours is under way, yet the line could not be command: an earlier one still lies in the
                // buffer with nobody to take it. It must not be carried out by surprise later.
                self.ports.withdraw_line(bus)?;
            }
            self.fail(events, publisher, first.ticket, false);
        }
        Ok(())
    }

    pub(super) fn fail(
        &mut self,
        events: &Sender<Event>,
        publisher: &Publisher,
        ticket: Ticket,
        taken: bool,
    ) {
        publisher.counters().add(Counter::AsciiTimeouts, 1);
        self.state = CommandState::Silent;
        let outcome = if taken { Outcome::TimedOut } else { Outcome::Unavailable };
        self.outbox.tell(events, Event::Done(ticket, outcome));
    }
}
