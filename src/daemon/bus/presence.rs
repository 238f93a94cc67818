//! Whether the board is still there: its memory may be replaced, its device removed, its slot empty.

use log::{info, warn};

use crate::daemon::bus::board::usable;
use crate::daemon::bus::board_loop::BoardLoop;
use crate::device::Presence;
use crate::segment::Counter;

/// What was last seen of the board, and decides what is done with it.
#[derive(Default)]
pub struct Condition {
    /// Its memory is not to be had.
    pub(in crate::daemon) gone: bool,
    /// Nothing answers on the bus.
    pub(in crate::daemon) silent: bool,
    /// The DPRAM is out of reach for want of its page.
    pub(in crate::daemon) out_of_reach: bool,
    /// A reset was found by its lost page, and servo data have not come since to tell of the same one.
    pub(in crate::daemon) reset_known: bool,
}

impl BoardLoop {
    /// Looks whether the board is there, and opens it again when it was replaced or came back.
    pub(in crate::daemon) fn check_board(&mut self) {
        if self.bus.still_there() {
            self.condition.gone = false;
            self.check_answers();
            if !self.condition.silent
                && let Err(error) = self.let_board_speak()
            {
                self.bus_failed(&error);
            }
            return;
        }
        match (self.open)() {
            Ok(opened) => {
                info!("the board's memory was replaced; opened it again");
                self.bus.replace(opened.bus);
                if let (Some(link), Some(interrupt)) = (&mut self.interrupt, opened.interrupt) {
                    link.replace(usable(interrupt));
                }
                self.condition.gone = false;
                self.reopen_registers();
                self.begin_anew();
            }
            Err(reason) => {
                if !std::mem::replace(&mut self.condition.gone, true) {
                    warn!("the board's memory is gone: {reason}; trying again every second");
                }
            }
        }
    }

    /// Where no board is, every word reads as ones. The functions take none of it for data, and jobs wait meanwhile.
    pub(in crate::daemon) fn check_answers(&mut self) {
        let silent = !self.bus.answers();
        if std::mem::replace(&mut self.condition.silent, silent) == silent {
            return;
        }
        if silent {
            warn!(
                "every word of the board reads 0xFFFF: nothing answers on the bus (is the address right, the board powered, its DPRAM placed there and its page selected?)"
            );
        } else {
            info!("the board answers on the bus again");
            self.begin_anew();
        }
    }

    /// The board is another one, or was without power.
    fn begin_anew(&mut self) {
        // Before the words are put in order: what lies in them tells what the board has taken.
        if let Err(error) = self.forget_commands() {
            self.bus_failed(&error);
        }
        self.start_over();
        if let Err(error) = self.after_reset(true) {
            self.bus_failed(&error);
        }
    }

    /// Nothing seen so far says anything about what comes.
    pub(in crate::daemon) fn start_over(&mut self) {
        self.publisher.counters().add(Counter::Resets, 1);
        self.take_over_board();
    }
}
