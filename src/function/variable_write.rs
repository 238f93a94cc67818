//! Background variable write, the host's half: sets registers, or bits of them, without a command line (DPRAM manual
//! p. 24-25, firmware 1.15G and later).
//!
//! | word | host | PMAC |
//! |---|---|---|
//! | 0x07D4 | writes the number of records, 1-32, last | writes 0 when it has done them |
//! | 0x07D6 | writes where the records lie, a PMAC address | reads |
//! | records, 6 words each | writes | reads |
//!
//! A record: the register's address; bits 2-0 its kind, 7-3 the width, 12-8 the offset, 15-13 the sort of special
//! register (0); the data, two longs. Kinds 4 and 6 (firmware 1.16) are the Y and X word of a compiled PLC's function
//! block, whose number stands for the address. The data begin at bit 0, whatever the offset. The manual prints 0x07E6
//! and 0x07E8 for the first two words, which are the variable-read function's. The host hands over more than 32
//! records in several cycles, in their order. PMAC does each cycle in one background pass, but not the whole.
//!
//! A Turbo board has the function, too (Turbo User Manual p. 410), but no manual tells the form of its records: the
//! host gives it none.
//!
//! Needs I55 = 1. PMAC refuses no record; it writes to any address. Address 0 is the servo clock: writing it trips the
//! watchdog, so the driver refuses it.

use std::time::{Duration, Instant};

use crate::device::{Bus, BusError};
use crate::format::{fixed48, float48, int24, split32, write48};
use crate::map::functions::{
    RECORD_OFFSET, RECORD_WIDTH, VARIABLE_WRITE_RECORD_WORDS, VARIABLE_WRITE_RECORDS,
};
use crate::map::{
    Family, PmacAddress, PmacRegister, Region, Space, VariableKind, VariableName, VariableWrite,
};
use crate::protocol::board::VariableRecord;

/// How long the host leaves the records alone after it took back the count: PMAC may be at work on them, and clears
/// the count when it is done.
pub const WITHDRAWN_RECORDS_REST: Duration = Duration::from_millis(50);
/// The most records that one poll writes, so that servo data need not wait.
pub const POLL_RECORDS: usize = 5;
/// Bits in a PMAC word.
const WORD_BITS: u8 = 24;
/// The widths that PMAC writes, in bits.
const WIDTHS: [u8; 7] = [1, 4, 8, 12, 16, 20, WORD_BITS];

/// Why the driver refused a record.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RecordError {
    /// The servo clock.
    #[error("address 0 is PMAC's servo clock; writing it would trip the watchdog")]
    AddressZero,
    /// A register of two words for a value of one, or the other way round.
    #[error("{0} is not as many words as the value")]
    Words(PmacRegister),
    /// A width PMAC does not write.
    #[error("PMAC writes 1, 4, 8, 12, 16, 20 or 24 bits, not {0}")]
    Width(u8),
    /// Bits that are not in the word.
    #[error("{width} bits from bit {offset} on leave the word, which has bits 0 to 23")]
    Offset {
        /// The width.
        width: u8,
        /// The first bit.
        offset: u8,
    },
    /// A value that does not fit the width.
    #[error("{value} does not fit in {width} bits, which hold {least} to {most}")]
    Value {
        /// The value.
        value: i64,
        /// The width.
        width: u8,
        /// The least value: the least signed one.
        least: i64,
        /// The largest value: the largest unsigned one.
        most: i64,
    },
    /// A fixed-point value of more than 48 bits.
    #[error("{0} does not fit in 48 bits")]
    Fixed48(i64),
    /// A floating-point value that is infinite or no number.
    #[error("{0} cannot be held by a 48-bit floating-point register")]
    Float48(f64),
}

/// One register, or some of its bits, and the value to write there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WriteRecord {
    register: PmacRegister,
    /// The word belongs to a function block, and the register's address is the block's number.
    block: bool,
    /// As in the record: 0 is the whole word.
    width: u16,
    offset: u16,
    /// As in the record.
    data: [u32; 2],
}

impl WriteRecord {
    /// The record that a client asks for, on a board of `family`.
    ///
    /// # Errors
    /// A text that names the register and tells which part is wrong or does not fit.
    pub fn of(record: &VariableRecord, family: &Family) -> Result<Self, String> {
        let VariableRecord { register: text, offset, width, value } = record;
        let name = VariableName::parse(text, family).map_err(|error| error.to_string())?;
        let whole = || {
            if value.fract() == 0.0 && value.abs() < 2f64.powi(53) {
                Ok(*value as i64)
            } else {
                Err(format!("{text} takes a whole number, not {value}"))
            }
        };
        let (bits, first) = (width.unwrap_or(WORD_BITS), offset.unwrap_or(0));
        let made = match name {
            VariableName::Block { number, word } => {
                let word = word.and_then(|word| PmacRegister::new(PmacAddress::new(word, number.into())));
                let word = word.ok_or_else(|| {
                    format!(
                        "{text}: PMAC writes a word of a function block: PLCC:X:{number} or PLCC:Y:{number}"
                    )
                })?;
                Self::block(word, bits, first, whole()?)
            }
            VariableName::Register(register) => match register.address().space {
                Space::D | Space::L if width.is_some() || offset.is_some() => {
                    return Err(format!("{text} is written as a whole; leave width and offset out"));
                }
                Space::D => Self::fixed48(register, whole()?),
                Space::L => Self::float48(register, *value),
                _ => Self::word(register, bits, first, whole()?),
            },
        };
        made.map_err(|reason| format!("{text}: {reason}"))
    }

    /// Writes `value` to the `width` bits (1, 4, 8, 12, 16, 20, 24) from bit `offset` on of a `Y:` or `X:` word. The
    /// value may be meant signed or unsigned: with 4 bits, -8 to 15.
    ///
    /// # Errors
    /// A record that PMAC cannot carry out, or not without harm.
    pub fn word(register: PmacRegister, width: u8, offset: u8, value: i64) -> Result<Self, RecordError> {
        if register.kind() == VariableKind::Long {
            return Err(RecordError::Words(register));
        }
        if !WIDTHS.contains(&width) {
            return Err(RecordError::Width(width));
        }
        if offset > WORD_BITS - width {
            return Err(RecordError::Offset { width, offset });
        }
        let (least, most) = (-(1i64 << (width - 1)), (1i64 << width) - 1);
        if !(least..=most).contains(&value) {
            return Err(RecordError::Value { value, width, least, most });
        }
        let bits = value as u32 & (int24::MASK >> (WORD_BITS - width));
        let width = if width == WORD_BITS { 0 } else { width.into() };
        Self::new(register, width, offset.into(), [bits, 0])
    }

    /// As [`WriteRecord::word`], for a word of a compiled PLC's function block: `X:7` is the X word of block 7. PMAC
    /// and PMAC2 with firmware 1.16.
    ///
    /// # Errors
    /// As [`WriteRecord::word`].
    pub fn block(word: PmacRegister, width: u8, offset: u8, value: i64) -> Result<Self, RecordError> {
        Ok(Self { block: true, ..Self::word(word, width, offset, value)? })
    }

    /// Writes a `D:` or `L:` register as two words; bits 31-24 of each do not matter.
    ///
    /// # Errors
    /// Address 0, or a register of one word.
    pub fn long(register: PmacRegister, y: u32, x: u32) -> Result<Self, RecordError> {
        if register.kind() != VariableKind::Long {
            return Err(RecordError::Words(register));
        }
        Self::new(register, 0, 0, write48::pack([y, x]))
    }

    /// Writes a fixed-point register (`D:`).
    ///
    /// # Errors
    /// As [`WriteRecord::long`], or a value of more than 48 bits with its sign.
    pub fn fixed48(register: PmacRegister, value: i64) -> Result<Self, RecordError> {
        let [y, x] = fixed48::encode(value);
        if fixed48::decode(y, x) != value {
            return Err(RecordError::Fixed48(value));
        }
        Self::long(register, y, x)
    }

    /// Writes a floating-point register (`L:`); the value is rounded to its 36 bits of mantissa.
    ///
    /// # Errors
    /// As [`WriteRecord::long`], or a value that is infinite or no number.
    pub fn float48(register: PmacRegister, value: f64) -> Result<Self, RecordError> {
        if !value.is_finite() {
            return Err(RecordError::Float48(value));
        }
        let [y, x] = float48::encode(value);
        Self::long(register, y, x)
    }

    const fn new(
        register: PmacRegister,
        width: u16,
        offset: u16,
        data: [u32; 2],
    ) -> Result<Self, RecordError> {
        if register.address().number == 0 {
            return Err(RecordError::AddressZero);
        }
        Ok(Self { register, block: false, width, offset, data })
    }

    /// The record as it lies in the DPRAM, first word first.
    #[must_use]
    pub fn words(&self) -> [u16; VARIABLE_WRITE_RECORD_WORDS] {
        let block = if self.block { VariableKind::Special.code() } else { 0 };
        let type_word =
            self.register.kind().code() | block | self.width << RECORD_WIDTH | self.offset << RECORD_OFFSET;
        let [[low_1, high_1], [low_2, high_2]] = self.data.map(split32);
        [self.register.address().number as u16, type_word, low_1, high_1, low_2, high_2]
    }
}

/// The result of a poll.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WritePoll {
    /// Nothing is under way; [`VariableWriter::begin`] may be called.
    Idle,
    /// The host is handing over records, PMAC has not done them yet, or the host lets them rest after it gave up a
    /// job.
    Waiting,
    /// PMAC has done this many more records, and further ones follow.
    Progress(usize),
    /// PMAC has done all records; the job is over.
    Done,
}

/// The outcome of an abandoned job.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GivenUp {
    /// Records, from the first on, that PMAC has done.
    pub done: usize,
    /// The records behind those, which PMAC may have done in part or in whole.
    pub uncertain: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum WriterState {
    Idle,
    /// The host has written the cycle's records before `next`.
    Loading {
        next: usize,
    },
    /// The count is set; PMAC has the cycle's records.
    Handed,
    /// The host took back a count at this moment.
    Settling {
        since: Instant,
    },
}

/// The host's half of the function: one job at a time.
pub struct VariableWriter {
    family: &'static Family,
    write: &'static VariableWrite,
    place: Region,
    state: WriterState,
    records: Vec<WriteRecord>,
    /// Records of cycles that are done.
    done: usize,
}

impl VariableWriter {
    /// A writer on a board of `family` that keeps its records in `place` (a plan's). With less room than one record it
    /// writes nothing.
    #[must_use]
    pub fn new(family: &'static Family, place: Region) -> Self {
        Self {
            family,
            write: &family.variable_write,
            place,
            state: WriterState::Idle,
            records: Vec::new(),
            done: 0,
        }
    }

    /// Takes back records that this host or a dead one left for PMAC. The caller calls this at the start and on every
    /// way out. 1 write.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn release(&self, bus: &mut impl Bus) -> Result<(), BusError> {
        bus.write16(self.write.count, 0)?;
        bus.order_writes();
        Ok(())
    }

    /// Whether [`VariableWriter::begin`] may be called.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        self.state == WriterState::Idle
    }

    /// Records that go in one cycle.
    #[must_use]
    pub fn records_per_cycle(&self) -> usize {
        (self.place.words() / VARIABLE_WRITE_RECORD_WORDS).min(VARIABLE_WRITE_RECORDS)
    }

    /// Starts writing `records`, in their order. `Err` gives them back: the writer is not idle or has no room, PMAC
    /// still works for another host, or the board is absent; try later. An empty job is done at once. 1 read; each
    /// cycle costs 6 writes a record and 2 more, and the reads of the polls that wait.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn begin(
        &mut self,
        bus: &mut impl Bus,
        records: Vec<WriteRecord>,
    ) -> Result<Result<(), Vec<WriteRecord>>, BusError> {
        if !self.is_idle() || self.records_per_cycle() == 0 || bus.read16(self.write.count)? != 0 {
            return Ok(Err(records));
        }
        self.records = records;
        self.done = 0;
        self.state = WriterState::Loading { next: 0 };
        Ok(Ok(()))
    }

    /// Does the work that is possible now. Writes at most [`POLL_RECORDS`] records and 2 words, or reads 1 word.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn poll(&mut self, bus: &mut impl Bus, now: Instant) -> Result<WritePoll, BusError> {
        match self.state {
            WriterState::Idle => Ok(WritePoll::Idle),
            WriterState::Loading { .. } if self.cycle() == 0 => {
                self.state = WriterState::Idle;
                Ok(WritePoll::Done)
            }
            WriterState::Loading { next } => {
                self.load(bus, next)?;
                Ok(WritePoll::Waiting)
            }
            WriterState::Handed => {
                if bus.read16(self.write.count)? != 0 {
                    return Ok(WritePoll::Waiting);
                }
                bus.order_reads();
                let cycle = self.cycle();
                self.done += cycle;
                if self.cycle() == 0 {
                    self.state = WriterState::Idle;
                    return Ok(WritePoll::Done);
                }
                self.state = WriterState::Loading { next: 0 };
                Ok(WritePoll::Progress(cycle))
            }
            WriterState::Settling { since } if now >= since + WITHDRAWN_RECORDS_REST => {
                self.state = WriterState::Idle;
                Ok(WritePoll::Idle)
            }
            WriterState::Settling { .. } => Ok(WritePoll::Waiting),
        }
    }

    /// Ends the job under way: takes the count back, so that PMAC does no more of the job from the next pass on, and
    /// tells which records PMAC did. 1 write when PMAC has records. Without a job under way PMAC has done none.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn give_up(&mut self, bus: &mut impl Bus, now: Instant) -> Result<GivenUp, BusError> {
        let uncertain = match self.state {
            WriterState::Idle | WriterState::Settling { .. } => return Ok(GivenUp { done: 0, uncertain: 0 }),
            WriterState::Loading { .. } => {
                self.state = WriterState::Idle;
                0
            }
            WriterState::Handed => {
                self.release(bus)?;
                self.state = WriterState::Settling { since: now };
                self.cycle()
            }
        };
        Ok(GivenUp { done: self.done, uncertain })
    }

    /// After [`VariableWriter::release`]: gives up the job under way, and lets the records rest in any case, since
    /// PMAC may be at work on an earlier host's records.
    pub fn acquire(&mut self, now: Instant) -> GivenUp {
        let uncertain = if self.state == WriterState::Handed { self.cycle() } else { 0 };
        self.state = WriterState::Settling { since: now };
        GivenUp { done: self.done, uncertain }
    }

    /// Records of the present cycle.
    fn cycle(&self) -> usize {
        (self.records.len() - self.done).min(self.records_per_cycle())
    }

    /// Writes the next records, and after the cycle's last one hands them over.
    fn load(&mut self, bus: &mut impl Bus, next: usize) -> Result<(), BusError> {
        let cycle = self.cycle();
        let end = cycle.min(next + POLL_RECORDS);
        for index in next..end {
            let first = self.place.start.plus_words(index * VARIABLE_WRITE_RECORD_WORDS);
            for (word, value) in self.records[self.done + index].words().into_iter().enumerate() {
                bus.write16(first.plus_words(word), value)?;
            }
        }
        if end < cycle {
            self.state = WriterState::Loading { next: end };
            return Ok(());
        }
        bus.write16(self.write.start, self.family.start.start_word(self.place.start))?;
        bus.order_writes();
        bus.write16(self.write.count, cycle as u16)?;
        bus.order_writes();
        self.state = WriterState::Handed;
        Ok(())
    }
}

#[cfg(test)]
#[path = "variable_write_tests.rs"]
mod tests;
