//! What the bus thread does about the ports for command lines besides serving them: the mailboxes' interrupts, and what
//! is said when a port, or the way in use, changes.

use std::time::Instant;

use log::{info, warn};

use crate::daemon::bus::board_loop::BoardLoop;
use crate::protocol::{CommandPort, CommandState};
use crate::segment::Counter;

impl BoardLoop {
    pub(in crate::daemon) fn attend_mailbox(&mut self, readable: bool, now: Instant) {
        let Some(mailbox) = &mut self.functions.ascii.desk.port_mut().mailbox else { return };
        let interrupts = if readable { mailbox.take_interrupts(now) } else { 0 };
        mailbox.tend(now);
        let connected = mailbox.is_connected();
        if interrupts > 0 {
            self.publisher.counters().add(Counter::Interrupts, u64::from(interrupts));
            self.functions.ascii.desk.look_now(now);
        }
        if connected != self.told.mailbox {
            self.told.mailbox = connected;
            self.tell_interrupt();
        }
    }

    /// Whether the interrupts of the way in use are there has changed.
    pub(in crate::daemon) fn tell_interrupt(&mut self) {
        self.functions.ascii.desk.set_interrupt(self.has_interrupt());
        self.tell_enabled();
    }

    pub(in crate::daemon) fn has_interrupt(&self) -> bool {
        match self.functions.ascii.desk.port().way() {
            CommandPort::Dpram => self.told.interrupt,
            CommandPort::Mailbox => self.told.mailbox,
        }
    }

    pub(in crate::daemon) fn tell_port(&mut self) {
        let (way, state) = (self.functions.ascii.desk.port().way(), self.functions.ascii.desk.state());
        let before = self.told.port.replace((way, state));
        if before == Some((way, state)) {
            return;
        }
        if before.is_none_or(|(before, _)| before != way) {
            self.functions.ascii.desk.set_interrupt(self.has_interrupt());
        }
        self.info.set(|status| (status.command_port, status.command_state) = (way, state));
        match (way, state) {
            (_, CommandState::Unknown) => {}
            (CommandPort::Dpram, CommandState::Answers) => info!("DPRAM ASCII: live"),
            (CommandPort::Dpram, CommandState::Silent) => warn!("DPRAM ASCII: no answer (is I58=1?)"),
            (CommandPort::Mailbox, CommandState::Answers) => info!("VME mailboxes: live"),
            (CommandPort::Mailbox, CommandState::Silent) => {
                warn!("VME mailboxes: no answer (is I3=2? are both interrupts there?)");
            }
        }
        self.tell_enabled();
    }
}
