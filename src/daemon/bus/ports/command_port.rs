//! The ports for command lines: the DPRAM's ASCII buffers and the VME mailboxes. A sender need not know which port
//! carries its line.
//!
//! If the mailboxes are the fallback, the daemon asks the board through them for I58, which tells whether the board
//! looks at the DPRAM's buffers. A line moves to the mailboxes only if the board left it unread before and after that
//! question, so that the board carries no line out twice.

use std::time::Instant;

use crate::daemon::bus::ports::mailbox::{MailboxAnswer, MailboxDriver, MailboxQuestion};
use crate::daemon::config::ports::MailboxUse;
use crate::daemon::shared::open_buffer;
use crate::device::Bus;
use crate::format::TextOrder;
use crate::function::ascii::DpramPort;
use crate::function::line_port::{AsciiEvent, LinePort, PortError};
use crate::map::Family;
use crate::protocol::CommandPort;

/// The open question about the last command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Doubt {
    /// Where the command's reply ends, or whether an error was the command's own or a program's. The reply to the next
    /// line settles that: the board answers lines in their order.
    ItsEnd,
    /// Whether the board still works on the command, or has more to say.
    WhatComes,
}

/// The ports, and the choice of the port that carries lines.
pub struct CommandPorts {
    /// The DPRAM's port.
    pub dpram: DpramPort,
    /// The mailbox circuit, on a board that has one.
    pub mailbox: Option<MailboxDriver>,
    in_use: CommandPort,
    /// The name of the variable that enables the DPRAM's port.
    enable: String,
    /// Responses taken from the DPRAM.
    responses: u64,
    /// Open until the board answers a probe: this host or the last one has abandoned a command, or a response that may
    /// be another command's ended it.
    doubt: Option<Doubt>,
    /// No client has sent anything yet; until a client does, the daemon asks nothing.
    is_unused: bool,
}

impl CommandPorts {
    /// The ports of a board of `family`, its texts packed in `order`.
    #[must_use]
    pub fn new(family: &'static Family, order: TextOrder, mailbox: Option<MailboxDriver>) -> Self {
        let always = mailbox.as_ref().is_some_and(|mailbox| mailbox.when() == MailboxUse::Always);
        Self {
            dpram: DpramPort::new(&family.ascii, order),
            mailbox,
            in_use: if always { CommandPort::Mailbox } else { CommandPort::Dpram },
            enable: format!("I{}", family.i.ascii_enable),
            responses: 0,
            doubt: None,
            is_unused: false,
        }
    }

    /// These ports after another host, which may have left the board at a line.
    #[must_use]
    pub fn after_another_host(mut self, now: Instant) -> Self {
        self.rest(now);
        self
    }

    /// The same, but the daemon asks the board nothing before a client sends something.
    #[must_use]
    pub const fn silent_until_used(mut self) -> Self {
        self.is_unused = true;
        self
    }

    /// A client sends something.
    pub fn begin_use(&mut self, now: Instant) {
        if std::mem::take(&mut self.is_unused) {
            self.rest(now);
        }
    }

    /// The port that lines go through.
    #[must_use]
    pub const fn in_use(&self) -> CommandPort {
        self.in_use
    }

    /// Moves lines to `port` from now on. No command may be under way.
    pub const fn change(&mut self, port: CommandPort) {
        self.in_use = port;
    }

    /// The port that lines go through.
    #[must_use]
    pub fn current(&self) -> &dyn LinePort {
        match (self.in_use, &self.mailbox) {
            (CommandPort::Mailbox, Some(mailbox)) => mailbox,
            _ => &self.dpram,
        }
    }

    /// The port that lines go through.
    pub fn current_mut(&mut self) -> &mut dyn LinePort {
        match (self.in_use, &mut self.mailbox) {
            (CommandPort::Mailbox, Some(mailbox)) => mailbox,
            _ => &mut self.dpram,
        }
    }

    /// Clears another host's line that keeps the daemon's lines from beginning: the board must not carry that line
    /// out by surprise later.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn clear_flag(&mut self, bus: &mut impl Bus, now: Instant) -> Result<(), PortError> {
        if self.in_use == CommandPort::Dpram && self.dpram.is_loaded(bus)? {
            self.dpram.clear_flag(bus, now)?;
            self.doubt();
        }
        Ok(())
    }

    fn rest(&mut self, now: Instant) {
        self.dpram.rest(now);
        self.doubt();
    }

    /// The board has taken `^X`, and sooner or later clears its words, also those of a line that is in them
    /// by then.
    pub fn follow_cancel(&mut self, now: Instant) {
        if self.in_use == CommandPort::Dpram {
            self.rest(now);
        }
    }

    /// Whether the board may still work on an abandoned command, whose reply would pass for the next command's. The
    /// reply to a probe ends the doubt: the board answers lines in their order.
    #[must_use]
    pub const fn in_doubt(&self) -> bool {
        self.doubt.is_some()
    }

    /// A reply may have been another command's, and the next reply as well.
    pub const fn doubt(&mut self) {
        self.doubt = Some(Doubt::WhatComes);
    }

    /// See [`AsciiEvent::Error`] and [`AsciiEvent::Taken`].
    pub fn doubt_its_end(&mut self) {
        self.doubt = self.doubt.or(Some(Doubt::ItsEnd));
    }

    /// Whether nothing is in doubt except where the command's reply ends.
    #[must_use]
    pub fn only_end_in_doubt(&self) -> bool {
        self.doubt == Some(Doubt::ItsEnd)
    }

    /// The board has answered the probe: the doubt is over.
    pub fn end_doubt(&mut self, now: Instant) {
        self.current_mut().finish(now);
        self.doubt = None;
    }

    /// Whether a control character waits for the board to take it.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn control_pending(&mut self, bus: &mut impl Bus, now: Instant) -> Result<bool, PortError> {
        let port = self.current_mut();
        let had_flag = port.flag_is_characters();
        let is_pending = port.control_pending(bus, now)?;
        if had_flag && !is_pending {
            // The board may acknowledge the empty line.
            self.doubt();
        }
        Ok(is_pending)
    }

    /// Gives up on the command under way, as [`LinePort::give_up`].
    ///
    /// # Errors
    /// [`PortError`].
    pub fn give_up(&mut self, bus: &mut impl Bus, now: Instant) -> Result<(), PortError> {
        self.doubt();
        self.current_mut().give_up(bus, now)
    }

    /// Does the work that is due and returns the next event.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn poll(&mut self, bus: &mut impl Bus, now: Instant) -> Result<Option<AsciiEvent>, PortError> {
        if let Some(mailbox) = &mut self.mailbox
            && let Some(event) = mailbox.poll(bus, now)?
        {
            return Ok(Some(event));
        }
        if self.in_use == CommandPort::Mailbox {
            return Ok(None);
        }
        let event = self.dpram.poll(bus, now)?;
        self.responses += u64::from(event.is_some());
        Ok(event)
    }

    /// Responses taken from the DPRAM so far.
    #[must_use]
    pub const fn responses(&self) -> u64 {
        self.responses
    }

    /// Accesses to the mailboxes' registers so far.
    #[must_use]
    pub fn register_accesses(&self) -> u64 {
        self.mailbox.as_ref().map_or(0, |mailbox| mailbox.registers.accesses())
    }

    /// Whether lines may go through the mailboxes instead, and their interrupts are there.
    #[must_use]
    pub fn may_change(&self) -> bool {
        self.mailbox
            .as_ref()
            .is_some_and(|mailbox| mailbox.when() == MailboxUse::Fallback && mailbox.is_connected())
    }

    /// Whether the daemon expects something from the board.
    #[must_use]
    pub fn is_waiting(&self) -> bool {
        self.mailbox.as_ref().is_some_and(MailboxDriver::is_asking) || !self.current().is_idle()
    }

    /// Makes the mailboxes ready, at start and after a reset of the board.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn start(&mut self, now: Instant) -> Result<(), PortError> {
        Ok(self.mailbox.as_mut().map_or(Ok(()), |mailbox| mailbox.start(now))?)
    }

    /// The name of the variable that enables the DPRAM's port: I58.
    #[must_use]
    pub fn enable(&self) -> &str {
        &self.enable
    }

    /// The DPRAM's page, if it has one. The daemon writes the page after every reset.
    #[must_use]
    pub fn page(&self) -> Option<u8> {
        self.mailbox.as_ref().and_then(MailboxDriver::page)
    }

    /// Writes the DPRAM's page, if it has one. Writing the right page again does no harm.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn select_page(&mut self) -> Result<(), PortError> {
        Ok(self.mailbox.as_mut().map_or(Ok(()), MailboxDriver::select_page)?)
    }

    /// Asks the board for I58 through the mailboxes; false: not now. I58 would enter an open program buffer: while the
    /// daemon does not know about a buffer, it asks for the buffer instead.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn ask(&mut self, is_buffer_known: bool, now: Instant) -> Result<bool, PortError> {
        let Some(mailbox) = &mut self.mailbox else { return Ok(false) };
        Ok(if is_buffer_known {
            mailbox.ask(MailboxQuestion::Enable, self.enable.as_bytes(), now)?
        } else {
            mailbox.ask(MailboxQuestion::Buffer, open_buffer::QUESTION, now)?
        })
    }

    /// The board's answer to `question`, once.
    pub fn take_answer(&mut self, question: MailboxQuestion) -> Option<MailboxAnswer> {
        self.mailbox.as_mut()?.take_answer(question)
    }
}
