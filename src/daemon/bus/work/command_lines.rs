//! Command lines as a function of the board, with the interrupts that announce responses.

use std::os::fd::BorrowedFd;
use std::time::Instant;

use log::warn;

use crate::clock::Clock;
use crate::daemon::bus::board_function::{BoardFunction, Context, Polled};
use crate::daemon::bus::ports::host_port::HostPortDriver;
use crate::daemon::bus::ports::interrupt::InterruptLink;
use crate::daemon::bus::ports::mailbox::MailboxDriver;
use crate::daemon::bus::readable::{Interrupts, Readable};
use crate::daemon::bus::work::ascii::AsciiQueue;
use crate::device::{Bus, BusError, Interrupt};
use crate::function::line_port::PortError;
use crate::protocol::{CommandPort, CommandState, HostPortCounts};
use crate::segment::Counter;

/// Command lines: their queue, and the interrupts that announce responses.
pub struct CommandLines {
    /// The queue, which decides which line waits for which.
    pub queue: AsciiQueue,
    /// Announces responses in the DPRAM, if the board has one.
    interrupt: Option<InterruptLink>,
    /// The interrupt controller, if the daemon has to serve it.
    host_port: Option<HostPortDriver>,
}

impl CommandLines {
    /// The lines of `queue`. `interrupt` and `host_port`, if there are any, announce responses in the DPRAM.
    #[must_use]
    pub const fn new(
        queue: AsciiQueue,
        interrupt: Option<InterruptLink>,
        host_port: Option<HostPortDriver>,
    ) -> Self {
        Self { queue, interrupt, host_port }
    }

    /// The counts of the host port's interrupts; `None` if the daemon does not serve it.
    #[must_use]
    pub fn host_port_counts(&self) -> Option<HostPortCounts> {
        self.host_port.as_ref().map(HostPortDriver::counts)
    }

    /// The descriptors that become readable when an interrupt comes.
    #[must_use]
    pub fn descriptors(&self) -> Interrupts<BorrowedFd<'_>> {
        let interrupt = self.interrupt.as_ref().and_then(InterruptLink::descriptor);
        let mailbox = self.queue.ports.mailbox.as_ref();
        let [taken, reply] = mailbox.map_or([None, None], MailboxDriver::descriptors);
        [interrupt, taken, reply]
    }

    /// Takes the interrupts that came, and connects the links that are not connected. Returns how many interrupts came.
    pub fn take_interrupts(&mut self, readable: &Readable, now: Instant) -> u32 {
        let mut count = 0;
        if let Some(link) = &mut self.interrupt {
            if readable.interrupt {
                count = link.take(now).interrupts;
                if let Some(host_port) = self.host_port.as_mut().filter(|_| count > 0) {
                    host_port.interrupted(self.queue.ports.responses());
                }
            }
            link.tend(now);
        }
        if let Some(mailbox) = &mut self.queue.ports.mailbox {
            if readable.mailbox {
                count = count.saturating_add(mailbox.take_interrupts(now));
            }
            mailbox.tend(now);
        }
        if count > 0 {
            self.queue.interrupt_came(now);
        }
        self.see_interrupt();
        count
    }

    /// Tells the queue whether the interrupts of the port in use are connected.
    fn see_interrupt(&mut self) {
        let ports = &self.queue.ports;
        let is_there = match ports.in_use() {
            CommandPort::Dpram => self.interrupt.as_ref().is_some_and(InterruptLink::is_connected),
            CommandPort::Mailbox => ports.mailbox.as_ref().is_some_and(MailboxDriver::is_connected),
        };
        self.queue.set_interrupt(is_there);
    }

    /// Opens the line of the host port's interrupt: at the start, and after a reset.
    ///
    /// # Errors
    /// When the registers cannot be reached.
    pub fn open_line(&mut self) -> Result<(), PortError> {
        Ok(self.host_port.as_mut().map_or(Ok(()), HostPortDriver::enable)?)
    }

    /// As [`Self::open_line`] if the line is shut: a reset that was too quick for the daemon to notice has shut it.
    ///
    /// # Errors
    /// When the registers cannot be reached.
    pub fn keep_line_open(&mut self) -> Result<(), PortError> {
        let Some(host_port) = &mut self.host_port else { return Ok(()) };
        if !host_port.is_open()? {
            host_port.enable()?;
        }
        Ok(())
    }

    /// Leaves the line of the host port's interrupt as the daemon found it.
    ///
    /// # Errors
    /// When the registers cannot be reached.
    pub fn leave_line(&mut self) -> Result<(), PortError> {
        Ok(self.host_port.as_mut().map_or(Ok(()), HostPortDriver::leave)?)
    }

    /// The board's memory was replaced, and perhaps the interrupt of its device: opens the registers again, too. A
    /// restarted simulator has other files for the registers.
    pub fn reopen(&mut self, interrupt: Option<Option<Interrupt>>) {
        if let (Some(link), Some(interrupt)) = (&mut self.interrupt, interrupt) {
            link.replace(interrupt);
        }
        if let Some(Err(error)) = self.queue.ports.mailbox.as_mut().map(MailboxDriver::reopen) {
            warn!("mailboxes: {error}");
        }
        if let Some(Err(error)) = self.host_port.as_mut().map(HostPortDriver::reopen) {
            warn!("host port: {error}");
        }
    }
}

impl<B: Bus> BoardFunction<B> for CommandLines {
    fn due_ns(&self, clock: &Clock) -> Option<u64> {
        Some(clock.ns_of(self.queue.due()))
    }
    fn poll(&mut self, context: &mut Context<'_, B>) -> Result<Polled, PortError> {
        let now = context.clock.now();
        let registers = self.queue.ports.register_accesses();
        self.queue.poll(context.bus, context.intake.events(), context.publisher, now)?;
        if let Some(host_port) = &mut self.host_port {
            let held_up = self.queue.is_held_up();
            if host_port.serve(context.bus, &self.queue.ports, held_up, now)? {
                self.queue.poll_now(now);
            }
        }
        self.see_interrupt();
        let registers = self.queue.ports.register_accesses() - registers;
        context.publisher.counters().add(Counter::AsciiAccesses, registers);
        Ok(Polled::default())
    }
    fn acquire(&mut self, context: &mut Context<'_, B>) -> Result<(), PortError> {
        Ok(self.queue.take_over(context.bus)?)
    }
    fn reset(&mut self, _context: &mut Context<'_, B>) -> Result<(), PortError> {
        Ok(())
    }
    fn leave(&mut self, bus: &mut B) -> Result<(), BusError> {
        self.queue.ports.dpram.release(bus)
    }
    fn is_live(&self) -> Option<bool> {
        Some(self.queue.state() == CommandState::Answers)
    }
    fn counter(&self) -> Option<Counter> {
        Some(Counter::AsciiAccesses)
    }
    fn watches(&self) -> bool {
        true
    }
}
