//! Whether the board is there: its memory may be replaced, its device removed, its slot empty, its page lost.

use log::{info, warn};

use crate::daemon::bus::board::{BoardBus, OpenBus, usable};
use crate::daemon::bus::ports::command_port::CommandPorts;
use crate::device::{Interrupt, Presence};
use crate::function::line_port::PortError;

/// A change of the board's presence.
pub enum Change {
    /// The board's memory was replaced. The daemon has opened it again, with its device's interrupt if the device has
    /// one to use.
    Replaced(Option<Option<Interrupt>>),
    /// The board answers on the bus again.
    Answers,
    /// The DPRAM is out of reach, so the board was reset. The daemon has written the page.
    PageLost,
    /// The DPRAM is in reach again.
    PageBack,
}

/// The daemon's last view of the board.
pub struct BoardPresence {
    open: OpenBus,
    /// The daemon cannot open the board's memory.
    gone: bool,
    /// No board answers on the bus.
    pub is_silent: bool,
    /// The DPRAM is out of reach: its page is not selected.
    pub is_out_of_reach: bool,
    /// The daemon has found a reset by the lost page, and has not seen servo data since, which would tell of the same
    /// reset.
    pub is_reset_known: bool,
}

impl BoardPresence {
    /// A board that was there when the daemon opened it; `open` opens it again.
    #[must_use]
    pub fn new(open: OpenBus) -> Self {
        Self { open, gone: false, is_silent: false, is_out_of_reach: false, is_reset_known: false }
    }

    /// Whether the daemon can reach the board, as far as it has seen.
    #[must_use]
    pub const fn is_there(&self) -> bool {
        !self.gone && !self.is_silent
    }

    /// The bus thread has polled the servo data; `is_live`: the data are live.
    pub fn servo_polled(&mut self, is_live: bool) {
        self.is_reset_known &= !is_live;
    }

    /// Checks whether the board is there, and opens it again after it was replaced or came back.
    pub fn check(&mut self, bus: &mut BoardBus) -> Option<Change> {
        if bus.still_there() {
            self.gone = false;
            return self.check_answers(bus);
        }
        match (self.open)() {
            Ok(opened) => {
                info!("the board's memory was replaced; opened it again");
                bus.bus().replace(opened.bus);
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

    /// Checks whether a board answers. Without a board, every word reads as ones: the functions take no such word for
    /// data, and jobs wait meanwhile.
    pub fn check_answers(&mut self, bus: &mut BoardBus) -> Option<Change> {
        let silent = !bus.answers();
        if std::mem::replace(&mut self.is_silent, silent) == silent {
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

    /// Writes the page, if one is configured, while the DPRAM reads as all ones: a reset has made the board forget the
    /// page. 1 read.
    ///
    /// # Errors
    /// When the board cannot be reached.
    pub fn check_page(
        &mut self,
        bus: &mut BoardBus,
        ports: &mut CommandPorts,
    ) -> Result<Option<Change>, PortError> {
        if ports.page().is_none() {
            return Ok(None);
        }
        let out_of_reach = ports.dpram.is_out_of_reach(bus)?;
        if out_of_reach {
            ports.select_page()?;
        }
        Ok(match (std::mem::replace(&mut self.is_out_of_reach, out_of_reach), out_of_reach) {
            (false, true) => {
                warn!("the DPRAM is out of reach, so the board was reset; writing its page");
                self.is_reset_known = true;
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

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::*;
    use crate::clock::Clock;
    use crate::device::{Bus, BusError, Counted, OpenedBoard, Trace, Traced};
    use crate::map::HostOffset;

    /// A slot, and the board in it.
    #[derive(Clone, Default)]
    struct Slot {
        is_there: Arc<AtomicBool>,
        answers: Arc<AtomicBool>,
    }

    impl Slot {
        fn set(&self, is_there: bool, answers: bool) {
            self.is_there.store(is_there, Ordering::Relaxed);
            self.answers.store(answers, Ordering::Relaxed);
        }
    }

    impl Presence for Slot {
        fn still_there(&self) -> bool {
            self.is_there.load(Ordering::Relaxed)
        }
        fn answers(&mut self) -> bool {
            self.answers.load(Ordering::Relaxed)
        }
    }

    impl Bus for Slot {
        fn length(&self) -> usize {
            2
        }
        fn read16(&mut self, _offset: HostOffset) -> Result<u16, BusError> {
            Ok(0)
        }
        fn write16(&mut self, _offset: HostOffset, _value: u16) -> Result<(), BusError> {
            Ok(())
        }
        fn read_block(&mut self, _first: HostOffset, words: &mut [u16]) -> Result<(), BusError> {
            words.fill(0);
            Ok(())
        }
        fn order_reads(&mut self) {}
        fn order_writes(&mut self) {}
    }

    #[test]
    fn every_change_is_found_once() {
        let slot = Slot::default();
        slot.set(true, true);
        let mut bus: BoardBus =
            Counted::new(Traced::new(Box::new(slot.clone()), Trace::new(0), Clock::real()));
        let next = Slot::default();
        let opened = next.clone();
        let mut presence = BoardPresence::new(Box::new(move || {
            let there = opened.still_there();
            there
                .then(|| OpenedBoard { bus: Box::new(opened.clone()), interrupt: None })
                .ok_or("no board".into())
        }));
        assert!(presence.check(&mut bus).is_none() && presence.is_there());
        slot.set(true, false);
        assert!(presence.check(&mut bus).is_none() && presence.is_silent && !presence.is_there());
        slot.set(true, true);
        assert!(matches!(presence.check(&mut bus), Some(Change::Answers)));
        assert!(presence.check(&mut bus).is_none() && presence.is_there());
        slot.set(false, false);
        assert!(presence.check(&mut bus).is_none() && !presence.is_there(), "it cannot be opened yet");
        next.set(true, true);
        assert!(matches!(presence.check(&mut bus), Some(Change::Replaced(None))));
        assert!(presence.check(&mut bus).is_none() && presence.is_there(), "the bus is that of the new one");
    }

    #[test]
    fn a_reset_is_known_until_servo_data_come() {
        let mut presence = BoardPresence::new(Box::new(|| Err("no board".into())));
        presence.is_reset_known = true;
        presence.servo_polled(false);
        assert!(presence.is_reset_known);
        presence.servo_polled(true);
        assert!(!presence.is_reset_known);
    }
}
