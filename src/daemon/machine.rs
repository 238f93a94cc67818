//! The hardware that the daemon uses: the board, its mailboxes, its interrupt controller.

use super::config::settings::Settings;
use super::exit::Failure;
use crate::clock::Clock;
use crate::daemon::bus::board::{self, Board};
use crate::daemon::bus::ports::host_port::HostPortDriver;
use crate::daemon::bus::ports::mailbox::MailboxDriver;
use crate::device::{Inherited, System};

/// The hardware that the daemon uses.
pub struct Machine {
    /// The board.
    pub board: Board,
    /// The board's mailbox circuit, if the board has one.
    pub mailbox: Option<MailboxDriver>,
    /// The board's interrupt controller, if the daemon serves it.
    pub host_port: Option<HostPortDriver>,
}

impl Machine {
    /// Opens everything that `settings` name. A replay plays in the time of `clock`.
    ///
    /// # Errors
    /// Names the part that the daemon cannot open, the reason and the remedy.
    pub fn open(settings: &Settings, inherited: &Inherited, clock: &Clock) -> Result<Self, Failure> {
        let system = &System::here();
        let failed = |what: &str, error: &(dyn std::error::Error + 'static)| {
            let Failure { status, reason } = Failure::board(error);
            Failure { status, reason: format!("{what}{reason}") }
        };
        let board = board::open(settings, system, inherited, clock);
        let mut board = board.map_err(|error| failed("", error.as_ref()))?;
        let mailbox = settings.mailbox.clone();
        // A response in the DPRAM interrupts by this vector, if the board has one.
        if let Some(source) = mailbox.as_ref().and_then(|mailbox| mailbox.dpram.clone()) {
            let link = board::link(source, system, inherited);
            board.interrupt = Some(link.map_err(|error| failed("mailboxes: ", error.as_ref()))?);
        }
        let line_limit = settings.family.ascii.line_limit;
        let mailbox =
            mailbox.map(|config| MailboxDriver::open(config, line_limit, system, inherited)).transpose();
        let host_port = settings.host_port.clone();
        let host_port = host_port.map(|config| HostPortDriver::open(config, system, inherited)).transpose();
        Ok(Self {
            board,
            mailbox: mailbox.map_err(|error| failed("mailboxes: ", error.as_ref()))?,
            host_port: host_port.map_err(|error| failed("host port: ", &error))?,
        })
    }
}
