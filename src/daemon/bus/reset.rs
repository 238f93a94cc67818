//! What a reset of the board undoes, done again: the DPRAM's page, the mailboxes' permission to send, the host port's line.

use log::{info, warn};

use crate::daemon::bus::board_loop::BoardLoop;
use crate::daemon::bus::ports::command_port::{PortError, ResponsePort};
use crate::daemon::bus::ports::host_port::HostPortLink;
use crate::daemon::bus::ports::mailbox::MailboxLink;
use crate::protocol::Function;

impl BoardLoop {
    /// Writes the page while the DPRAM reads as all ones: a reset has had the board forget it. 1 read.
    pub(in crate::daemon) fn guard_page(&mut self) -> Result<(), PortError> {
        let ResponsePort { dpram, mailbox, .. } = self.functions.ascii.desk.port_mut();
        let Some(mailbox) = mailbox.as_mut().filter(|mailbox| mailbox.page().is_some()) else {
            return Ok(());
        };
        let out_of_reach = dpram.is_out_of_reach(&mut self.bus)?;
        if out_of_reach {
            mailbox.select_page()?;
        }
        match (std::mem::replace(&mut self.condition.out_of_reach, out_of_reach), out_of_reach) {
            (false, true) => {
                warn!("the DPRAM is out of reach, so the board was reset; writing its page");
                self.condition.reset_known = true;
                self.after_reset(true)?;
            }
            (true, false) => {
                info!("the DPRAM is in reach, its page is selected");
                self.start_over();
            }
            _ => {}
        }
        Ok(())
    }

    /// A memory test, a power failure or another host may have left the host's own words in a state that holds the
    /// reports off for ever, and a reset that was too quick to be noticed has shut the interrupt's line.
    pub(in crate::daemon) fn let_board_speak(&mut self) -> Result<(), PortError> {
        if self.functions.uses(Function::Servo) && !self.functions.servo.is_live() {
            self.functions.servo.release(&mut self.bus)?;
        }
        if self.functions.uses(Function::Background) && !self.functions.background.is_live() {
            self.functions.background.acquire(&mut self.bus, self.clock.ns())?;
        }
        if let Some(host_port) = &mut self.functions.ascii.host_port
            && !host_port.is_open()?
        {
            host_port.enable()?;
        }
        Ok(())
    }

    /// A board whose data stop may have been reset; the page it has already does no harm.
    pub(in crate::daemon) fn page_again(&mut self) {
        let mailbox = self.functions.ascii.desk.port_mut().mailbox.as_mut();
        if let Some(Err(error)) = mailbox.map(MailboxLink::select_page) {
            self.bus_failed(&error);
        }
    }

    /// The board was reset: what it forgets is told to it again. What goes through the mailboxes now was begun before the
    /// reset if it `is_news`.
    pub(in crate::daemon) fn after_reset(&mut self, is_news: bool) -> Result<(), PortError> {
        self.page_again();
        if let Some(host_port) = &mut self.functions.ascii.host_port {
            host_port.enable()?;
        }
        let (functions, mut context) = self.functions_in_context();
        functions.reset(&mut context)?;
        self.functions.ascii.desk.identifier.ask_again(self.clock.now());
        if is_news { self.forget_commands() } else { Ok(()) }
    }

    /// Ends the commands under way: they were the board's that is no more.
    pub(in crate::daemon) fn forget_commands(&mut self) -> Result<(), PortError> {
        self.functions.ascii.desk.forget(&mut self.bus, self.clock.now())
    }

    /// The simulator that was started again has files of its own for these, too.
    pub(in crate::daemon) fn reopen_registers(&mut self) {
        let mailbox = self.functions.ascii.desk.port_mut().mailbox.as_mut().map(MailboxLink::reopen);
        if let Some(Err(error)) = mailbox {
            warn!("mailboxes: {error}");
        }
        if let Some(Err(error)) = self.functions.ascii.host_port.as_mut().map(HostPortLink::reopen) {
            warn!("host port: {error}");
        }
        self.page_again();
    }
}
