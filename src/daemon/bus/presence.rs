//! Whether the board is there: its memory may be replaced, its device removed, its slot empty, its page lost.

use log::{info, warn};

use crate::daemon::bus::board::{BoardBus, OpenBus, usable};
use crate::daemon::bus::ports::command_port::{CommandPorts, PortError};
use crate::device::{Interrupt, Presence};

/// What has become of the board.
pub enum Change {
    /// Its memory was replaced, and has been opened again, with the interrupt of its device if that has one to use.
    Replaced(Option<Option<Interrupt>>),
    /// It answers on the bus again.
    Answers,
    /// The DPRAM is out of reach, so the board was reset. Its page has been written.
    PageLost,
    /// The DPRAM is in reach again.
    PageBack,
}

/// What was last seen of the board.
pub struct BoardPresence {
    open: OpenBus,
    /// Its memory is not to be had.
    gone: bool,
    /// Nothing answers on the bus.
    silent: bool,
    /// The DPRAM is out of reach for want of its page.
    out_of_reach: bool,
    /// A reset was found by its lost page, and servo data have not come since to tell of the same one.
    reset_known: bool,
}

impl BoardPresence {
    /// A board that was there when it was opened, and how to open it again.
    #[must_use]
    pub fn new(open: OpenBus) -> Self {
        Self { open, gone: false, silent: false, out_of_reach: false, reset_known: false }
    }

    /// Whether nothing answers on the bus.
    #[must_use]
    pub const fn is_silent(&self) -> bool {
        self.silent
    }

    /// Whether the board can be reached, as far as was seen.
    #[must_use]
    pub const fn is_there(&self) -> bool {
        !self.gone && !self.silent
    }

    /// Whether the DPRAM is out of reach for want of its page.
    #[must_use]
    pub const fn is_out_of_reach(&self) -> bool {
        self.out_of_reach
    }

    /// Whether the last reset was found by its lost page, and servo data have not come since to tell of the same one.
    #[must_use]
    pub const fn is_reset_known(&self) -> bool {
        self.reset_known
    }

    /// The servo data have been polled, and are live or not.
    pub fn servo_polled(&mut self, is_live: bool) {
        self.reset_known &= !is_live;
    }

    /// Looks whether the board is there, and opens it again when it was replaced or came back.
    pub fn check(&mut self, bus: &mut BoardBus) -> Option<Change> {
        if bus.still_there() {
            self.gone = false;
            return self.check_answers(bus);
        }
        match (self.open)() {
            Ok(opened) => {
                info!("the board's memory was replaced; opened it again");
                bus.replace(opened.bus);
                self.gone = false;
                Some(Change::Replaced(opened.interrupt.map(usable)))
            }
            Err(reason) => {
                if !std::mem::replace(&mut self.gone, true) {
                    warn!("the board's memory is gone: {reason}; trying again every second");
                }
                None
            }
        }
    }

    /// Looks whether anything answers. Where no board is, every word reads as ones: the functions take none of it for
    /// data, and jobs wait meanwhile.
    pub fn check_answers(&mut self, bus: &mut BoardBus) -> Option<Change> {
        let silent = !bus.answers();
        if std::mem::replace(&mut self.silent, silent) == silent {
            return None;
        }
        if silent {
            warn!(
                "every word of the board reads 0xFFFF: nothing answers on the bus (is the address right, the board powered, its DPRAM placed there and its page selected?)"
            );
            return None;
        }
        info!("the board answers on the bus again");
        Some(Change::Answers)
    }

    /// Writes the page, where one is configured, while the DPRAM reads as all ones: a reset has had the board forget it.
    /// 1 read.
    ///
    /// # Errors
    /// When the board cannot be reached.
    pub fn check_page(
        &mut self,
        bus: &mut BoardBus,
        ports: &mut CommandPorts,
    ) -> Result<Option<Change>, PortError> {
        if !ports.has_page() {
            return Ok(None);
        }
        let out_of_reach = ports.dpram.is_out_of_reach(bus)?;
        if out_of_reach {
            ports.select_page()?;
        }
        Ok(match (std::mem::replace(&mut self.out_of_reach, out_of_reach), out_of_reach) {
            (false, true) => {
                warn!("the DPRAM is out of reach, so the board was reset; writing its page");
                self.reset_known = true;
                Some(Change::PageLost)
            }
            (true, false) => {
                info!("the DPRAM is in reach, its page is selected");
                Some(Change::PageBack)
            }
            _ => None,
        })
    }
}
