//! The ports for command lines: the DPRAM's ASCII buffers and the VME mailboxes. Who sends a line need not know which.
//!
//! Where the mailboxes are the fallback, the board is asked for I58 through them: it tells whether the board looks at
//! the DPRAM's buffers at all. A line goes through the other port only when it stayed unread in the DPRAM before and
//! after that question, so that no line is carried out twice.

use std::time::{Duration, Instant};

use crate::daemon::bus::ports::mailbox::MailboxDriver;
use crate::daemon::config::ports::Use;
use crate::daemon::shared::open_buffer;
use crate::device::{Bus, BusError, ByteBusError};
use crate::format::TextOrder;
use crate::function::ascii::stop::Stopped;
use crate::function::ascii::{AsciiEvent, DpramPort};
use crate::map::Family;
use crate::protocol::{CommandPort, answer};

/// How long the board may take to say what I58 is.
const PATIENCE: Duration = Duration::from_millis(500);
/// A port cannot be reached.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PortError {
    /// The DPRAM.
    #[error(transparent)]
    Dpram(#[from] BusError),
    /// The mailboxes, or the host port.
    #[error(transparent)]
    Registers(#[from] ByteBusError),
}

/// What the board said of the variable that enables the DPRAM's port (I58).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Answer {
    /// 0: it does not look at the DPRAM's buffers.
    Off,
    /// Another value.
    On,
    /// Nothing that is understood.
    None,
}

/// What is not known of the command before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Doubt {
    /// Where its reply ends, or whether an error was its own or a program's. The board answers lines in their order: with the reply
    /// to the next one that is known.
    ItsEnd,
    /// Whether the board is still at it, or has more to say.
    WhatComes,
}

/// What the board has answered, through the mailboxes, to the question for a program buffer: the free memory, or nothing of use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BufferAnswer(pub Option<i64>);

/// A question through the mailboxes.
struct Question {
    until: Instant,
    /// It is the one for a program buffer, not the one for I58.
    is_for_buffer: bool,
    value: Option<i64>,
}

/// The ports, and which of them lines go through.
pub struct CommandPorts {
    /// The DPRAM's.
    pub dpram: DpramPort,
    /// The mailbox circuit, on a board that has one.
    pub mailbox: Option<MailboxDriver>,
    in_use: CommandPort,
    /// The name of the variable that enables the DPRAM's port.
    enable: String,
    question: Option<Question>,
    answer: Option<Answer>,
    buffer_answer: Option<BufferAnswer>,
    /// Responses taken from the DPRAM.
    responses: u64,
    /// What is not known since no line of our own has been answered: a command was given up, here or by the host before, or ended by
    /// what need not be its own.
    doubt: Option<Doubt>,
    /// Nobody has sent the board anything yet, and it is not asked of its own accord.
    is_unused: bool,
}

impl CommandPorts {
    /// The ports of a board of `family`, its texts packed in `order`.
    #[must_use]
    pub fn new(family: &'static Family, order: TextOrder, mailbox: Option<MailboxDriver>) -> Self {
        let always = mailbox.as_ref().is_some_and(|mailbox| mailbox.when() == Use::Always);
        Self {
            dpram: DpramPort::new(&family.ascii, order),
            mailbox,
            in_use: if always { CommandPort::Mailbox } else { CommandPort::Dpram },
            enable: format!("I{}", family.i.ascii_enable),
            question: None,
            answer: None,
            buffer_answer: None,
            responses: 0,
            doubt: None,
            is_unused: false,
        }
    }

    /// Another host may have left the board at a line.
    #[must_use]
    pub fn after_another_host(mut self, now: Instant) -> Self {
        self.rest(now);
        self
    }

    /// The same, but the board is asked nothing before somebody sends it something.
    #[must_use]
    pub const fn silent_until_used(mut self) -> Self {
        self.is_unused = true;
        self
    }

    /// Somebody sends the board something.
    pub fn begin_use(&mut self, now: Instant) {
        if std::mem::take(&mut self.is_unused) {
            self.rest(now);
        }
    }

    /// Nothing of ours is under way, yet a line could not be begun. What lies there must not be carried out by surprise later.
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

    /// The board has taken `^X` and clears its words, sooner or later: also those of a line that would lie there by then.
    pub fn follow_cancel(&mut self, now: Instant) {
        if self.in_use == CommandPort::Dpram {
            self.rest(now);
        }
    }

    /// Whether the board may still be at a command given up, whose reply would be taken for the next one's. A line of our own,
    /// whose reply nobody needs, ends the doubt: the board answers lines in their order.
    #[must_use]
    pub const fn in_doubt(&self) -> bool {
        self.doubt.is_some()
    }

    /// Whether the board takes neither lines nor control characters, as far as it was asked.
    #[must_use]
    pub fn is_unheard(&self) -> bool {
        self.in_use == CommandPort::Dpram && self.dpram.is_unheard()
    }

    /// A reply may have been another command's, and the next one as well.
    pub const fn doubt(&mut self) {
        self.doubt = Some(Doubt::WhatComes);
    }

    /// A line has ended. Of one in two parts the board might have answered the first (DPRAM manual p. 28 has it answer the line): what
    /// is still to come then must not be the next one's.
    pub fn line_over(&mut self) {
        if self.in_use == CommandPort::Dpram && self.dpram.has_parts() {
            self.doubt();
        }
    }

    /// See [`AsciiEvent::Error`] and [`AsciiEvent::Taken`].
    pub fn doubt_its_end(&mut self) {
        self.doubt = self.doubt.or(Some(Doubt::ItsEnd));
    }

    /// Whether nothing is in doubt but where the command's reply ends.
    #[must_use]
    pub fn only_end_in_doubt(&self) -> bool {
        self.doubt == Some(Doubt::ItsEnd)
    }

    /// The command under way has ended. See [`DpramPort::settled`].
    pub fn settled(&mut self, now: Instant) {
        match (self.in_use, &mut self.mailbox) {
            (CommandPort::Mailbox, Some(mailbox)) => mailbox.port.settled(),
            _ => self.dpram.settled(now),
        }
    }

    /// Starts sending a line of our own, whose reply is known when it is seen; false: try later. It goes on until
    /// [`CommandPorts::end_doubt`] or [`CommandPorts::give_up`].
    ///
    /// # Errors
    /// [`PortError`].
    pub fn begin_open_ended(&mut self, bus: &mut impl Bus, line: &[u8]) -> Result<bool, PortError> {
        match (self.in_use, &mut self.mailbox) {
            (CommandPort::Mailbox, Some(mailbox)) => Ok(self.question.is_none()
                && mailbox.is_connected()
                && mailbox.port.begin_open_ended(&mut mailbox.registers, line)?),
            _ => Ok(self.dpram.begin_open_ended(bus, line)?),
        }
    }

    /// A line of our own has been answered. Another one follows.
    pub fn finish(&mut self, now: Instant) {
        match (self.in_use, &mut self.mailbox) {
            (CommandPort::Mailbox, Some(mailbox)) => mailbox.port.finish(),
            _ => self.dpram.finish(now),
        }
    }

    /// As [`CommandPorts::finish`], and the doubt is over.
    pub fn end_doubt(&mut self, now: Instant) {
        self.finish(now);
        self.doubt = None;
    }

    /// The port that lines go through.
    #[must_use]
    pub fn in_use(&self) -> CommandPort {
        self.in_use
    }

    /// Responses taken from the DPRAM so far.
    #[must_use]
    pub fn responses(&self) -> u64 {
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
        self.mailbox.as_ref().is_some_and(|mailbox| mailbox.when() == Use::Fallback && mailbox.is_connected())
    }

    /// Has lines go through another port from now on. Nothing may be under way.
    pub fn change(&mut self, port: CommandPort) {
        self.in_use = port;
    }

    fn used_mailbox(&mut self) -> Option<&mut MailboxDriver> {
        self.mailbox.as_mut().filter(|mailbox| mailbox.when() != Use::Never)
    }

    /// Whether a line may be begun.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        match (self.in_use, &self.mailbox) {
            (CommandPort::Mailbox, Some(mailbox)) => mailbox.port.is_idle() && self.question.is_none(),
            _ => self.dpram.is_idle(),
        }
    }

    /// Whether a line lies before the board whose flag it may take for a control character's.
    #[must_use]
    pub fn line_lies(&self) -> bool {
        self.in_use == CommandPort::Dpram && self.dpram.line_lies()
    }

    /// Whether something is expected from the board.
    #[must_use]
    pub fn is_waiting(&self) -> bool {
        self.question.is_some() || !self.is_idle()
    }

    /// Whether the board has taken the whole command under way, as far as known.
    #[must_use]
    pub fn was_taken(&self) -> bool {
        match (self.in_use, &self.mailbox) {
            (CommandPort::Mailbox, Some(mailbox)) => mailbox.port.was_taken(),
            _ => self.dpram.was_taken(),
        }
    }

    /// Starts sending `line`; false: try later.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn begin(&mut self, bus: &mut impl Bus, line: &[u8]) -> Result<bool, PortError> {
        match (self.in_use, &mut self.mailbox) {
            (CommandPort::Mailbox, Some(mailbox)) => Ok(self.question.is_none()
                && mailbox.is_connected()
                && mailbox.port.begin(&mut mailbox.registers, line)?),
            _ => Ok(self.dpram.begin(bus, line)?),
        }
    }

    /// Hands a control character to the board; false: try later.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn control(
        &mut self,
        bus: &mut impl Bus,
        character: u8,
        has_reply: bool,
        now: Instant,
    ) -> Result<bool, PortError> {
        match (self.in_use, &mut self.mailbox) {
            (CommandPort::Mailbox, Some(mailbox)) => Ok(mailbox.is_connected()
                && mailbox.port.control(&mut mailbox.registers, character, has_reply, now)?),
            _ => Ok(self.dpram.control(bus, character, has_reply, now)?),
        }
    }

    /// Whether a control character waits for the board to take it.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn control_pending(&mut self, bus: &mut impl Bus, now: Instant) -> Result<bool, PortError> {
        match (self.in_use, &self.mailbox) {
            (CommandPort::Mailbox, Some(mailbox)) => Ok(mailbox.port.control_pending()),
            _ => {
                let had_flag = self.dpram.flag_is_characters();
                let is_pending = self.dpram.control_pending(bus, now)?;
                if had_flag && !is_pending {
                    // The board may acknowledge the empty line.
                    self.doubt();
                }
                Ok(is_pending)
            }
        }
    }

    /// Takes back a control character the board has not taken. From a mailbox nothing can be taken back; a cancel goes
    /// over it.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn withdraw_control(&mut self, bus: &mut impl Bus, now: Instant) -> Result<(), PortError> {
        match (self.in_use, &mut self.mailbox) {
            (CommandPort::Mailbox, Some(mailbox)) => {
                Ok(mailbox.port.withdraw_control(&mut mailbox.registers, now)?)
            }
            _ => Ok(self.dpram.withdraw_control(bus)?),
        }
    }

    /// Ends the line under way before a control character that goes over it. See [`DpramPort::stop`]; from a mailbox nothing can be
    /// taken back.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn stop(&mut self, bus: &mut impl Bus, character: u8, now: Instant) -> Result<Stopped, PortError> {
        match self.in_use {
            CommandPort::Mailbox => Ok(Stopped::Nothing),
            CommandPort::Dpram => Ok(self.dpram.stop(bus, character, now)?),
        }
    }

    /// Gives up on the command under way. The port is not idle before the board has shown, as far as it can, that it is free.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn give_up(&mut self, bus: &mut impl Bus, now: Instant) -> Result<(), PortError> {
        self.doubt();
        match (self.in_use, &mut self.mailbox) {
            (CommandPort::Mailbox, Some(mailbox)) => Ok(mailbox.port.give_up(&mut mailbox.registers, now)?),
            _ => Ok(self.dpram.give_up(bus, now)?),
        }
    }

    /// Takes back whatever lies in the DPRAM and is ours.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn withdraw(&mut self, bus: &mut impl Bus, now: Instant) -> Result<(), PortError> {
        match self.in_use {
            CommandPort::Mailbox => Ok(()),
            CommandPort::Dpram => Ok(self.dpram.withdraw(bus, now)?),
        }
    }

    /// Makes the mailboxes ready, at start and after a reset of the board.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn start(&mut self, now: Instant) -> Result<(), PortError> {
        self.question = None;
        Ok(self.used_mailbox().map_or(Ok(()), |mailbox| mailbox.start(now))?)
    }

    /// Does what can be done now and tells what was found.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn poll(&mut self, bus: &mut impl Bus, now: Instant) -> Result<Option<AsciiEvent>, PortError> {
        if let Some(event) = self.poll_mailbox(now)? {
            return Ok(Some(event));
        }
        if self.in_use == CommandPort::Mailbox {
            return Ok(None);
        }
        let event = self.dpram.poll(bus, now)?;
        self.responses += u64::from(event.is_some());
        Ok(event)
    }

    fn poll_mailbox(&mut self, now: Instant) -> Result<Option<AsciiEvent>, PortError> {
        let Some(mailbox) = self.mailbox.as_mut().filter(|mailbox| mailbox.when() != Use::Never) else {
            return Ok(None);
        };
        let event = mailbox.port.poll(&mut mailbox.registers, now)?;
        let Some(question) = &mut self.question else { return Ok(event) };
        let ended = match event {
            Some(AsciiEvent::Line(text)) => {
                question.value = std::str::from_utf8(text.as_bytes()).ok().and_then(answer::integer);
                None
            }
            Some(AsciiEvent::Done(result)) => Some(question.value.filter(|_| result.is_ok())),
            Some(AsciiEvent::Error(_)) => {
                mailbox.port.settled();
                Some(None)
            }
            Some(
                AsciiEvent::ProgramResponse(_)
                | AsciiEvent::ProgramMessage(_)
                | AsciiEvent::Stale(_)
                | AsciiEvent::Taken
                | AsciiEvent::ProgramError(_),
            ) => return Ok(event),
            None if now >= question.until => {
                mailbox.port.give_up(&mut mailbox.registers, now)?;
                Some(None)
            }
            None => None,
        };
        if let Some(value) = ended {
            if question.is_for_buffer {
                self.buffer_answer = Some(BufferAnswer(value));
            } else {
                self.answer = Some(Answer::of(value));
            }
            self.question = None;
        }
        Ok(None)
    }

    /// The name of the variable that enables the DPRAM's port: I58.
    #[must_use]
    pub fn enable(&self) -> &str {
        &self.enable
    }

    /// The DPRAM's page, where it has one, to be written after every reset.
    #[must_use]
    pub fn page(&self) -> Option<u8> {
        self.mailbox.as_ref().and_then(MailboxDriver::page)
    }

    /// Whether the DPRAM has a page to be written after every reset.
    #[must_use]
    pub fn has_page(&self) -> bool {
        self.page().is_some()
    }

    /// Writes the DPRAM's page, where it has one. The page it has already does no harm.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn select_page(&mut self) -> Result<(), PortError> {
        Ok(self.mailbox.as_mut().map_or(Ok(()), MailboxDriver::select_page)?)
    }

    /// Asks the board for I58 through the mailboxes; false: not now. [`CommandPorts::take_answer`] has what it says. Where
    /// nobody knows whether a program buffer is open, which I58 would enter, it is asked for that instead
    /// ([`CommandPorts::take_buffer_answer`]).
    ///
    /// # Errors
    /// [`PortError`].
    pub fn ask(&mut self, is_buffer_known: bool, now: Instant) -> Result<bool, PortError> {
        let Some(mailbox) = self.mailbox.as_mut().filter(|mailbox| mailbox.is_connected()) else {
            return Ok(false);
        };
        let line = if is_buffer_known { self.enable.as_bytes() } else { open_buffer::QUESTION };
        if self.question.is_some() || !mailbox.port.begin(&mut mailbox.registers, line)? {
            return Ok(false);
        }
        self.question =
            Some(Question { until: now + PATIENCE, is_for_buffer: !is_buffer_known, value: None });
        Ok(true)
    }

    /// What the board said of I58, once.
    pub fn take_answer(&mut self) -> Option<Answer> {
        self.answer.take()
    }

    /// What the board said of a program buffer, once.
    pub fn take_buffer_answer(&mut self) -> Option<BufferAnswer> {
        self.buffer_answer.take()
    }
}

impl Answer {
    /// What a reply with this value says.
    const fn of(value: Option<i64>) -> Self {
        match value {
            Some(0) => Self::Off,
            Some(_) => Self::On,
            None => Self::None,
        }
    }
}
