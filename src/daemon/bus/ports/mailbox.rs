//! The mailbox circuit of a VME board: its registers, the port in them, the two interrupts, the page.
//!
//! Only the interrupts tell the port's state ([`crate::function::mailbox`]), so the daemon begins nothing without them.
//! They come on two descriptors. The daemon reads v first, because PMAC raises v-1 before v: its later reading of v-1
//! is then never older.
//!
//! The daemon asks the board for I58 here, too, whichever port carries lines ([`MailboxDriver::ask`]). Meanwhile it
//! begins no line.

use std::os::fd::BorrowedFd;
use std::time::Instant;

use crate::daemon::bus::board::{self, link};
use crate::daemon::bus::ports::interrupt::InterruptLink;
use crate::daemon::bus::timing::PORT_ANSWER;
use crate::daemon::config::ports::{Lane, MailboxConfig, MailboxUse};
use crate::device::refusal::OpenError;
use crate::device::{Bus, ByteBus, ByteBusError, Counted, EvenLane, Inherited, System, open_mailbox};
use crate::function::line_port::{AsciiEvent, LinePort, PortError};
use crate::function::mailbox::{MailboxPort, MailboxSignal};
use crate::map::mailbox;
use crate::protocol::answer;

/// A question of the daemon's, whichever port carries lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MailboxQuestion {
    /// For the variable that enables the DPRAM's port (I58).
    Enable,
    /// For a program buffer.
    Buffer,
}

/// The board's answer to the daemon's question.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MailboxAnswer {
    question: MailboxQuestion,
    /// The number; `None` if the answer is no number.
    pub value: Option<i64>,
}

/// The circuit.
pub struct MailboxDriver {
    config: MailboxConfig,
    /// The circuit's registers.
    pub registers: Counted<Box<dyn ByteBus>>,
    /// The port in the registers.
    pub port: MailboxPort,
    taken: Option<InterruptLink>,
    reply: Option<InterruptLink>,
    /// The question under way, its answer so far, and until when the board may answer.
    asked: Option<(MailboxAnswer, Instant)>,
    answer: Option<MailboxAnswer>,
}

fn open(
    config: &MailboxConfig,
    system: &System,
    inherited: &Inherited,
) -> Result<Box<dyn ByteBus>, OpenError> {
    let bus = open_mailbox(&config.registers, system, inherited)?;
    Ok(match config.lane {
        Lane::Odd => bus,
        Lane::Even => Box::new(EvenLane(bus)),
    })
}

impl MailboxDriver {
    /// Opens the registers, and also the interrupts if the daemon can open them only now. The board takes lines of at
    /// most `line_limit` characters.
    ///
    /// # Errors
    /// Names the registers or interrupt that the daemon cannot open, the reason and the remedy.
    pub fn open(
        config: MailboxConfig,
        line_limit: usize,
        system: &System,
        inherited: &Inherited,
    ) -> Result<Self, board::OpenError> {
        let (taken, reply) = match config.vectors.clone() {
            Some(vectors) => {
                (Some(link(vectors.taken, system, inherited)?), Some(link(vectors.reply, system, inherited)?))
            }
            None => (None, None),
        };
        Ok(Self {
            registers: Counted::new(open(&config, system, inherited)?),
            port: MailboxPort::new(config.talk, line_limit),
            config,
            taken,
            reply,
            asked: None,
            answer: None,
        })
    }

    /// Opens the registers again: the board's memory was replaced.
    ///
    /// # Errors
    /// [`OpenError`]; the old registers then stay.
    pub fn reopen(&mut self) -> Result<(), OpenError> {
        let opened = open(&self.config, &System::here(), &Inherited::default());
        opened.map(|bus| self.registers.replace(bus))
    }

    /// When command lines go through the mailbox.
    #[must_use]
    pub fn when(&self) -> MailboxUse {
        self.config.when
    }

    /// The page that brings the DPRAM into reach, if one is configured.
    #[must_use]
    pub fn page(&self) -> Option<u8> {
        self.config.page
    }

    /// Writes the page, if one is configured. At most 1 write.
    ///
    /// # Errors
    /// When the register cannot be reached.
    pub fn select_page(&mut self) -> Result<(), ByteBusError> {
        let Some(page) = self.config.page else { return Ok(()) };
        self.registers.write8(mailbox::PAGE_SELECT as u32, page)?;
        self.registers.order_accesses();
        Ok(())
    }

    /// Makes the port ready: at start, and after every reset of the board, which erases the permission to send.
    ///
    /// # Errors
    /// When the registers cannot be reached.
    pub fn start(&mut self, now: Instant) -> Result<(), ByteBusError> {
        self.asked = None;
        if self.config.when == MailboxUse::Never { Ok(()) } else { self.port.start(&mut self.registers, now) }
    }

    /// Asks the board `question` by `line`; false: not now. [`MailboxDriver::take_answer`] has the answer.
    ///
    /// # Errors
    /// When the registers cannot be reached.
    pub fn ask(
        &mut self,
        question: MailboxQuestion,
        line: &[u8],
        now: Instant,
    ) -> Result<bool, ByteBusError> {
        let begun = self.may_begin() && self.port.begin(&mut self.registers, line)?;
        if begun {
            self.asked = Some((MailboxAnswer { question, value: None }, now + PORT_ANSWER));
        }
        Ok(begun)
    }

    /// Whether the daemon's question is under way.
    #[must_use]
    pub const fn is_asking(&self) -> bool {
        self.asked.is_some()
    }

    /// The board's answer to `question`, once.
    pub fn take_answer(&mut self, question: MailboxQuestion) -> Option<MailboxAnswer> {
        self.answer.take_if(|answer| answer.question == question)
    }

    fn may_begin(&self) -> bool {
        self.asked.is_none() && self.is_connected()
    }

    /// Keeps an event that belongs to the daemon's question; gives any other event back.
    fn see_answer(
        &mut self,
        event: Option<AsciiEvent>,
        now: Instant,
    ) -> Result<Option<AsciiEvent>, PortError> {
        let Some((answer, until)) = &mut self.asked else { return Ok(event) };
        match event {
            Some(AsciiEvent::Line(text)) => {
                answer.value = std::str::from_utf8(text.as_bytes()).ok().and_then(answer::integer);
                return Ok(None);
            }
            Some(AsciiEvent::Done(Ok(()))) => {}
            Some(AsciiEvent::Done(Err(_))) => answer.value = None,
            Some(AsciiEvent::Error(_)) => {
                answer.value = None;
                self.port.settled();
            }
            None if now >= *until => {
                answer.value = None;
                self.port.give_up(&mut self.registers, now)?;
            }
            _ => return Ok(event),
        }
        self.answer = self.asked.take().map(|(answer, _)| answer);
        Ok(None)
    }

    /// Whether both interrupts are connected, which tell PMAC's progress.
    #[must_use]
    pub fn is_connected(&self) -> bool {
        [&self.taken, &self.reply].iter().all(|link| link.as_ref().is_some_and(InterruptLink::is_connected))
    }

    /// The descriptors that become readable when an interrupt comes.
    #[must_use]
    pub fn descriptors(&self) -> [Option<BorrowedFd<'_>>; 2] {
        [&self.taken, &self.reply].map(|link| link.as_ref().and_then(InterruptLink::descriptor))
    }

    /// Connects the interrupts that are not connected, when a try is due.
    pub fn tend(&mut self, now: Instant) {
        for link in [&mut self.taken, &mut self.reply].into_iter().flatten() {
            link.tend(now);
        }
    }

    /// Takes the waiting interrupts and tells the port; returns their number.
    pub fn take_interrupts(&mut self, now: Instant) -> u32 {
        let [reply, taken] = [&mut self.reply, &mut self.taken]
            .map(|link| link.as_mut().map_or(0, |link| link.take(now).interrupts));
        if taken > 0 {
            self.port.signal(MailboxSignal::GroupTaken);
        }
        if reply > 0 {
            self.port.signal(MailboxSignal::ReplyReady);
        }
        taken.saturating_add(reply)
    }
}

impl LinePort for MailboxDriver {
    fn is_idle(&self) -> bool {
        self.port.is_idle() && !self.is_asking()
    }

    fn was_taken(&self) -> bool {
        self.port.was_taken()
    }

    fn begin(&mut self, _bus: &mut dyn Bus, line: &[u8]) -> Result<bool, PortError> {
        Ok(self.may_begin() && self.port.begin(&mut self.registers, line)?)
    }

    fn begin_open_ended(&mut self, _bus: &mut dyn Bus, line: &[u8]) -> Result<bool, PortError> {
        Ok(self.may_begin() && self.port.begin_open_ended(&mut self.registers, line)?)
    }

    fn finish(&mut self, _now: Instant) {
        self.port.finish();
    }

    fn settled(&mut self, _now: Instant) {
        self.port.settled();
    }

    fn control(
        &mut self,
        _bus: &mut dyn Bus,
        character: u8,
        has_reply: bool,
        now: Instant,
    ) -> Result<bool, PortError> {
        Ok(self.is_connected() && self.port.control(&mut self.registers, character, has_reply, now)?)
    }

    fn control_pending(&mut self, _bus: &mut dyn Bus, _now: Instant) -> Result<bool, PortError> {
        Ok(self.port.control_pending())
    }

    fn withdraw_control(&mut self, _bus: &mut dyn Bus, now: Instant) -> Result<(), PortError> {
        Ok(self.port.withdraw_control(&mut self.registers, now)?)
    }

    fn give_up(&mut self, _bus: &mut dyn Bus, now: Instant) -> Result<(), PortError> {
        Ok(self.port.give_up(&mut self.registers, now)?)
    }

    fn poll(&mut self, _bus: &mut dyn Bus, now: Instant) -> Result<Option<AsciiEvent>, PortError> {
        if self.config.when == MailboxUse::Never {
            return Ok(None);
        }
        let event = self.port.poll(&mut self.registers, now)?;
        self.see_answer(event, now)
    }
}
