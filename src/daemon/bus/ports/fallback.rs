//! Which port command lines should go through: the DPRAM's, or the mailboxes when the board does not look at the
//! DPRAM's.
//!
//! If a command stays unread in the DPRAM for 100 ms, the daemon asks the board for I58 through the mailboxes. If I58=0
//! or the DPRAM is out of reach, lines go through the mailboxes from then on, beginning with the unread line. The
//! daemon then asks for I58 every 2 s; when it is not 0, lines go through the DPRAM again. While a program buffer is
//! open the daemon asks nothing: the question would become a program line. If the daemon does not know of a buffer, it
//! asks for that first.

use std::time::Instant;

use crate::daemon::bus::ports::command_port::CommandPorts;
use crate::daemon::bus::ports::mailbox::MailboxQuestion;
use crate::daemon::bus::timing::{LINE_STUCK, PORT_ASKED_AGAIN, PORT_ASKED_SOON};
use crate::device::Bus;
use crate::function::line_port::PortError;
use crate::protocol::CommandPort;

/// The commands that wait at the ports.
#[derive(Debug, Clone, Copy)]
pub struct Waiting {
    /// A command that the board has not touched, as far as known.
    pub untouched: bool,
    /// A command that the board may be at work on.
    pub under_way: bool,
    /// A program buffer is open; `None`: unknown.
    pub buffer_open: Option<bool>,
}

/// Where lines should go from now on, and why.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// Through the mailboxes: the DPRAM is out of reach.
    OutOfReach,
    /// Through the mailboxes: the DPRAM's port is disabled.
    Disabled,
    /// Through the DPRAM: its port is enabled.
    Enabled,
}

impl Change {
    /// The port that lines should go through.
    #[must_use]
    pub const fn port(self) -> CommandPort {
        match self {
            Self::OutOfReach | Self::Disabled => CommandPort::Mailbox,
            Self::Enabled => CommandPort::Dpram,
        }
    }
}

/// When to ask the board.
#[derive(Debug)]
pub struct Fallback {
    /// Since when a command has stayed unread in the DPRAM.
    stuck_since: Option<Instant>,
    next_question: Instant,
}

impl Fallback {
    /// Nothing is stuck.
    #[must_use]
    pub const fn new(now: Instant) -> Self {
        Self { stuck_since: None, next_question: now }
    }

    /// A line may have changed which port the board looks at.
    pub fn ask_soon(&mut self, ports: &CommandPorts, now: Instant) {
        if ports.in_use() == CommandPort::Mailbox {
            self.next_question = self.next_question.min(now + PORT_ASKED_SOON);
        }
    }

    /// The board had the command in hand after all: ask again when that is over.
    pub fn ask_again(&mut self, now: Instant) {
        self.next_question = now;
    }

    /// The change that the board's answer asks for, if an answer has come.
    ///
    /// # Errors
    /// When a port cannot be reached.
    pub fn wanted(
        &mut self,
        ports: &mut CommandPorts,
        under_way: bool,
        bus: &mut impl Bus,
        now: Instant,
    ) -> Result<Option<Change>, PortError> {
        let Some(answer) = ports.take_answer(MailboxQuestion::Enable) else { return Ok(None) };
        self.next_question = now + PORT_ASKED_AGAIN;
        let is_enabled = answer.value.map(|value| value != 0);
        let out_of_reach = is_enabled.is_some() && ports.dpram.is_out_of_reach(bus)?;
        Ok(match (ports.in_use(), is_enabled) {
            (CommandPort::Dpram, Some(_)) if out_of_reach => Some(Change::OutOfReach),
            (CommandPort::Dpram, Some(false)) => Some(Change::Disabled),
            (CommandPort::Mailbox, Some(true)) if !out_of_reach && !under_way => Some(Change::Enabled),
            _ => None,
        })
    }

    /// Asks the board if there is reason to.
    ///
    /// # Errors
    /// When a port cannot be reached.
    pub fn ask(&mut self, ports: &mut CommandPorts, waiting: Waiting, now: Instant) -> Result<(), PortError> {
        let in_dpram = ports.in_use() == CommandPort::Dpram;
        let stuck = in_dpram && waiting.untouched;
        self.stuck_since = self.stuck_since.filter(|_| stuck).or(stuck.then_some(now));
        if waiting.buffer_open == Some(true) || now < self.next_question {
            return Ok(());
        }
        let has_reason = if in_dpram {
            self.stuck_since.is_some_and(|since| now >= since + LINE_STUCK)
        } else {
            !waiting.under_way && ports.current().is_idle()
        };
        if has_reason && ports.ask(waiting.buffer_open.is_some(), now)? {
            self.next_question = now + PORT_ASKED_AGAIN;
        }
        Ok(())
    }
}
