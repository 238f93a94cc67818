//! The interrupt controller behind the board's host port, served in the one order that loses nothing.
//!
//! The daemon first reads the response and writes 0 to `response_control`; then it acknowledges the interrupt here, and
//! looks at `response_control` once more. An interrupt with `response_control` = 0, of a response that the daemon found
//! by a poll, is an old one. The daemon counts and acknowledges such an interrupt, or the controller would give no
//! other.

use std::time::Instant;

use log::{info, warn};

use crate::daemon::bus::ports::command_port::CommandPorts;
use crate::daemon::bus::timing::RESPONSE_ANNOUNCED;
use crate::daemon::config::ports::HostPortConfig;
use crate::device::refusal::OpenError;
use crate::device::{Bus, ByteBus, ByteBusError, Counted, Inherited, System, open_host_port};
use crate::function::host_port::HostPort;
use crate::function::line_port::PortError;
use crate::map::Controller;
use crate::protocol::CommandPort;
use crate::protocol::HostPortCounts;

/// The controller.
pub struct HostPortDriver {
    config: HostPortConfig,
    registers: Counted<Box<dyn ByteBus>>,
    /// Whether the line was open before the daemon opened it; `None` until the daemon has opened it.
    was_open: Option<bool>,
    /// An interrupt came that the daemon has not acknowledged yet; the value is the number of responses taken before
    /// it.
    pending: Option<u64>,
    /// The responses taken at the last acknowledgement.
    acknowledged: u64,
    /// When the daemon first noticed a response taken whose interrupt has not come.
    unannounced_since: Option<Instant>,
    counts: HostPortCounts,
}

impl HostPortDriver {
    /// Opens the registers.
    ///
    /// # Errors
    /// [`OpenError`].
    pub fn open(config: HostPortConfig, system: &System, inherited: &Inherited) -> Result<Self, OpenError> {
        Ok(Self {
            registers: Counted::new(open_host_port(&config.registers, system, inherited)?),
            config,
            was_open: None,
            pending: None,
            acknowledged: 0,
            unannounced_since: None,
            counts: HostPortCounts::default(),
        })
    }

    /// The counts since the start.
    #[must_use]
    pub fn counts(&self) -> HostPortCounts {
        self.counts
    }

    /// The controller and the line.
    #[must_use]
    pub fn port(&self) -> &HostPort {
        &self.config.port
    }

    /// The controller's name in `GetInfo`.
    #[must_use]
    pub fn name(port: &HostPort) -> &'static str {
        match port.controller {
            Controller::Pic8259 => "pic8259",
            Controller::Pmac2 => "pmac2",
        }
    }

    /// Opens the line, at start and after a reset of the board, which shuts it.
    ///
    /// # Errors
    /// When the registers cannot be reached.
    pub fn enable(&mut self) -> Result<(), ByteBusError> {
        let found = self.config.port.enable(&mut self.registers)?;
        if self.was_open.is_none() {
            self.was_open = Some(found);
            let state = if found { "was open already" } else { "opened" };
            info!("host port: {} line {} {state}", Self::name(&self.config.port), self.config.port.line);
        }
        Ok(())
    }

    /// Whether the line is open. 1 read.
    ///
    /// # Errors
    /// When the registers cannot be reached.
    pub fn is_open(&mut self) -> Result<bool, ByteBusError> {
        self.config.port.is_enabled(&mut self.registers)
    }

    /// Opens the registers again, and the line: the board's memory was replaced.
    ///
    /// # Errors
    /// In words.
    pub fn reopen(&mut self) -> Result<(), String> {
        let opened = open_host_port(&self.config.registers, &System::here(), &Inherited::default());
        self.registers.replace(opened.map_err(|error| error.to_string())?);
        self.enable().map_err(|error| error.to_string())
    }

    /// Shuts the line, unless it was open before the daemon came.
    ///
    /// # Errors
    /// When the registers cannot be reached.
    pub fn leave(&mut self) -> Result<(), ByteBusError> {
        match self.was_open.take() {
            Some(false) => self.config.port.disable(&mut self.registers),
            Some(true) => self.config.port.acknowledge(&mut self.registers),
            None => Ok(()),
        }
    }

    /// Interrupts came, after the daemon had taken `responses` responses from the DPRAM.
    pub fn interrupted(&mut self, responses: u64) {
        self.pending.get_or_insert(responses);
    }

    /// Acknowledges the interrupt, if that is due after the daemon has taken responses. True if another response is
    /// there. While a response is `held_up` for want of room, the line would only rise again, so the daemon does
    /// nothing. At most 2 reads of the DPRAM and 1 write of a register; nothing without an interrupt.
    ///
    /// # Errors
    /// [`PortError`].
    pub fn serve(
        &mut self,
        bus: &mut impl Bus,
        ports: &CommandPorts,
        held_up: bool,
        now: Instant,
    ) -> Result<bool, PortError> {
        let responses = ports.responses();
        let Some(before) = self.pending else {
            self.serve_unannounced(responses, now)?;
            return Ok(false);
        };
        if held_up {
            return Ok(false);
        }
        if responses == before && ports.in_use() == CommandPort::Dpram {
            if ports.dpram.has_response(bus)? {
                return Ok(true);
            }
            self.counts.old += 1;
        }
        self.pending = None;
        self.counts.served += 1;
        self.acknowledge(responses)?;
        Ok(ports.dpram.has_response(bus)?)
    }

    fn acknowledge(&mut self, responses: u64) -> Result<(), ByteBusError> {
        self.acknowledged = responses;
        self.unannounced_since = None;
        self.config.port.acknowledge(&mut self.registers)
    }

    /// The daemon has taken a response, and its interrupt does not come: the controller waits for the daemon, and the
    /// daemon for the controller.
    fn serve_unannounced(&mut self, responses: u64, now: Instant) -> Result<(), ByteBusError> {
        if responses == self.acknowledged {
            return Ok(());
        }
        let since = *self.unannounced_since.get_or_insert(now);
        if now < since + RESPONSE_ANNOUNCED {
            return Ok(());
        }
        if self.counts.unannounced == 0 {
            warn!(
                "host port: a response came without an interrupt (is I{}=1?); acknowledged all the same, the next ones are counted",
                self.config.interrupt
            );
        }
        self.counts.unannounced += 1;
        self.acknowledge(responses)
    }
}
