//! The control character that the port itself sends before the next line: `^X`, so that the board forgets the first
//! half of a line, or a repeated stop ([`super::stop`]).

use std::time::{Duration, Instant};

use super::{DpramPort, DpramState, PORT_REST};
use crate::device::{Bus, BusError};
use crate::protocol::control::CANCEL;

/// How long the board may leave the character untaken. Boards take characters within milliseconds.
pub const HELD_CHARACTER_TAKEN: Duration = Duration::from_millis(300);
/// How soon the port hands a withdrawn character over again.
pub const HELD_CHARACTER_AGAIN: Duration = Duration::from_millis(500);
/// How long the board may leave another host's control character untaken.
const FOREIGN_CHARACTER_TAKEN: Duration = Duration::from_secs(1);

/// The character, and where it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Hold {
    pub character: u8,
    place: HoldPlace,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum HoldPlace {
    /// The port hands the character over at this time or later.
    Due(Instant),
    /// The character has been in its word since this time.
    Lies(Instant),
}

impl Hold {
    pub(super) const fn new(character: u8, now: Instant) -> Self {
        Self { character, place: HoldPlace::Due(now) }
    }

    pub(super) const fn lies(&self) -> bool {
        matches!(self.place, HoldPlace::Lies(_))
    }

    /// Another control character has replaced it.
    pub(super) fn later(&mut self, now: Instant) {
        self.place = HoldPlace::Due(now + HELD_CHARACTER_AGAIN);
    }
}

impl DpramPort {
    /// Whether the board may hold the first part of a line. An empty line would end that part, and the board would run
    /// it.
    pub(super) const fn has_half_a_line(&self) -> bool {
        matches!(self.state, DpramState::Held(Hold { character: CANCEL, .. }))
    }

    /// Looks whether another host may have died in a line of two parts: the first has no NUL (DPRAM manual p. 28) and
    /// leaves the last byte of the buffer set. The board may keep that part, and would put our first line behind it.
    /// So the port tells the board to forget the part. A long line that was finished leaves the same byte, and so does
    /// memory that was never written: then the `^X` cancels nothing. The port tries once: to a board that does not
    /// take the `^X` (firmware before 1.15) it sends lines as if no part were left. 2 reads.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn look_for_half_a_line(&mut self, bus: &mut dyn Bus) -> Result<(), BusError> {
        let last_word = bus.read16(self.words.command.plus_words(self.words.command_bytes / 2 - 1))?;
        self.half_left = self.order.unpack(last_word)[1] != 0 && !self.is_out_of_reach(bus)?;
        if let DpramState::Resting { until } = self.state
            && self.half_left
        {
            self.state = DpramState::Held(Hold::new(CANCEL, until));
        }
        Ok(())
    }

    /// Takes back at once the line and the control character that the board has not taken. The board has forgotten the
    /// rest.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn withdraw(&mut self, bus: &mut dyn Bus, now: Instant) -> Result<(), BusError> {
        self.withdraw_control(bus)?;
        self.withdraw_line(bus)?;
        self.stop_again = None;
        match &mut self.state {
            // Another host's half line: the board has had no `^X` for it.
            DpramState::Held(hold) if self.half_left => *hold = Hold::new(CANCEL, now + PORT_REST),
            DpramState::Held(_) | DpramState::Emptied => {
                self.state = DpramState::Resting { until: now + PORT_REST }
            }
            _ => {}
        }
        Ok(())
    }

    /// The response buffer is empty: goes on handing the character over.
    pub(super) fn go_on_holding(
        &mut self,
        bus: &mut dyn Bus,
        mut hold: Hold,
        now: Instant,
    ) -> Result<(), BusError> {
        match hold.place {
            HoldPlace::Due(from) if now >= from && self.lying.is_none() => {
                let found = bus.read16(self.words.control_character)?;
                // Another host's character may stay in the word for ever.
                if found == 0 || now >= from + FOREIGN_CHARACTER_TAKEN && found != u16::MAX {
                    self.put_control(bus, hold.character, false, now)?;
                    hold.place = HoldPlace::Lies(now);
                }
            }
            HoldPlace::Lies(since) => {
                let is_cancel = hold.character == CANCEL;
                if !self.control_pending(bus, now)? {
                    self.half_left = false;
                    self.state = if is_cancel {
                        DpramState::Resting { until: now + PORT_REST }
                    } else {
                        DpramState::Idle
                    };
                    return Ok(());
                }
                if now >= since + HELD_CHARACTER_TAKEN {
                    self.withdraw_control(bus)?;
                    self.unheard |= is_cancel;
                    if is_cancel && std::mem::take(&mut self.half_left) {
                        self.state = DpramState::Resting { until: now + PORT_REST };
                        return Ok(());
                    }
                    if !is_cancel && !self.takes_characters {
                        self.state = DpramState::Idle;
                        return Ok(());
                    }
                    hold.later(now);
                }
            }
            _ => {}
        }
        self.state = DpramState::Held(hold);
        Ok(())
    }
}
