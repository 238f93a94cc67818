//! The other way to the board: lines go through the mailboxes when the board does not look at the DPRAM's port.

use std::time::Instant;

use log::{info, warn};

use super::{AsciiQueue, InFlight};
use crate::daemon::bus::ports::fallback::{Change, Waiting};
use crate::daemon::bus::ports::mailbox::MailboxQuestion;
use crate::device::Bus;
use crate::function::line_port::PortError;
use crate::protocol::CommandState;

impl AsciiQueue {
    /// Moves lines to another port if the board does not look at this port.
    pub(super) fn consider_fallback(&mut self, bus: &mut impl Bus, now: Instant) -> Result<(), PortError> {
        if !self.ports.may_change() {
            return Ok(());
        }
        let under_way = self.is_under_way();
        if let Some(answer) = self.ports.take_answer(MailboxQuestion::Buffer) {
            self.buffer.learn(answer.value, now);
            if !self.buffer.is_open() {
                self.fallback.ask_again(now);
            }
        }
        if let Some(change) = self.fallback.wanted(&mut self.ports, under_way, bus, now)? {
            if change == Change::Enabled || self.take_back(bus, now)? {
                // The board must not carry out a given-up command in this port once somebody switches the port on
                // again.
                self.ports.current_mut().withdraw(bus, now)?;
                self.change_port(change, now);
            } else {
                self.fallback.ask_again(now);
            }
        }
        let waiting = Waiting {
            untouched: self.has_untouched(now),
            under_way: self.is_under_way(),
            buffer_open: self.buffer.is_known(now).then(|| self.buffer.is_open()),
        };
        self.fallback.ask(&mut self.ports, waiting, now)
    }

    fn change_port(&mut self, change: Change, now: Instant) {
        let enable = self.ports.enable();
        match change {
            Change::OutOfReach => warn!("command lines: VME mailboxes, the DPRAM is out of reach"),
            Change::Disabled => warn!("command lines: VME mailboxes, {enable}=0"),
            Change::Enabled => info!("command lines: DPRAM, {enable}=1"),
        }
        self.ports.change(change.port());
        if let Some(unsettled) = &mut self.unsettled {
            unsettled.under_way.deadline = now;
        }
        self.state = CommandState::Unknown;
        self.poll_now(now);
    }

    /// Whether a command waits that the board has not touched, as far as the daemon knows.
    fn has_untouched(&self, now: Instant) -> bool {
        match self.under_way {
            Some(under_way) => !under_way.taken && !self.ports.current().was_taken(),
            None => {
                let has_question = self.ports.in_doubt() || self.identifier.due_in(now).is_zero();
                let asks = has_question && self.questions_barred_for(now).is_zero();
                self.control_pending.is_some() || !self.lines.is_empty() || !self.controls.is_empty() || asks
            }
        }
    }

    /// Takes the waiting commands back from the DPRAM's port, for another port; false if the board has touched them.
    fn take_back(&mut self, bus: &mut impl Bus, now: Instant) -> Result<bool, PortError> {
        if let Some(control) = self.control_pending {
            if !self.ports.dpram.control_pending(bus, now)? {
                return Ok(false);
            }
            self.ports.dpram.withdraw_control(bus)?;
            self.control_pending = None;
            self.controls.push_front(control);
        }
        let Some(under_way) = self.under_way else { return Ok(true) };
        if under_way.taken || !self.ports.dpram.take_back(bus, now)? {
            return Ok(false);
        }
        self.under_way = None;
        match under_way.command {
            InFlight::Line(line) => self.lines.push_front(line),
            InFlight::Control(control) => self.controls.push_front(control),
            InFlight::Identify => self.identifier.not_sent(),
            InFlight::Scan => self.scan.not_sent(),
            InFlight::Character => self.characters.not_taken(now),
            InFlight::Buffer | InFlight::Address | InFlight::PutBack | InFlight::Check => {}
        }
        Ok(true)
    }
}
