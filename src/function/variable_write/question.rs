//! What PMAC is asked by a record, before the records of a job.
//!
//! PMAC may be at work on records whose count the host has taken back, and clears the count when it is done, whatever the
//! host has put there meanwhile (p. 24: "when it is finished it will change the value in this register to a 0"; "it sets
//! register Y:$D1F5 to zero to let the host know that it has completed a cycle"). That must not look as if the next records
//! were written. So the first record after a job that was given up, or after the start, is a question: it has PMAC write a
//! number into the record itself, into a word that no record of one word uses. Once the number stands there, PMAC has
//! finished whatever it was at.
//!
//! A `D:` or `L:` register has 48 bits, and no text says how a Turbo board has them in the two longs: as PMAC, or as it has them
//! where it is read. So the first job that has such a record asks: it has PMAC write a long into the record itself, of which the X
//! word tells.

use super::{State, VariableWriter, WritePoll, WriteRecord};
use crate::device::{Bus, BusError};
use crate::format::write48;
use crate::map::functions::VARIABLE_WRITE_RECORD_WORDS;
use crate::map::readings::WriteLong;
use crate::map::{HostOffset, PmacAddress, PmacRegister, Space};

/// How often the question is asked again. PMAC clears the count once for what it was at; from then on the record itself is
/// what it reads otherwise, and each time it may write where nobody looks.
const ASKED_AGAIN: u8 = 1;
/// The X word of the long that asks how PMAC has longs, packed as [`WriteLong::Low32`]; otherwise packed it is 0.
const ASKED_X: u16 = 1;
/// What lies there before: of the second data long these bits have no meaning.
const NOT_WRITTEN: u16 = 0xFF00;

/// What a record asks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Asks {
    /// Whether PMAC has finished all else.
    Finished,
    /// How it has 48 bits.
    Long,
}

impl VariableWriter {
    /// Has PMAC write a new number into the second data long of the record that asks for it.
    pub(super) fn ask(&mut self, bus: &mut impl Bus, what: Asks) -> Result<(), BusError> {
        self.asked = self.asked.checked_add(1).unwrap_or(1);
        let (space, data) = match what {
            Asks::Finished => (Space::Y, [self.asked.into(), 0]),
            Asks::Long => (Space::D, write48::pack([self.asked.into(), ASKED_X.into()])),
        };
        let answer = PmacAddress::new(space, self.family.pmac_number(self.answer()));
        // The DPRAM lies where every family has registers.
        let Some(register) = PmacRegister::new(answer) else { return Ok(()) };
        let question = WriteRecord { register, block: false, width: 0, offset: 0, data };
        self.put(bus, 0, &question)?;
        if what == Asks::Long {
            bus.write16(self.answer().plus_words(1), NOT_WRITTEN)?;
        }
        self.hand_over(bus, 1)?;
        self.state = State::Asking { what, before: 0 };
        Ok(())
    }

    /// The count of the question was cleared: by PMAC's answer, or by what it was at before.
    pub(super) fn hear(&mut self, bus: &mut impl Bus, what: Asks, before: u8) -> Result<WritePoll, BusError> {
        let is_answered = bus.read16(self.answer())? == self.asked;
        let long = match what {
            Asks::Long if is_answered => match bus.read16(self.answer().plus_words(1))? {
                ASKED_X => Some(WriteLong::Low32),
                0 => Some(WriteLong::Halves),
                _ => None,
            },
            _ => None,
        };
        if is_answered && (what == Asks::Finished || long.is_some()) {
            self.doubtful = false;
            self.long = self.long.or(long);
            self.state = State::Loading { next: 0 };
        } else if before < ASKED_AGAIN {
            self.hand_over(bus, 1)?;
            self.state = State::Asking { what, before: before + 1 };
        } else {
            self.state = State::Idle;
            return Ok(match what {
                Asks::Finished => WritePoll::Misread,
                Asks::Long => WritePoll::LongMisread,
            });
        }
        Ok(WritePoll::Waiting)
    }

    /// Where PMAC writes its answer: the low word of the first record's second data long.
    pub(super) const fn answer(&self) -> HostOffset {
        self.place.start.plus_words(VARIABLE_WRITE_RECORD_WORDS - 2)
    }
}
