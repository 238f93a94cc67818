//! `DEFINE GATHER`, `GATHER`, `ENDGATHER`: the gathering and the servo report under way, and the storage of gathered
//! data.
//!
//! With I48=1 the first `GATHER` starts the servo report and the second the gathering; `ENDGATHER` stops whichever
//! started last (DPRAM manual p. 14). `GATHER TRIGGER` waits until machine input 2 goes from 0 to 1. (No manual seen
//! names the input.)
//!
//! I20 selects from the sources I21-I44. I19 is the period. I45 chooses the memory: 2 the DPRAM up to the buffer's end,
//! 3 the DPRAM round and round, 0 and 1 the same in PMAC's own memory. The firmware decides on the place of the buffer
//! and the two words before it ([`crate::map::Layout`]). The numbers are PMAC's; the code takes the family's.

use std::ops::Range;

use crate::format::int24;
use crate::map::{Family, GatherPlace, Generation, HostOffset, IVariables, Layout, ReportStart};
use crate::sim::board::error::CommandError;
use crate::sim::board::identity::Identity;
use crate::sim::board::memory::Memory;
use crate::sim::board::variables::Variables;

/// The values of the sources: two places a source, Y before X, with room for the sources of any family.
pub type GatherSources = [Option<u32>; 2 * MOST_SOURCES];

/// The most sources that any family can gather.
const MOST_SOURCES: usize = 48;
/// Sources in one mask.
const SOURCES_A_MASK: usize = 24;
/// The bit of the machine inputs that `GATHER TRIGGER` waits for.
const TRIGGER_INPUT: u32 = 1;

/// An activity that `GATHER` starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Activity {
    /// The servo report.
    ServoReport,
    /// Data gathering that waits for its trigger.
    Armed,
    /// Data gathering.
    Gathering,
}

/// The state of both.
#[derive(Debug, Clone)]
pub struct Gather {
    /// The activities under way, in the order of their start.
    running: Vec<Activity>,
    /// Size of the defined buffer in long words.
    size: Option<u32>,
    index: u32,
    wait: u32,
    /// The trigger input in the last cycle.
    input: bool,
    /// Where the buffer and its words are in the DPRAM.
    place: GatherPlace,
    family: &'static Family,
    /// Gathered words in PMAC's own memory.
    memory: Vec<u32>,
}

impl Gather {
    /// Nothing defined. The firmware decides where the buffer lies.
    #[must_use]
    pub fn new(identity: &Identity) -> Self {
        let family = identity.tables.family;
        let place = Layout::new(family, identity.firmware.parse().ok()).gather();
        Self {
            running: Vec::new(),
            size: None,
            index: 0,
            wait: 0,
            input: false,
            place,
            family,
            memory: Vec::new(),
        }
    }

    /// Whether `activity` has been started.
    #[must_use]
    pub fn runs(&self, activity: Activity) -> bool {
        self.running.contains(&activity)
    }

    /// Long words the buffer takes from PMAC's own memory.
    #[must_use]
    pub fn memory_used(&self, variables: &Variables) -> u32 {
        if self.in_dpram(variables) { 0 } else { self.size.unwrap_or(0) }
    }

    /// The bytes of a buffer in the DPRAM; `None` for a buffer elsewhere.
    #[must_use]
    pub fn span(&self, variables: &Variables) -> Option<Range<u32>> {
        let first = self.place.buffer.bytes();
        self.size.filter(|_| self.in_dpram(variables)).map(|size| first..first + 4 * size)
    }

    /// The words gathered so far into PMAC's own memory, in order.
    #[must_use]
    pub fn stored(&self) -> &[u32] {
        &self.memory
    }

    fn gathers(&self) -> bool {
        self.runs(Activity::Gathering) || self.runs(Activity::Armed)
    }

    /// `GATHER`, or `GATHER TRIGGER`.
    ///
    /// # Errors
    /// ERR003 when gathering would start without a buffer or with a full one.
    pub fn start(&mut self, triggered: bool, variables: &Variables) -> Result<(), CommandError> {
        let by_gather = self.family.servo.start == ReportStart::Gather;
        let enabled = variables.i(self.family.i.servo_enable.into()) == 1.0;
        if by_gather && enabled && !self.runs(Activity::ServoReport) {
            self.running.push(Activity::ServoReport);
            return Ok(());
        }
        if self.gathers() {
            return Ok(());
        }
        match self.size {
            Some(size) if self.index < size => {
                self.wait = 0;
                self.input = true;
                self.running.push(if triggered { Activity::Armed } else { Activity::Gathering });
                Ok(())
            }
            _ => Err(CommandError::SYNTAX),
        }
    }

    /// `ENDGATHER`: stops the activity that started last. With nothing under way it is no error.
    pub fn stop(&mut self) {
        self.running.pop();
    }

    /// `DEFINE GATHER [longs]`.
    ///
    /// # Errors
    /// ERR003 while gathering, or for a size that is zero or does not fit.
    pub fn define(
        &mut self,
        longs: Option<u32>,
        variables: &Variables,
        memory: &mut Memory,
        free: i64,
    ) -> Result<(), CommandError> {
        if self.gathers() {
            return Err(CommandError::SYNTAX);
        }
        let room = if self.in_dpram(variables) {
            (self.family.length - self.place.buffer.bytes()) / 4
        } else {
            free.clamp(0, i64::from(u32::MAX)) as u32
        };
        let size = longs.unwrap_or(room);
        if size == 0 || size > room {
            return Err(CommandError::SYNTAX);
        }
        self.size = Some(size);
        self.index = 0;
        self.memory.clear();
        self.note(variables, memory);
        Ok(())
    }

    /// `DELETE GATHER`.
    ///
    /// # Errors
    /// ERR003 while gathering.
    pub fn delete(&mut self, variables: &Variables, memory: &mut Memory) -> Result<(), CommandError> {
        if self.gathers() {
            return Err(CommandError::SYNTAX);
        }
        self.size = None;
        self.index = 0;
        self.memory.clear();
        self.note(variables, memory);
        Ok(())
    }

    /// One servo cycle: stores a sample when one is due.
    pub fn cycle(&mut self, variables: &Variables, memory: &mut Memory) {
        if self.runs(Activity::Armed) {
            let input = memory.read(memory.registers().machine_inputs) >> TRIGGER_INPUT & 1 == 1;
            if input && !std::mem::replace(&mut self.input, input) {
                let armed = self.running.iter_mut().filter(|activity| **activity == Activity::Armed);
                armed.for_each(|activity| *activity = Activity::Gathering);
            }
            self.input = input;
        }
        if !self.runs(Activity::Gathering) {
            return;
        }
        if self.wait > 0 {
            self.wait -= 1;
            return;
        }
        let period = variables.i(self.family.i.gather_period.into()) as u32;
        self.wait = period.saturating_sub(1);
        self.store(variables, memory);
        if period == 0 {
            // I19=0: once per command.
            self.running.retain(|&activity| activity != Activity::Gathering);
        }
    }

    fn store(&mut self, variables: &Variables, memory: &mut Memory) {
        let Some(size) = self.size else { return };
        let start = self.index;
        for word in sources(&self.family.i, variables, memory).into_iter().flatten() {
            self.put(word, variables, memory);
        }
        if self.family.generation == Generation::Turbo && !self.in_dpram(variables) {
            // A long word of Turbo's own memory has 48 bits, and each sample begins at a long word: a tool in use
            // (dls-pmac-control) asks for that many long words, and would otherwise get half of its samples.
            self.index = start + (self.index - start).div_ceil(2);
        }
        // The size is rounded up to whole samples: only here, after a sample, is the end looked for.
        if self.index >= size {
            if variables.i(self.family.i.gather_mode.into()) as u32 % 2 == 1 {
                self.index = 0;
                self.memory.clear();
            } else {
                self.running.retain(|&activity| activity != Activity::Gathering);
            }
        }
        self.note(variables, memory);
    }

    fn put(&mut self, word: u32, variables: &Variables, memory: &mut Memory) {
        if self.in_dpram(variables) {
            let offset = self.place.buffer.bytes() + 4 * self.index;
            // The last sample of a buffer that fills the DPRAM has nowhere to go beyond its end.
            if offset + 4 <= self.family.length {
                memory.dpram.write32(HostOffset::new(offset), int24::extend(word));
            }
        } else {
            self.memory.push(word);
        }
        self.index += 1;
    }

    /// Writes size and index to the host's words, after the data that they count.
    fn note(&self, variables: &Variables, memory: &mut Memory) {
        if self.in_dpram(variables) {
            memory.dpram.order_writes();
            memory.dpram.write16(self.place.size, self.size.unwrap_or(0) as u16);
            memory.dpram.write16(self.place.index, self.index as u16);
        }
    }

    fn in_dpram(&self, variables: &Variables) -> bool {
        variables.i(self.family.i.gather_mode.into()) >= 2.0
    }
}

/// The present values of the sources that the masks select.
pub fn sources(i: &IVariables, variables: &Variables, memory: &Memory) -> GatherSources {
    let mut words = [None; 2 * MOST_SOURCES];
    for (number, places) in words.chunks_exact_mut(2).enumerate() {
        let Some(&mask) = i.gather_masks.get(number / SOURCES_A_MASK) else { break };
        if variables.i(mask.into()) as u32 >> (number % SOURCES_A_MASK) & 1 == 0 {
            continue;
        }
        let code = variables.i(usize::from(i.gather_sources) + number) as u32;
        // The memory takes no more bits of it than an address has.
        let halves = match code >> 22 & 3 {
            0 => [Some(memory.read_y(code)), None],
            1 => [Some(memory.read_x(code)), None],
            _ => [Some(memory.read_y(code)), Some(memory.read_x(code))],
        };
        places.copy_from_slice(&halves);
    }
    words
}
