//! The mailbox circuit of a VME board with what belongs to it: registers, the port in them, its two interrupts, the page.
//!
//! The port's state is in its interrupts alone ([`crate::function::mailbox`]), so without them nothing is begun. They
//! come on two descriptors: v is looked at first, because PMAC raised v-1 before it; what is seen of v-1 after
//! that is then never older.

use std::os::fd::BorrowedFd;
use std::time::Instant;

use crate::daemon::bus::board::{self, link};
use crate::daemon::bus::ports::interrupt::InterruptLink;
use crate::daemon::config::ports::{Lane, MailboxConfig, Use};
use crate::device::board::refusal::OpenError;
use crate::device::{ByteBus, ByteBusError, Counted, EvenLane, Inherited, System, open_mailbox};
use crate::function::mailbox::{MailboxPort, MailboxSignal};
use crate::map::mailbox;

/// The circuit.
pub struct MailboxDriver {
    config: MailboxConfig,
    /// Its registers.
    pub registers: Counted<Box<dyn ByteBus>>,
    /// The port in them.
    pub port: MailboxPort,
    taken: Option<InterruptLink>,
    reply: Option<InterruptLink>,
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
    /// Opens the registers and, where they can be opened only now, the interrupts. The board takes lines of at most
    /// `line_limit` characters.
    ///
    /// # Errors
    /// What could not be opened, why, and what to do.
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
        })
    }

    /// Opens the registers again: the board's memory was replaced.
    ///
    /// # Errors
    /// [`OpenError`]; the registers are the old ones then.
    pub fn reopen(&mut self) -> Result<(), OpenError> {
        let opened = open(&self.config, &System::here(), &Inherited::default());
        opened.map(|bus| self.registers.replace(bus))
    }

    /// When command lines go this way.
    #[must_use]
    pub fn when(&self) -> Use {
        self.config.when
    }

    /// The page that brings the DPRAM into reach, where that is needed.
    #[must_use]
    pub fn page(&self) -> Option<u8> {
        self.config.page
    }

    /// Writes the page, where one is configured. At most 1 write.
    ///
    /// # Errors
    /// When the register cannot be reached.
    pub fn select_page(&mut self) -> Result<(), ByteBusError> {
        let Some(page) = self.config.page else { return Ok(()) };
        self.registers.write8(mailbox::PAGE_SELECT as u32, page)?;
        self.registers.order_accesses();
        Ok(())
    }

    /// Makes the port ready: at start, and after every reset of the board, which forgets what it was allowed to send.
    ///
    /// # Errors
    /// When the registers cannot be reached.
    pub fn start(&mut self, now: Instant) -> Result<(), ByteBusError> {
        if self.config.when == Use::Never { Ok(()) } else { self.port.start(&mut self.registers, now) }
    }

    /// Whether both interrupts are there to tell where PMAC is.
    #[must_use]
    pub fn is_connected(&self) -> bool {
        [&self.taken, &self.reply].iter().all(|link| link.as_ref().is_some_and(InterruptLink::is_connected))
    }

    /// What becomes readable when an interrupt comes.
    #[must_use]
    pub fn descriptors(&self) -> [Option<BorrowedFd<'_>>; 2] {
        [&self.taken, &self.reply].map(|link| link.as_ref().and_then(InterruptLink::descriptor))
    }

    /// Connects what is not connected, when it is time to try.
    pub fn tend(&mut self, now: Instant) {
        for link in [&mut self.taken, &mut self.reply].into_iter().flatten() {
            link.tend(now);
        }
    }

    /// Takes the interrupts that wait and tells the port; gives their number.
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
