//! Background variable data, the host's half: up to 128 registers that the host chooses (DPRAM manual p. 21-24).
//!
//! | word | host | PMAC |
//! |---|---|---|
//! | 0x07E8 bit 8 | sets for multi-user mode, else clears | reads |
//! | 0x07E8 bit 0 | clears when it took a report (single-user mode) | sets after a pass; skips passes while set |
//! | 0x07EA | reads | writes the servo timer after a pass |
//! | 0x07EC | writes the number of entries, last; 0 stops the function | reads |
//! | 0x07EE | writes where the table lies, a PMAC address | reads |
//! | table, Y words | writes the registers' addresses | reads |
//! | table, X words | writes the kinds; clears bit 15 when it took a value (multi-user mode) | sets bit 15 |
//! | behind the table | reads | writes the values, 2 or 4 words an entry |
//!
//! The host changes a table in the order count 0, silence, start, table, control, count. PMAC may be in the middle of
//! a pass when the count becomes 0, and no word tells when that pass ends: the pass is over after the silence
//! ([`READ_PASS_SILENCE`]).
//!
//! The host reads a report of single-user mode in many polls, during which the board may be reset or lose its power.
//! So the host reads the servo timer before and after the report's words, and the control word once more after them:
//! unless both are unchanged, the host drops the report and writes nothing.
//!
//! Needs I55 = 1. PMAC copies each register at its own moment of the pass: the values of one report come from one
//! pass, but not from one servo cycle.

use std::time::{Duration, Instant};

use crate::device::{Bus, BusError};
use crate::map::buffer_layout::VARIABLE_READ_DATA_WORDS;
use crate::map::functions::{VARIABLE_READ_ENTRIES, VARIABLE_READ_ENTRY_READY, VARIABLE_READ_ENTRY_WORDS};
use crate::map::{HostOffset, Region, StartRule, VariableKind, VariableName, VariableRead};
pub use crate::protocol::VariableMode;

/// How long the host leaves the table alone after the count became 0: longer than a pass lasts.
pub const READ_PASS_SILENCE: Duration = Duration::from_millis(50);
/// The most words of the table or its data that one poll reads or writes, so that servo data need not wait.
pub const POLL_WORDS: usize = 32;

/// One register or function block to read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct VariableEntry {
    /// Its PMAC address; for a function block its number.
    pub address: u32,
    /// The kind of register.
    pub kind: VariableKind,
}

impl From<VariableName> for VariableEntry {
    fn from(name: VariableName) -> Self {
        Self { address: name.address(), kind: name.kind() }
    }
}

/// Why the reader refused a table. It has written nothing then.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum VariableReadError {
    /// Too many entries for the function.
    #[error("a PMAC reads 128 registers at most, not {0}")]
    TooMany(usize),
    /// Too many for the place the plan gives.
    #[error(
        "{entries} entries with their data take {needed} words, the plan keeps {place}; enlarge its variable_read_entries"
    )]
    NoRoom {
        /// How many the client asked for.
        entries: usize,
        /// The words that they take.
        needed: usize,
        /// The words that the plan keeps.
        place: usize,
    },
}

/// The result of a poll.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VariablePoll {
    /// No table is set up.
    Off,
    /// The reader is setting up a table; poll again.
    SettingUp,
    /// Nothing new.
    Nothing,
    /// The reader has read a part; poll again for the rest.
    Partial,
    /// Single-user mode: every value is new. The servo timer at the end of PMAC's pass.
    Report(u16),
    /// Multi-user mode: the entries whose bit is set have a new value.
    Values(u128),
}

/// The value of an entry as last read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct VariableValue {
    /// The words as the board held them, low word first; the last two are 0 unless the entry is 48 bits wide.
    pub words: [u16; VARIABLE_READ_DATA_WORDS],
    /// The low 16 bits of the servo counter: in single-user mode at the end of the pass that wrote the value, in
    /// multi-user mode at the end of that pass or of the one before or after.
    pub timer: u16,
    /// How many values the reader has taken since it set up the table; 0: none yet.
    pub updates: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ReaderState {
    Off,
    /// The count is 0; the host may change the table after this moment.
    Silent {
        until: Instant,
    },
    /// Entries before `next` are written.
    Writing {
        next: usize,
    },
    /// Single-user mode waits for the ready bit; multi-user mode looks at entry `next` next.
    Running {
        next: usize,
    },
    /// Single-user mode reads a report; entries before `next` are read.
    Reading {
        next: usize,
    },
}

/// The host's half of the function: one table at a time.
pub struct VariableReader {
    read: &'static VariableRead,
    start: StartRule,
    state: ReaderState,
    mode: VariableMode,
    place: Region,
    entries: [VariableEntry; VARIABLE_READ_ENTRIES],
    /// Where each entry's data begin, in words from the place's start.
    data: [u16; VARIABLE_READ_ENTRIES],
    values: [VariableValue; VARIABLE_READ_ENTRIES],
    /// Values of the report being read, before the reader has checked the whole report.
    pending: [[u16; VARIABLE_READ_DATA_WORDS]; VARIABLE_READ_ENTRIES],
    count: usize,
    /// The servo timer of the report being read, when its reading began.
    report_timer: u16,
    repairs: u64,
}

impl VariableReader {
    /// A reader that uses the words of `place` (a plan's), and has no table yet.
    #[must_use]
    pub fn new(read: &'static VariableRead, start: StartRule, place: Region) -> Self {
        Self {
            read,
            start,
            state: ReaderState::Off,
            mode: VariableMode::SingleUser,
            place,
            entries: [VariableEntry { address: 0, kind: VariableKind::Y }; VARIABLE_READ_ENTRIES],
            data: [0; VARIABLE_READ_ENTRIES],
            values: [VariableValue::default(); VARIABLE_READ_ENTRIES],
            pending: [[0; VARIABLE_READ_DATA_WORDS]; VARIABLE_READ_ENTRIES],
            count: 0,
            report_timer: 0,
            repairs: 0,
        }
    }

    /// Stops the function, whichever host started it. The caller calls this at the start and on every way out. 2
    /// writes.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn release(&self, bus: &mut impl Bus) -> Result<(), BusError> {
        bus.write16(self.read.count, 0)?;
        bus.order_writes();
        bus.write16(self.read.ready.word, 0)?;
        bus.order_writes();
        Ok(())
    }

    /// Replaces the table by `entries`; none stops the function. The old values are gone; polls bring new ones. 1
    /// write; the polls that follow write 2 words an entry and 3 more.
    ///
    /// # Errors
    /// A refused table, or a bus out of reach.
    pub fn begin(
        &mut self,
        bus: &mut impl Bus,
        entries: &[VariableEntry],
        mode: VariableMode,
        now: Instant,
    ) -> Result<(), VariableReadBusError> {
        self.check(entries)?;
        bus.write16(self.read.count, 0)?;
        bus.order_writes();
        let mut offset = entries.len() * VARIABLE_READ_ENTRY_WORDS;
        for (index, &entry) in entries.iter().enumerate() {
            self.entries[index] = entry;
            self.data[index] = offset as u16;
            offset += entry.kind.words();
        }
        self.values[..entries.len()].fill(VariableValue::default());
        self.count = entries.len();
        self.mode = mode;
        self.state = if entries.is_empty() {
            ReaderState::Off
        } else {
            ReaderState::Silent { until: now + READ_PASS_SILENCE }
        };
        Ok(())
    }

    /// Checks that `entries` fit the plan's place. Any table of as many entries must fit, whatever kinds they have: a
    /// pass that is under way during a change may still work by the kinds of the last table.
    ///
    /// # Errors
    /// Too many entries, or too little room.
    pub fn check(&self, entries: &[VariableEntry]) -> Result<(), VariableReadError> {
        if entries.len() > VARIABLE_READ_ENTRIES {
            return Err(VariableReadError::TooMany(entries.len()));
        }
        let needed = entries.len() * (VARIABLE_READ_ENTRY_WORDS + VARIABLE_READ_DATA_WORDS);
        if needed > self.place.words() {
            return Err(VariableReadError::NoRoom {
                entries: entries.len(),
                needed,
                place: self.place.words(),
            });
        }
        Ok(())
    }

    /// The table.
    #[must_use]
    pub fn entries(&self) -> &[VariableEntry] {
        &self.entries[..self.count]
    }

    /// The values, one an entry.
    #[must_use]
    pub fn values(&self) -> &[VariableValue] {
        &self.values[..self.count]
    }

    /// Whether a table is set up and PMAC may announce values.
    #[must_use]
    pub fn is_running(&self) -> bool {
        matches!(self.state, ReaderState::Running { .. } | ReaderState::Reading { .. })
    }

    /// How often the reader found a word of the table or the mode changed, and set it again.
    #[must_use]
    pub fn repairs(&self) -> u64 {
        self.repairs
    }

    /// Does the work that is possible now: a part of the set-up, or of a report. Costs at most [`POLL_WORDS`] words of
    /// the table or its data and 3 more: In single-user mode 1 read without a report, for a report its words and 5. In
    /// multi-user mode 1 read, 1 an entry looked at, for each value its words and 1 write, and 1 read more if a value
    /// came.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn poll(&mut self, bus: &mut impl Bus, now: Instant) -> Result<VariablePoll, BusError> {
        match self.state {
            ReaderState::Off => Ok(VariablePoll::Off),
            ReaderState::Silent { until } => {
                if now >= until {
                    bus.write16(self.read.start, self.start.start_word(self.place.start))?;
                    self.state = ReaderState::Writing { next: 0 };
                }
                Ok(VariablePoll::SettingUp)
            }
            ReaderState::Writing { next } => self.write_table(bus, next),
            ReaderState::Running { next } => self.poll_control(bus, next),
            ReaderState::Reading { next } => self.read_report(bus, next),
        }
    }

    /// The control word that asks for the next report.
    const fn control(&self) -> u16 {
        match self.mode {
            VariableMode::SingleUser => 0,
            VariableMode::MultiUser => self.read.multi_user.mask,
        }
    }

    /// An entry as the table holds it: the Y word, and the host's part of the X word.
    const fn words(&self, index: usize) -> [u16; 2] {
        let VariableEntry { address, kind } = self.entries[index];
        [address as u16, self.read.kind_word(kind)]
    }

    fn write_table(&mut self, bus: &mut impl Bus, next: usize) -> Result<VariablePoll, BusError> {
        let end = self.count.min(next + POLL_WORDS / VARIABLE_READ_ENTRY_WORDS);
        for index in next..end {
            let [address, kind] = self.words(index);
            bus.write16(self.address_word(index), address)?;
            bus.write16(self.kind_word(index), kind)?;
        }
        if end < self.count {
            self.state = ReaderState::Writing { next: end };
            return Ok(VariablePoll::SettingUp);
        }
        self.write_control(bus, self.control())?;
        bus.write16(self.read.count, self.count as u16)?;
        bus.order_writes();
        self.state = ReaderState::Running { next: 0 };
        Ok(VariablePoll::SettingUp)
    }

    fn poll_control(&mut self, bus: &mut impl Bus, next: usize) -> Result<VariablePoll, BusError> {
        let control = bus.read16(self.read.ready.word)?;
        // All ones is an absent board.
        if control == u16::MAX {
            return Ok(VariablePoll::Nothing);
        }
        let multi_user = self.mode == VariableMode::MultiUser;
        // In multi-user mode PMAC does not write this word.
        let VariableRead { ready, multi_user: many, .. } = self.read;
        let ours = many.mask | if multi_user { ready.mask } else { 0 };
        if control & ours != self.control() {
            self.repairs += 1;
            self.write_control(bus, self.control())?;
            return Ok(VariablePoll::Nothing);
        }
        if multi_user {
            return self.poll_entries(bus, next);
        }
        if !ready.is_set(control) {
            return Ok(VariablePoll::Nothing);
        }
        bus.order_reads();
        self.report_timer = bus.read16(self.read.timer)?;
        self.state = ReaderState::Reading { next: 0 };
        Ok(VariablePoll::Partial)
    }

    fn write_control(&self, bus: &mut impl Bus, control: u16) -> Result<(), BusError> {
        bus.write16(self.read.ready.word, control)?;
        bus.order_writes();
        Ok(())
    }

    /// Single-user mode: the next entries of a report, and after the last one the request for the next report.
    fn read_report(&mut self, bus: &mut impl Bus, next: usize) -> Result<VariablePoll, BusError> {
        let mut index = next;
        let mut words = 0;
        while index < self.count && words + self.entries[index].kind.words() <= POLL_WORDS {
            words += self.entries[index].kind.words();
            self.pending[index] = self.read_value(bus, index)?;
            index += 1;
        }
        if index < self.count {
            self.state = ReaderState::Reading { next: index };
            return Ok(VariablePoll::Partial);
        }
        bus.order_reads();
        let control = bus.read16(self.read.ready.word)?;
        // Read the timer only now: a pass that ends in between has written the timer before the ready bit
        // (`tests/models/variable_read.pml`).
        bus.order_reads();
        let timer = bus.read16(self.read.timer)?;
        self.state = ReaderState::Running { next: 0 };
        // PMAC changes neither until the host clears the ready bit. A board that was reset meanwhile has changed them,
        // and may have made another report already; the next polls take that one.
        let is_ready = self.read.ready.is_set(control) && !self.read.multi_user.is_set(control);
        if timer != self.report_timer || !is_ready || control == u16::MAX {
            return Ok(VariablePoll::Nothing);
        }
        self.write_control(bus, self.control())?;
        for (value, words) in self.values[..self.count].iter_mut().zip(&self.pending) {
            *value = VariableValue { words: *words, timer, updates: value.updates + 1 };
        }
        Ok(VariablePoll::Report(timer))
    }

    /// Multi-user mode: goes on around the table from entry `next`, at most once around.
    fn poll_entries(&mut self, bus: &mut impl Bus, next: usize) -> Result<VariablePoll, BusError> {
        let mut new = 0u128;
        let mut budget = POLL_WORDS;
        let mut index = next;
        for _ in 0..self.count {
            let needed = 2 + self.entries[index].kind.words();
            if budget < needed {
                break;
            }
            budget -= 1;
            let word = bus.read16(self.kind_word(index))?;
            if word & VARIABLE_READ_ENTRY_READY != 0 {
                budget -= needed - 1;
                if self.take_entry(bus, index, word)? {
                    new |= 1 << index;
                }
            }
            index = (index + 1) % self.count;
        }
        self.state = ReaderState::Running { next: index };
        if new == 0 {
            return Ok(VariablePoll::Nothing);
        }
        let timer = bus.read16(self.read.timer)?;
        for (index, value) in self.values[..self.count].iter_mut().enumerate() {
            if new & 1 << index != 0 {
                value.timer = timer;
            }
        }
        Ok(VariablePoll::Values(new))
    }

    /// Takes the value that PMAC announced with the X word `word`, unless that word's kind was changed, and asks for
    /// the next.
    fn take_entry(&mut self, bus: &mut impl Bus, index: usize, word: u16) -> Result<bool, BusError> {
        let [_, kind] = self.words(index);
        let as_set = self.read.of_host(word) == kind;
        if as_set {
            bus.order_reads();
            let words = self.read_value(bus, index)?;
            bus.order_reads();
            self.values[index].words = words;
            self.values[index].updates += 1;
        } else {
            self.repairs += 1;
        }
        bus.write16(self.kind_word(index), kind)?;
        bus.order_writes();
        Ok(as_set)
    }

    fn read_value(
        &self,
        bus: &mut impl Bus,
        index: usize,
    ) -> Result<[u16; VARIABLE_READ_DATA_WORDS], BusError> {
        let mut words = [0; VARIABLE_READ_DATA_WORDS];
        let first = self.place.start.plus_words(self.data[index].into());
        bus.read_data(first, &mut words[..self.entries[index].kind.words()])?;
        Ok(words)
    }

    const fn address_word(&self, index: usize) -> HostOffset {
        self.place.start.plus_words(index * VARIABLE_READ_ENTRY_WORDS)
    }

    const fn kind_word(&self, index: usize) -> HostOffset {
        self.place.start.plus_words(index * VARIABLE_READ_ENTRY_WORDS + 1)
    }
}

/// A refused table, or a bus out of reach.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum VariableReadBusError {
    /// Refused; nothing has been written.
    #[error(transparent)]
    Refused(#[from] VariableReadError),
    /// The bus.
    #[error(transparent)]
    Bus(#[from] BusError),
}

#[cfg(test)]
#[path = "variable_read_tests.rs"]
mod tests;
