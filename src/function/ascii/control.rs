//! Control characters in the word of their own (DPRAM manual p. 28, firmware 1.15 and later).
//!
//! Drivers in production write the register alone. The manual's "the read/write procedure is exactly as described
//! above" might mean that the host must set the command flag, too. So the port sets the flag for `^A`, `^K`, `^O` and
//! `^Q` after [`CHARACTER_FLAG_AFTER`], with an empty line, if no line of ours is untaken. It stops doing so when the
//! board has taken a reporting character by its word alone. A board that was only slow finds the empty line, which
//! does nothing; the board may acknowledge it.

use std::time::{Duration, Instant};

use super::stop::{goes_over_foreign, may_come_twice};
use super::{DpramPort, DpramState};
use crate::device::{Bus, BusError};
use crate::function::line_port::LinePort;
use crate::map::HostOffset;
use crate::protocol::control::{ABORT, CANCEL, HOLD, KILL, QUIT, STEP, only_reports};

/// How long the board may take for a character before the port also sets the flag.
pub const CHARACTER_FLAG_AFTER: Duration = Duration::from_millis(20);
/// A control character in its word.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Lying {
    character: u8,
    since: Instant,
    /// The port set the flag for the character, with an empty line.
    flagged: bool,
    /// The character replaced another one that the board may have been taking: the board may clear the word for that
    /// earlier character.
    again: bool,
}

impl DpramPort {
    /// Hands a control character to the board, at any time. `Ok(false)`: the board has not taken the last character
    /// yet, or the new character's reply would mix with another; try later. With `has_reply` the port reports
    /// `AsciiEvent::Taken` and the reply's lines as `AsciiEvent::Line`; without, it reports nothing. `^A`, `^K` and
    /// `^X` replace an untaken character: a reporting one, which the port then gives up, or one that the port itself
    /// sent.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn control(
        &mut self,
        bus: &mut dyn Bus,
        character: u8,
        has_reply: bool,
        now: Instant,
    ) -> Result<bool, BusError> {
        let is_urgent = [ABORT, KILL, CANCEL].contains(&character);
        let found = bus.read16(self.words.control_character)?;
        let over_own = is_urgent && found != 0 && self.own_lies();
        // Another host's character may stay in the word for ever.
        let is_foreign = self.lying.is_none() && !matches!(found, 0 | u16::MAX);
        let over_foreign = is_foreign && goes_over_foreign(character, found.to_le_bytes()[0]);
        let is_over = over_own || over_foreign;
        if has_reply && self.state != DpramState::Idle || found != 0 && !is_over {
            return Ok(false);
        }
        match &mut self.state {
            DpramState::Held(hold) if over_own => hold.later(now),
            DpramState::Control if over_own => self.state = DpramState::Idle,
            // The board has taken the last character; the next poll reports that.
            DpramState::Control => self.question_taken = true,
            _ => {}
        }
        self.put_control(bus, character, is_over, now)?;
        if has_reply {
            self.state = DpramState::Control;
        }
        Ok(true)
    }

    /// Whether the word holds a reporting character, or one that the port itself sent.
    const fn own_lies(&self) -> bool {
        match self.state {
            DpramState::Control => true,
            DpramState::Held(hold) => hold.lies(),
            _ => false,
        }
    }

    /// Writes `character` to its word; with `over` it replaces a character that may be there.
    pub(super) fn put_control(
        &mut self,
        bus: &mut dyn Bus,
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

    /// Looks after the control character in its word. Tells whether the character still waits for the board to take
    /// it. 1 read; 1 more and 2 writes when the port sets the flag for the character.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn control_pending(&mut self, bus: &mut dyn Bus, now: Instant) -> Result<bool, BusError> {
        let Some(lying) = self.lying else { return Ok(false) };
        let word = bus.read16(self.words.control_character)?;
        if word == 0 && !lying.again {
            self.lying = None;
            self.unheard = false;
            return Ok(false);
        }
        if word == 0 {
            // The board may have cleared the word for the earlier character. A stop that comes twice does no harm.
            self.put_control(bus, lying.character, false, now)?;
            return Ok(true);
        }
        let wants_flag = !lying.flagged && !self.takes_characters && may_come_twice(lying.character);
        let may_flag = !self.line_lies() && !self.has_half_a_line() && word != u16::MAX;
        if wants_flag && may_flag && now >= lying.since + CHARACTER_FLAG_AFTER && !self.is_loaded(bus)? {
            self.lying = Some(Lying { flagged: true, ..lying });
            bus.write16(self.words.command, 0)?;
            bus.order_writes();
            bus.write16(self.words.command_loaded.word, self.words.command_loaded.mask)?;
            bus.order_writes();
        }
        Ok(true)
    }

    /// Whether a control character with a reply is under way that the port has not seen the board take.
    #[must_use]
    pub fn is_asking(&self) -> bool {
        self.state == DpramState::Control
    }

    /// Whether the port has seen the board take a control character by its word alone: a reporting character, while no
    /// line's flag was set.
    #[must_use]
    pub const fn takes_characters(&self) -> bool {
        self.takes_characters
    }

    /// The word of control characters.
    #[must_use]
    pub const fn character_word(&self) -> HostOffset {
        self.words.control_character
    }

    /// The board may have been replaced, so the port must see again how the board takes control characters.
    pub const fn forget_characters(&mut self) {
        self.takes_characters = false;
    }

    /// Whether the port set the flag for the control character in the word.
    #[must_use]
    pub fn flag_is_characters(&self) -> bool {
        self.lying.is_some_and(|lying| lying.flagged)
    }

    /// Takes back a control character that the board has not taken, and the flag that the port set for it.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn withdraw_control(&mut self, bus: &mut dyn Bus) -> Result<(), BusError> {
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

/// Whether this control character may end a waiting line: it stops motion or programs, or cancels.
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
