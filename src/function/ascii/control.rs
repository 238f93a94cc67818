//! Control characters in the word of their own (DPRAM manual p. 28, firmware 1.15 and later).
//!
//! "The read/write procedure is exactly as described above except now […] write the ASCII value of the control character to
//! the dedicated register" can be read two ways: the register alone tells the board, or the command flag has to be set
//! too. So the register is written first. If the board has not taken the character [`FLAG_AFTER`] later and no line of
//! ours lies untaken, the command buffer is emptied (a NUL) and the flag set. A board that needs only the register and was
//! slow then finds an empty line, which does nothing; it may acknowledge it, so a silence follows before the next line.
//!
//! Where the board has the first part of a line, an empty one would end that, and the board carry it out. So it gets more time,
//! and then the buffer is filled with blanks, without a NUL: the board has no end of a line.

use std::time::{Duration, Instant};

use super::response_buffer::Untold;
use super::stop::goes_over_foreign;
use super::{DpramPort, State};
use crate::device::{Bus, BusError};
use crate::protocol::control::{ABORT, CANCEL, HOLD, KILL, QUIT, STEP, only_reports};

/// How long the board may take for a character before the flag is set too.
pub const FLAG_AFTER: Duration = Duration::from_millis(20);
/// The same, where the board has the first part of a line.
pub const FLAG_BEHIND_HALF_AFTER: Duration = Duration::from_millis(100);

/// A control character in its word.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Lying {
    character: u8,
    since: Instant,
    /// The flag was set for it, with an empty line.
    flagged: bool,
    /// It went over another one that the board may have been at: the word it clears may be that one's.
    again: bool,
}

impl DpramPort {
    /// Hands a control character to the board, which may be done at any time. `Ok(false)`: the board has not taken
    /// the last one yet, or its reply would mix with another; try later. With `has_reply` the lines that follow
    /// come as [`super::AsciiEvent::Line`] and end, after a silence, with [`super::AsciiEvent::Done`]; without, nothing
    /// comes. `^A`, `^K` and `^X` may go over a question of our own that the board has not taken.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn control(
        &mut self,
        bus: &mut impl Bus,
        character: u8,
        has_reply: bool,
        now: Instant,
    ) -> Result<bool, BusError> {
        let over_question = self.hold_asks() && [ABORT, KILL, CANCEL].contains(&character);
        let found = bus.read16(self.words.control_character)?;
        // One that nobody here has put there may lie there for ever.
        let is_foreign = self.lying.is_none() && !matches!(found, 0 | u16::MAX);
        let over_foreign = is_foreign && goes_over_foreign(character, found.to_le_bytes()[0]);
        let is_over = over_question || over_foreign;
        if has_reply && !self.is_idle() || found != 0 && !is_over {
            return Ok(false);
        }
        if over_question {
            self.ask_later(now);
        }
        self.put_control(bus, character, is_over, now)?;
        if has_reply {
            self.untold = Untold::default();
            self.state = State::ControlReply { taken: false, answered: false, quiet_since: now };
        }
        Ok(true)
    }

    /// Writes `character` to its word, `over` one that may lie there.
    pub(super) fn put_control(
        &mut self,
        bus: &mut impl Bus,
        character: u8,
        over: bool,
        now: Instant,
    ) -> Result<(), BusError> {
        let flagged = over && self.lying.is_some_and(|lying| lying.flagged);
        bus.write16(self.words.control_character, u16::from(character))?;
        bus.order_writes();
        self.lying = Some(Lying { character, since: now, flagged, again: over });
        Ok(())
    }

    /// Looks after the control character in its word. Whether one still waits there for the board to take it. 1 read, and 1
    /// more and 2 writes when the flag is set for it.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn control_pending(&mut self, bus: &mut impl Bus, now: Instant) -> Result<bool, BusError> {
        let Some(lying) = self.lying else { return Ok(false) };
        let word = bus.read16(self.words.control_character)?;
        if word == 0 && !lying.again {
            self.lying = None;
            self.takes_characters = true;
            return Ok(false);
        }
        if word == 0 {
            // The board may have cleared the word for the character that lay there before. What stops motion does no harm
            // when it comes twice.
            self.put_control(bus, lying.character, false, now)?;
            return Ok(true);
        }
        let has_half = self.has_half_a_line();
        let patience = if has_half { FLAG_BEHIND_HALF_AFTER } else { FLAG_AFTER };
        let is_late = now >= lying.since + patience && !lying.flagged;
        if is_late && !self.line_lies() && word != u16::MAX && !self.is_loaded(bus)? {
            self.lying = Some(Lying { flagged: true, ..lying });
            let (words, fill) = if has_half { (self.words.command_bytes / 2, b' ') } else { (1, 0) };
            for word in 0..words {
                bus.write16(self.words.command.plus_words(word), self.order.pack(fill, fill))?;
            }
            bus.order_writes();
            bus.write16(self.words.command_loaded.word, self.words.command_loaded.mask)?;
            bus.order_writes();
            self.settle(now);
        }
        Ok(true)
    }

    /// Whether the flag was set for a control character.
    pub(super) fn flag_is_characters(&self) -> bool {
        self.lying.is_some_and(|lying| lying.flagged)
    }

    /// Whether a response came before the board took the control character whose reply it would end. It is an earlier
    /// command's: nobody would look after the character any more, and no other one could be sent.
    pub(super) fn precedes_its_character(
        &mut self,
        bus: &mut impl Bus,
        now: Instant,
    ) -> Result<bool, BusError> {
        if !matches!(self.state, State::ControlReply { taken: false, .. }) {
            return Ok(false);
        }
        let lies = self.control_pending(bus, now)?;
        if !lies {
            self.state = State::ControlReply { taken: true, answered: false, quiet_since: now };
        }
        Ok(lies)
    }

    /// Takes back a control character the board has not taken, and the flag that was set for it.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn withdraw_control(&mut self, bus: &mut impl Bus) -> Result<(), BusError> {
        if self.flag_is_characters() {
            bus.write16(self.words.command_loaded.word, 0)?;
            bus.order_writes();
        }
        self.lying = None;
        bus.write16(self.words.control_character, 0)?;
        bus.order_writes();
        Ok(())
    }
}

/// Whether this control character is worth a line that lies before the board: it stops what moves or runs, or cancels. A board
/// that wants the flag for a character takes that of the line for it, and the line is lost (DPRAM manual p. 28: "exactly as described above").
#[must_use]
pub fn goes_over_line(character: u8) -> bool {
    const DISABLE_PLCS: u8 = 0x04;
    [ABORT, KILL, HOLD, QUIT, STEP, CANCEL, DISABLE_PLCS].contains(&character)
}

/// Whether PMAC answers this control character with data (software reference, on-line control characters).
#[must_use]
pub const fn control_has_reply(character: u8) -> bool {
    /// `^Y`: the last command line, ready to be sent again.
    const LAST_LINE: u8 = 0x19;
    only_reports(character) || character == LAST_LINE
}
