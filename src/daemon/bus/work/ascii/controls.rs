//! Control characters: they overtake the lines; a character with a reply waits until the port is idle.

use std::time::Instant;

use super::{AsciiQueue, EndedBy, InFlight, Poll, UnderWay, WaitingControl};
use crate::daemon::shared::queue::{Event, Outcome};
use crate::device::Bus;
use crate::function::ascii::control::{control_has_reply, goes_over_line};
use crate::function::line_port::PortError;
use crate::function::line_port::Stopped;
use crate::protocol::control::CANCEL;
use crate::protocol::{CommandPort, CommandState, control};
use crate::segment::Counter;

impl AsciiQueue {
    /// Hands over control characters, first the oldest that can go.
    pub(super) fn serve_controls(&mut self, bus: &mut impl Bus, poll: Poll<'_>) -> Result<(), PortError> {
        let now = poll.now;
        if let Some((ticket, taken)) = self.control_lost.take() {
            self.fail(poll, ticket, taken);
            return Ok(());
        }
        if let Some(pending) = self.control_pending {
            self.may_start_program();
            if !self.ports.control_pending(bus, now)? {
                self.control_pending = None;
                self.state = CommandState::Answers;
                if pending.character == CANCEL {
                    self.cancelled_by(pending.uid, now);
                }
                self.kills += u64::from(pending.character == control::KILL);
                self.outbox.tell(poll.events, Event::Done(pending.ticket, Outcome::Done));
            } else if now >= pending.wait.deadline {
                self.ports.current_mut().withdraw_control(bus, now)?;
                self.control_pending = None;
                // A board that answered so far may have taken the character at this moment.
                let taken = self.state != CommandState::Silent;
                self.fail(poll, pending.ticket, taken);
            }
            return Ok(());
        }
        // A character with a reply waits until the port is idle. A character without a reply waits for the line in the
        // port. A character that stops a machine waits neither for that line nor behind other characters.
        let is_idle = self.ports.current().is_idle() && !self.ports.in_doubt();
        let line_lies = self.ports.current().line_lies();
        let ready = |WaitingControl { character, wait, .. }: &WaitingControl| {
            let may_go = !control_has_reply(*character) && (!line_lies || goes_over_line(*character));
            now < wait.begin_by && (is_idle || may_go)
        };
        let Some(index) = self.controls.iter().position(ready) else {
            if let Some(late) = self.controls.front().copied().filter(|oldest| now >= oldest.wait.begin_by) {
                self.controls.pop_front();
                self.not_begun(poll, late.ticket, late.wait);
            }
            return Ok(());
        };
        let Some(&first) = self.controls.get(index) else { return Ok(()) };
        let behind_line = self.line_may_move();
        self.stop_line(bus, &first, now)?;
        let has_reply = control_has_reply(first.character);
        if self.ports.current_mut().control(bus, first.character, has_reply, now)? {
            self.controls.remove(index);
            self.last_event = now;
            self.stop_again(first.character, behind_line);
            if has_reply {
                self.start(InFlight::Control(first), first.wait.deadline, poll);
            } else {
                poll.publisher.counters().add(Counter::AsciiCommands, 1);
                self.may_start_program();
                self.control_pending = Some(first);
                self.end_overtaken(&first);
                let settles = self.ports.mailbox.as_ref().is_some_and(|mailbox| mailbox.port.is_settling());
                if let Some(under_way) = self.under_way.as_mut().filter(|_| settles)
                    && self.ports.in_use() == CommandPort::Mailbox
                {
                    // The character replaces a line that was in the port too long; nobody knows whether the board had
                    // taken the line.
                    under_way.deadline = now;
                }
            }
        }
        Ok(())
    }

    /// Whether the board has a line that may move something once it carries the line out, or had such a line that the
    /// daemon has given up.
    fn line_may_move(&self) -> bool {
        let unsettled = self.unsettled.as_ref().map(|unsettled| &unsettled.under_way);
        match unsettled.or(self.under_way.as_ref()) {
            Some(UnderWay { command: InFlight::Line(line), .. }) => line.line.meaning.may_move,
            Some(UnderWay { command: InFlight::Check, .. }) | None => {
                self.check.given_up().is_some_and(|given_up| given_up.by.may_move)
            }
            Some(_) => false,
        }
    }

    /// The daemon has handed over `character` at a board that may carry out a line behind it. If the character is a
    /// stop, the daemon then repeats it. `^R` and `^S` cancel the repetition.
    fn stop_again(&mut self, character: u8, behind_line: bool) {
        if matches!(character, control::RUN | control::STEP) {
            self.ports.dpram.forget_stop();
        } else if goes_over_line(character) && self.ports.in_use() == CommandPort::Dpram {
            self.ports.dpram.stop_again_behind(character, behind_line);
        }
    }

    /// `control` may have replaced a character that reports, and so ended that command.
    fn end_overtaken(&mut self, control: &WaitingControl) {
        if let Some(UnderWay { command: InFlight::Control(_) | InFlight::Character, ended_by, .. }) =
            &mut self.under_way
            && self.ports.in_use() == CommandPort::Dpram
            && !self.ports.dpram.is_asking()
        {
            let WaitingControl { uid, character, .. } = *control;
            *ended_by = Some(EndedBy { uid, character, unsent: false });
        }
    }

    /// Ends the line under way if `control` overrides it. A line that ends a sequence stays.
    fn stop_line(
        &mut self,
        bus: &mut impl Bus,
        control: &WaitingControl,
        now: Instant,
    ) -> Result<(), PortError> {
        let WaitingControl { uid, character, .. } = *control;
        let unsettled = self.unsettled.as_ref().map(|unsettled| &unsettled.under_way);
        let origin = match self.under_way.as_ref().or(unsettled) {
            Some(UnderWay { command: InFlight::Line(line), .. }) => Some(line.origin),
            Some(_) => None,
            None => self.check.given_up().map(|given_up| given_up.by),
        };
        if !goes_over_line(character) || origin.is_none_or(|origin| origin.stays) {
            return Ok(());
        }
        let stopped = self.ports.current_mut().stop(bus, character, now)?;
        let unsettled = self.unsettled.as_mut().map(|unsettled| &mut unsettled.under_way);
        let Some(under_way) = self.under_way.as_mut().or(unsettled) else { return Ok(()) };
        // Behind `^X` the line ends when the board has taken `^X`.
        if stopped != Stopped::Nothing && character != CANCEL {
            // If lines of a reply have come, the board carries out parts of the line.
            let unsent = stopped == Stopped::Unsent && !under_way.taken;
            under_way.ended_by = Some(EndedBy { uid, character, unsent });
        }
        Ok(())
    }
}
