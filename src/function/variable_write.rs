//! Background variable write, the host's half: registers or bits of them set without a command line (DPRAM manual
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
//! block, whose number stands for the address. The manual prints 0x07E6 and 0x07E8 for the first two words, which are the
//! variable-read function's. More than 32 records go in several cycles, in their order; each cycle is done in one
//! background pass, the whole is not.
//!
//! Needs I55 = 1. Nothing tells that a record was refused; PMAC writes where it is told to. Address 0 is the servo
//! clock: writing it trips the watchdog, so it is refused.

mod question;

use std::time::{Duration, Instant};

use question::Asks;

use crate::device::{Bus, BusError};
use crate::format::{fixed48, float48, int24, split32, write48};
use crate::map::functions::{VARIABLE_WRITE_RECORD_WORDS, VARIABLE_WRITE_RECORDS};
use crate::map::readings::{FieldData, WriteLong};
use crate::map::{
    Family, HostOffset, PmacAddress, PmacRegister, RecordBits, Region, Space, VariableKind, VariableName,
    VariableWrite,
};
use crate::protocol::board::VariableRecord;

/// How long after the count was taken back the records are left alone: PMAC may be about to read them.
pub const SETTLE: Duration = Duration::from_millis(50);
/// Records that one poll writes at most, so that servo data need not wait.
pub const POLL_RECORDS: usize = 5;
/// Bits in a PMAC word.
const WORD_BITS: u8 = 24;
/// Widths PMAC writes, in bits.
const WIDTHS: [u8; 7] = [1, 4, 8, 12, 16, 20, WORD_BITS];

/// Why a record was refused.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RecordError {
    /// The servo clock.
    #[error("address 0 is PMAC's servo clock; writing it would trip the watchdog")]
    AddressZero,
    /// A register of two words where one is wanted, or the other way round.
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
    /// A value of more bits.
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

/// One register, or some bits of one, and what to write there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WriteRecord {
    register: PmacRegister,
    /// The word is a function block's, and the register's address its number.
    block: bool,
    /// As in the record: 0 is the whole word.
    width: u16,
    offset: u16,
    /// As in the record; 48 bits as [`WriteLong::Low32`] has them.
    data: [u32; 2],
}

impl WriteRecord {
    /// What a client asks for, on a board of `family`.
    ///
    /// # Errors
    /// In words, with the register: what is not written so, or does not fit.
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

    /// Writes `value` to the `width` bits (1, 4, 8, 12, 16, 20, 24) from bit `offset` on of a `Y:` or `X:` word. The value
    /// may be meant signed or unsigned: with 4 bits, -8 to 15.
    ///
    /// # Errors
    /// What PMAC could not do, or not do without harm.
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

    /// As [`WriteRecord::word`], for a word of a compiled PLC's function block: `X:7` is the X word of block 7. PMAC and
    /// PMAC2 with firmware 1.16.
    ///
    /// # Errors
    /// As [`WriteRecord::word`].
    pub fn block(word: PmacRegister, width: u8, offset: u8, value: i64) -> Result<Self, RecordError> {
        Ok(Self { block: true, ..Self::word(word, width, offset, value)? })
    }

    /// Writes a `D:` or `L:` register as two words; of each, bits 31-24 do not matter.
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

    /// Whether it writes a register of 48 bits.
    fn is_long(&self) -> bool {
        self.register.kind() == VariableKind::Long
    }

    /// The record as it lies in the DPRAM of a board whose type word has its parts at `bits`, first word first. `field` says
    /// where some bits' data stand ("starting offset for the read", p. 25, may be the register's offset or the data's, too), `long`
    /// how 48 bits do.
    #[must_use]
    pub fn words(
        &self,
        bits: RecordBits,
        field: FieldData,
        long: WriteLong,
    ) -> [u16; VARIABLE_WRITE_RECORD_WORDS] {
        let address = self.register.address().number;
        let block = if self.block { VariableKind::Special.code() } else { 0 };
        let type_word = (self.register.kind().code() | block) << bits.kind
            | self.width << bits.width
            | self.offset << bits.offset
            | ((address >> 16) as u16) << bits.address_high;
        let [data_1, data_2] = match long {
            WriteLong::Halves if self.is_long() => write48::unpack(self.data).map(int24::unsigned),
            _ => self.data,
        };
        let data_1 = match field {
            FieldData::AtBit0 => data_1,
            FieldData::AtOffset => data_1 << self.offset,
        };
        let [[low_1, high_1], [low_2, high_2]] = [data_1, data_2].map(split32);
        [address as u16, type_word, low_1, high_1, low_2, high_2]
    }
}

/// What a poll gave.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WritePoll {
    /// Nothing is under way; [`VariableWriter::begin`] may be called.
    Idle,
    /// Records are being handed over, PMAC has not done them yet, or the records rest after a job was given up.
    Waiting,
    /// PMAC has done this many records more, and more follow.
    Progress(usize),
    /// PMAC has done them all; the job is over.
    Done,
    /// PMAC says that it has written and has not: it reads a record otherwise. The job is over; nothing of it was handed over.
    Misread,
    /// The same of a record of 48 bits.
    LongMisread,
}

/// What became of a job that was given up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GivenUp {
    /// Records, from the first on, that PMAC has done.
    pub done: usize,
    /// Records behind those that PMAC may have done, in part or in whole.
    pub uncertain: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Idle,
    /// Of the cycle's records, those before `next` are written.
    Loading {
        next: usize,
    },
    /// The count is set; PMAC has a record that asks, and has had it so often before.
    Asking {
        what: Asks,
        before: u8,
    },
    /// The count is set; PMAC has the cycle's records.
    Handed,
    /// A count was taken back at this moment.
    Settling {
        since: Instant,
    },
}

/// The host's half of the function: one job at a time.
pub struct VariableWriter {
    family: &'static Family,
    write: &'static VariableWrite,
    place: Region,
    /// Where the data of some bits stand.
    field: FieldData,
    /// How a record's type word is made up.
    bits: RecordBits,
    /// How a record has 48 bits, as far as known.
    long: Option<WriteLong>,
    state: State,
    /// PMAC may be at work on records whose count was taken back.
    doubtful: bool,
    /// The number that the last question has PMAC write.
    asked: u16,
    records: Vec<WriteRecord>,
    /// Records of cycles that are done.
    done: usize,
}

impl VariableWriter {
    /// A writer on a board of `family` that keeps its records in `place` (a plan's). With less room than one record it can
    /// write nothing.
    #[must_use]
    pub fn new(family: &'static Family, place: Region) -> Self {
        Self {
            family,
            write: &family.variable_write,
            place,
            field: FieldData::default(),
            bits: family.variable_write.record,
            long: family.variable_write.long,
            state: State::Idle,
            doubtful: false,
            asked: 0,
            records: Vec::new(),
            done: 0,
        }
    }

    /// The writer, on a board whose records' type words are made up so.
    #[must_use]
    pub fn with_record(self, bits: RecordBits) -> Self {
        Self { bits, ..self }
    }

    /// The writer, on a board that reads some bits' data so.
    #[must_use]
    pub fn with_field(self, field: FieldData) -> Self {
        Self { field, ..self }
    }

    /// Takes back records a host, this one or a dead one, left for PMAC. To be called at the start and on every way
    /// out. 1 write.
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
        self.state == State::Idle
    }

    /// Records that go in one cycle.
    #[must_use]
    pub fn records_per_cycle(&self) -> usize {
        (self.place.words() / VARIABLE_WRITE_RECORD_WORDS).min(VARIABLE_WRITE_RECORDS)
    }

    /// Starts writing `records`, in their order. `Err` gives them back: the writer is not idle, has no room, or PMAC
    /// still works for another host, or there is no board; try later. No record is no job: it is done at once.
    /// 1 read; each cycle costs 6 writes a record and 2 more, and the reads of the polls that wait. The first job after one that
    /// was given up, or after the start, costs a cycle of one record more, and 1 read; so does the first one with a register of 48 bits
    /// where no text says how a record has it, with 1 read and 1 write more.
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
        self.state = State::Loading { next: 0 };
        Ok(Ok(()))
    }

    /// Does what can be done now. At most [`POLL_RECORDS`] records and 2 words are written, or 1 is read.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn poll(&mut self, bus: &mut impl Bus, now: Instant) -> Result<WritePoll, BusError> {
        match self.state {
            State::Idle => Ok(WritePoll::Idle),
            State::Loading { .. } if self.cycle() == 0 => {
                self.state = State::Idle;
                Ok(WritePoll::Done)
            }
            State::Loading { .. } if self.doubtful => {
                self.ask(bus, Asks::Finished)?;
                Ok(WritePoll::Waiting)
            }
            State::Loading { .. } if self.long.is_none() && self.records.iter().any(WriteRecord::is_long) => {
                self.ask(bus, Asks::Long)?;
                Ok(WritePoll::Waiting)
            }
            State::Loading { next } => {
                self.load(bus, next)?;
                Ok(WritePoll::Waiting)
            }
            State::Asking { what, before } => {
                if bus.read16(self.write.count)? != 0 {
                    return Ok(WritePoll::Waiting);
                }
                bus.order_reads();
                self.hear(bus, what, before)
            }
            State::Handed => {
                if bus.read16(self.write.count)? != 0 {
                    return Ok(WritePoll::Waiting);
                }
                bus.order_reads();
                let cycle = self.cycle();
                self.done += cycle;
                if self.cycle() == 0 {
                    self.state = State::Idle;
                    return Ok(WritePoll::Done);
                }
                self.state = State::Loading { next: 0 };
                Ok(WritePoll::Progress(cycle))
            }
            State::Settling { since } if now >= since + SETTLE => {
                self.state = State::Idle;
                Ok(WritePoll::Idle)
            }
            State::Settling { .. } => Ok(WritePoll::Waiting),
        }
    }

    /// Ends the job under way: takes the count back, so that PMAC does nothing more of it from the next pass on, and
    /// tells what it did. 1 write when PMAC has records. A job that is not under way has done nothing.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn give_up(&mut self, bus: &mut impl Bus, now: Instant) -> Result<GivenUp, BusError> {
        let uncertain = match self.state {
            State::Idle | State::Settling { .. } => return Ok(GivenUp { done: 0, uncertain: 0 }),
            State::Loading { .. } => {
                self.state = State::Idle;
                0
            }
            State::Asking { .. } => {
                self.take_back(bus, now)?;
                0
            }
            State::Handed => {
                self.take_back(bus, now)?;
                self.cycle()
            }
        };
        Ok(GivenUp { done: self.done, uncertain })
    }

    /// After [`VariableWriter::release`]: gives up the job under way, and lets the records rest in any case, since PMAC may
    /// be at work on those of the host before.
    pub fn acquire(&mut self, now: Instant) -> GivenUp {
        let uncertain = if self.state == State::Handed { self.cycle() } else { 0 };
        self.state = State::Settling { since: now };
        self.doubtful = true;
        // It may be another board.
        self.long = self.write.long;
        GivenUp { done: self.done, uncertain }
    }

    fn take_back(&mut self, bus: &mut impl Bus, now: Instant) -> Result<(), BusError> {
        self.release(bus)?;
        self.state = State::Settling { since: now };
        self.doubtful = true;
        Ok(())
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
            self.put(bus, index, &self.records[self.done + index])?;
        }
        if end < cycle {
            self.state = State::Loading { next: end };
            return Ok(());
        }
        self.hand_over(bus, cycle as u16)?;
        self.state = State::Handed;
        Ok(())
    }

    /// Writes a record to the `index`th place.
    fn put(&self, bus: &mut impl Bus, index: usize, record: &WriteRecord) -> Result<(), BusError> {
        let first: HostOffset = self.place.start.plus_words(index * VARIABLE_WRITE_RECORD_WORDS);
        for (word, value) in
            record.words(self.bits, self.field, self.long.unwrap_or_default()).into_iter().enumerate()
        {
            bus.write16(first.plus_words(word), value)?;
        }
        Ok(())
    }

    /// Gives PMAC the first `count` records.
    fn hand_over(&self, bus: &mut impl Bus, count: u16) -> Result<(), BusError> {
        bus.write16(self.write.start, self.family.start.start_word(self.place.start))?;
        bus.order_writes();
        bus.write16(self.write.count, count)?;
        bus.order_writes();
        Ok(())
    }
}

#[cfg(test)]
#[path = "variable_write_tests.rs"]
mod tests;
