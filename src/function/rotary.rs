//! The binary rotary program buffers: motion program lines that PMAC copies, without reading text, into its own rotary
//! program buffer (DPRAM manual p. 30-31; the second buffer's header, at 0x07DC, is not in the manual).
//! [`crate::map::RotaryHeaders`] says where the headers lie, [`rotary_header`] what a header holds.
//!
//! A buffer is a ring of 32-bit longs in the user area of the DPRAM: two longs a command, the low 24 bits of each
//! used. The host writes at its index, PMAC reads from its own index up to the host's; equal indexes mean an empty
//! ring. At the host's index stands an end marker, which the next command overwrites. The buffer counts as full when
//! PMAC's index is four longs ahead of the host's, so a line and the marker behind it never reach commands that PMAC
//! has not read. A line must be complete in the buffer before the host's index moves.
//!
//! The host owns the ring, its index, and, while the transfer is disabled, the header; PMAC owns the status word and
//! its index. On PMAC I57 enables the transfer. On Turbo boards each coordinate system has a buffer of its own. The
//! manuals name no such I-variable for them, but a command that opens binary entry (Turbo Software Reference p. 290).
//! A header whose size is 0 is not in use, so the host writes the size last. PMAC's internal buffer holds further
//! lines, so the motors need not wait yet when the ring is empty.

use crate::device::{Bus, BusError};
use crate::map::functions::rotary_header;
use crate::map::{Family, HostOffset};
use crate::rotary::{END_MARKER, START_OF_LINE};

/// Longs before PMAC's index that the host never fills (manual p. 30, rule 3); the end marker takes two of them.
const KEPT_FREE: u32 = 4;
/// The smallest buffer in longs: one command a line.
pub const LEAST_LONGS: u32 = 2 + KEPT_FREE;

/// Where a buffer lies and which coordinate system it feeds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RotarySetup {
    /// The ring's first location (its Y half), in the user area.
    pub start: HostOffset,
    /// The ring's length in longs: even, at least [`LEAST_LONGS`], and inside the user area.
    pub size_longs: u32,
    /// The coordinate system, from 1, that has the rotary program buffer.
    pub coordinate_system: u8,
    /// The number that the header holds for coordinate system 1: 1 or 0. No manual says which; see
    /// [`crate::rotary::Settings::coordinate_system_base`].
    pub coordinate_system_base: u8,
}

/// Why the host cannot set up a rotary buffer, or put a line into it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RotaryError {
    /// The bus cannot be reached.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// The size is not one a rotary buffer can have.
    #[error(
        "a rotary buffer of {size} longs is not possible; take an even number from {LEAST_LONGS} to {most}"
    )]
    Size {
        /// The requested size.
        size: u32,
        /// The longs of the user area.
        most: u32,
    },
    /// The buffer would not lie in the user area of the DPRAM.
    #[error(
        "a rotary buffer of {size} longs at {start} does not lie in the user area, from {first} up to {end}"
    )]
    Place {
        /// Its start.
        start: HostOffset,
        /// Its length in longs.
        size: u32,
        /// The user area's first word.
        first: HostOffset,
        /// The first word behind the user area.
        end: HostOffset,
    },
    /// No such coordinate system, or no such base.
    #[error(
        "coordinate system {number} counted from {base} is not possible; 1 to {systems}, counted from 0 or 1"
    )]
    CoordinateSystem {
        /// The coordinate system.
        number: u8,
        /// How many the board has.
        systems: usize,
        /// The number of the first one.
        base: u8,
    },
    /// The host has set up no buffer, or the board has forgotten it since.
    #[error("the rotary buffer has not been set up")]
    NotSetUp,
    /// The line has no command.
    #[error("a line without commands cannot be sent; leave it out")]
    Empty,
    /// The line can never fit.
    #[error("a line of {commands} commands does not fit a rotary buffer of {size} longs, which takes {most}")]
    TooLong {
        /// How many commands the line has.
        commands: usize,
        /// The buffer's length in longs.
        size: u32,
        /// The most commands of a line.
        most: u32,
    },
    /// The words do not form one line.
    #[error(
        "command {number} of the line is ${word1:06X}, ${word2:06X}; words have 24 bits, and bit 11 of the first \
         word is set in a line's first command and in no other"
    )]
    NotALine {
        /// Which command, from 1.
        number: usize,
        /// Its first word.
        word1: u32,
        /// Its second word.
        word2: u32,
    },
    /// The header does not hold the values it must: another host wrote it, or the board lost it.
    #[error(
        "the rotary header at {header} has host index {host} (this host left {expected}) and PMAC index {pmac}, which \
         cannot come about by reading; set the buffer up again"
    )]
    Header {
        /// The header's offset.
        header: HostOffset,
        /// The host index found.
        host: u16,
        /// The host index this host wrote last.
        expected: u32,
        /// The PMAC index found.
        pmac: u16,
    },
}

/// How far PMAC has read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct RotaryState {
    /// Longs in the ring that PMAC has not taken.
    pub ahead_longs: u32,
    /// Commands in the ring that PMAC has not taken.
    pub ahead_commands: u32,
    /// Lines in the ring that PMAC has not taken wholly.
    pub ahead_lines: u64,
    /// PMAC's index stands inside a line: PMAC has taken a part of the first of these lines.
    pub is_inside_line: bool,
    /// Lines put into the ring so far.
    pub sent_lines: u64,
    /// PMAC's internal rotary buffer is full: PMAC takes no command until motion goes on.
    pub busy: bool,
    /// The code of an error that PMAC has reported. No manual tells what the codes mean.
    pub error: Option<u8>,
    /// How often the host found the ring empty though the stream was not finished. The host finds a ring that ran
    /// empty at the next line at the latest, so it misses none. The count starts over when PMAC's internal buffer is
    /// full for the first time: until then PMAC takes every line at once, and an empty ring does not show that the
    /// motors wait.
    pub underruns: u64,
}

/// Feeds one binary rotary buffer, line by line.
#[derive(Debug)]
pub struct RotaryStream {
    family: &'static Family,
    header: HostOffset,
    start: HostOffset,
    /// The ring's length in longs; 0 until the host has set up the buffer.
    size: u32,
    /// The host's index, as the board has it.
    host: u32,
    /// Longs that PMAC had not taken at the last look.
    ahead: u32,
    sent_longs: u64,
    sent_lines: u64,
    /// A bit for each command's place in the ring: whether a line ends there.
    line_ends: Box<[u64]>,
    /// Lines that PMAC has not taken wholly.
    ahead_lines: u64,
    underruns: u64,
    /// PMAC's internal buffer has been full.
    filled: bool,
    /// The host has already counted the ring as empty since the last line.
    dry: bool,
    finished: bool,
    /// The header is marked as not in use since the set-up.
    closed: bool,
}

impl RotaryStream {
    /// A stream for each of the family's buffers, in the order of their headers. None is set up yet. Each stream
    /// allocates its memory here, and none later.
    #[must_use]
    pub fn of_family(family: &'static Family) -> Vec<Self> {
        let places = family.user_area.words() / 4;
        let stream = |&header: &HostOffset| Self {
            family,
            header,
            start: family.user_area.start,
            size: 0,
            host: 0,
            ahead: 0,
            sent_longs: 0,
            sent_lines: 0,
            line_ends: vec![0; places.div_ceil(64)].into(),
            ahead_lines: 0,
            underruns: 0,
            filled: false,
            dry: false,
            finished: false,
            closed: false,
        };
        family.rotary.headers.iter().map(stream).collect()
    }

    /// Sets the buffer up, empty. If an I-variable enables the transfer, it must be 0 until this has returned.
    ///
    /// Costs 1 read and 9 writes; one write more to clear a status word that is not 0 (power-on leaves any value in
    /// it), one more where no I-variable enables the transfer.
    ///
    /// # Errors
    /// [`RotaryError::Size`], [`RotaryError::Place`], [`RotaryError::CoordinateSystem`] before anything is written;
    /// [`RotaryError::Bus`].
    pub fn set_up(&mut self, bus: &mut impl Bus, setup: &RotarySetup) -> Result<(), RotaryError> {
        let RotarySetup { start, size_longs: size, coordinate_system, coordinate_system_base: base } = *setup;
        let (area, systems) = (self.family.user_area, self.family.coordinate_systems);
        let most = area.words() as u32 / 2;
        if !(LEAST_LONGS..=most).contains(&size) || !size.is_multiple_of(2) {
            return Err(RotaryError::Size { size, most });
        }
        let fits = start >= area.start
            && start.bytes().is_multiple_of(4)
            && start.bytes() / 4 + size <= area.end.bytes() / 4;
        if !fits {
            return Err(RotaryError::Place { start, size, first: area.start, end: area.end });
        }
        if !(1..=systems).contains(&coordinate_system.into()) || base > 1 {
            return Err(RotaryError::CoordinateSystem { number: coordinate_system, systems, base });
        }
        // If the board goes away meanwhile, the buffer counts as not set up.
        self.reset();
        if self.family.i.rotary_enable.is_none() {
            // No I-variable keeps PMAC out, so a header that is not in use must.
            self.clear_unused(bus)?;
        }
        let header = self.header;
        put(bus, start, END_MARKER)?;
        let word = u16::from(coordinate_system) + u16::from(base) - 1;
        bus.write16(header.plus_words(rotary_header::COORDINATE_SYSTEM), word)?;
        bus.write16(header.plus_words(rotary_header::START), self.family.start.start_word(start))?;
        let status = header.plus_words(rotary_header::STATUS);
        if bus.read16(status)? != 0 {
            bus.write16(status, 0)?;
        }
        bus.order_writes();
        bus.write16(header.plus_words(rotary_header::PMAC_INDEX), 0)?;
        bus.write16(header.plus_words(rotary_header::HOST_INDEX), 0)?;
        bus.order_writes();
        bus.write16(header.plus_words(rotary_header::SIZE), size as u16)?;
        bus.order_writes();
        (self.start, self.size) = (start, size);
        Ok(())
    }

    /// Marks a buffer that is not set up as not in use, by size 0, whatever power-on left in its header. Call this
    /// before enabling a transfer: enabling applies to all buffers.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn clear_unused(&self, bus: &mut impl Bus) -> Result<(), BusError> {
        if !self.is_set_up() {
            bus.write16(self.header.plus_words(rotary_header::SIZE), 0)?;
            bus.order_writes();
        }
        Ok(())
    }

    /// Marks the buffer as not in use: PMAC takes no more lines out of it, even while the transfer is enabled for other
    /// buffers. [`Self::state`] still tells how far PMAC has read.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn close(&mut self, bus: &mut impl Bus) -> Result<(), BusError> {
        self.closed = true;
        bus.write16(self.header.plus_words(rotary_header::SIZE), 0)?;
        bus.order_writes();
        Ok(())
    }

    /// Whether the ring of `setup` would share a word with this buffer's, of which PMAC may still take lines.
    #[must_use]
    pub fn is_in_way_of(&self, setup: &RotarySetup) -> bool {
        let is_over = self.closed || self.finished && self.ahead == 0;
        let end = |start: HostOffset, longs: u32| start.bytes() + 4 * longs;
        !is_over
            && self.start.bytes() < end(setup.start, setup.size_longs)
            && setup.start.bytes() < end(self.start, self.size)
    }

    /// The board has forgotten the buffer, for instance by a reset: the host must set it up again.
    pub fn reset(&mut self) {
        self.line_ends.fill(0);
        *self = Self {
            size: 0,
            host: 0,
            ahead: 0,
            sent_longs: 0,
            sent_lines: 0,
            line_ends: std::mem::take(&mut self.line_ends),
            ahead_lines: 0,
            underruns: 0,
            filled: false,
            dry: false,
            finished: false,
            closed: false,
            ..*self
        };
    }

    /// Whether the host has set up the buffer, and the board has not forgotten it since.
    #[must_use]
    pub const fn is_set_up(&self) -> bool {
        self.size != 0
    }

    /// The ring's length in longs.
    #[must_use]
    pub const fn size_longs(&self) -> u32 {
        self.size
    }

    /// Lines put into the ring since it was set up.
    #[must_use]
    pub const fn sent_lines(&self) -> u64 {
        self.sent_lines
    }

    /// The most commands that one line may have.
    #[must_use]
    pub const fn most_commands_a_line(&self) -> u32 {
        (self.size - KEPT_FREE) / 2
    }

    /// No line will follow: from now on an empty ring is no underrun. A line offered all the same makes the stream go
    /// on.
    pub fn finish(&mut self) {
        self.finished = true;
    }

    /// Puts `line`, the words of its commands in order, into the ring. `Ok(false)`: the ring has no room for the whole
    /// line yet, and the host wrote nothing.
    ///
    /// The words and the new end marker are in place before the host's index moves. The host overwrites the old end
    /// marker last: that marker begins a line, as the first command does.
    ///
    /// Costs 2 reads, and 4 writes a command with 5 more when there is room; 1 read more when there is none, until
    /// PMAC's internal buffer has been full.
    ///
    /// # Errors
    /// [`RotaryError::NotSetUp`], [`RotaryError::Empty`], [`RotaryError::TooLong`], [`RotaryError::NotALine`] without
    /// an access; [`RotaryError::Header`]; [`RotaryError::Bus`].
    pub fn offer(&mut self, bus: &mut impl Bus, line: &[(u32, u32)]) -> Result<bool, RotaryError> {
        let longs = self.check(line)?;
        self.read_indexes(bus)?;
        if self.ahead + longs > self.size - KEPT_FREE {
            if !self.filled {
                self.status(bus)?;
            }
            return Ok(false);
        }
        let Some((first, others)) = line.split_first() else { return Err(RotaryError::Empty) };
        let next = (self.host + longs) % self.size;
        put(bus, self.place(next), END_MARKER)?;
        for (number, command) in (1..).zip(others) {
            put(bus, self.place((self.host + 2 * number) % self.size), *command)?;
        }
        bus.order_writes();
        put(bus, self.place(self.host), *first)?;
        bus.order_writes();
        bus.write16(self.header.plus_words(rotary_header::HOST_INDEX), next as u16)?;
        bus.order_writes();
        for number in 0..longs / 2 {
            self.set_line_end((self.host + 2 * number) % self.size, 2 * number + 2 == longs);
        }
        self.host = next;
        self.ahead += longs;
        self.sent_longs += u64::from(longs);
        self.sent_lines += 1;
        self.ahead_lines += 1;
        self.dry = false;
        self.finished = false;
        Ok(true)
    }

    /// Tells how far PMAC has read. Costs 3 reads.
    ///
    /// # Errors
    /// [`RotaryError::NotSetUp`]; [`RotaryError::Header`]; [`RotaryError::Bus`].
    pub fn state(&mut self, bus: &mut impl Bus) -> Result<RotaryState, RotaryError> {
        self.check_set_up()?;
        self.read_indexes(bus)?;
        let status = self.status(bus)?;
        Ok(RotaryState {
            ahead_longs: self.ahead,
            ahead_commands: self.ahead / 2,
            ahead_lines: self.ahead_lines,
            is_inside_line: self.is_inside_line(),
            sent_lines: self.sent_lines,
            busy: status & rotary_header::BUSY != 0,
            error: (status & rotary_header::ERROR != 0).then_some(status as u8),
            underruns: self.underruns,
        })
    }

    fn status(&mut self, bus: &mut impl Bus) -> Result<u16, BusError> {
        let status = bus.read16(self.header.plus_words(rotary_header::STATUS))?;
        if status & rotary_header::BUSY != 0 && !self.filled {
            self.filled = true;
            self.underruns = 0;
        }
        Ok(status)
    }

    /// Reads both indexes and learns what PMAC has taken.
    fn read_indexes(&mut self, bus: &mut impl Bus) -> Result<(), RotaryError> {
        let mut words = [0; 2];
        bus.read_block(self.header.plus_words(rotary_header::HOST_INDEX), &mut words)?;
        let [host, pmac] = words;
        let error = RotaryError::Header { header: self.header, host, expected: self.host, pmac };
        // At the ring's end PMAC's index may equal the size: rule 3 (p. 30) takes the remainder of the host's index
        // alone.
        if u32::from(host) != self.host || u32::from(pmac) > self.size || !pmac.is_multiple_of(2) {
            return Err(error);
        }
        // PMAC's index only ever moves towards the host's.
        let ahead = (self.host + self.size - u32::from(pmac)) % self.size;
        if ahead > self.ahead {
            return Err(error);
        }
        for taken in (ahead + 2..=self.ahead).step_by(2) {
            self.ahead_lines -= u64::from(self.is_line_end((self.host + self.size - taken) % self.size));
        }
        self.ahead = ahead;
        if ahead == 0 && self.sent_longs > 0 && !self.finished && !self.dry {
            self.dry = true;
            self.underruns += 1;
        }
        Ok(())
    }

    /// Whether the last command that PMAC has taken is not the end of its line.
    fn is_inside_line(&self) -> bool {
        let has_taken = u64::from(self.ahead) < self.sent_longs;
        let last = (self.host + 2 * self.size - self.ahead - 2) % self.size;
        self.ahead > 0 && has_taken && !self.is_line_end(last)
    }

    /// Whether the command at `index`, in longs from the ring's start, is the last of its line.
    fn is_line_end(&self, index: u32) -> bool {
        let place = index as usize / 2;
        self.line_ends[place / 64] >> (place % 64) & 1 != 0
    }

    fn set_line_end(&mut self, index: u32, ends: bool) {
        let place = index as usize / 2;
        let bit = 1 << (place % 64);
        let word = &mut self.line_ends[place / 64];
        *word = if ends { *word | bit } else { *word & !bit };
    }

    /// The line's length in longs, if the host can send the line.
    fn check(&self, line: &[(u32, u32)]) -> Result<u32, RotaryError> {
        self.check_set_up()?;
        if line.is_empty() {
            return Err(RotaryError::Empty);
        }
        if line.len() > self.most_commands_a_line() as usize {
            let most = self.most_commands_a_line();
            return Err(RotaryError::TooLong { commands: line.len(), size: self.size, most });
        }
        for (number, &(word1, word2)) in (1..).zip(line) {
            let starts = word1 & START_OF_LINE != 0;
            if (word1 | word2) >> 24 != 0 || starts != (number == 1) {
                return Err(RotaryError::NotALine { number, word1, word2 });
            }
        }
        Ok(2 * line.len() as u32)
    }

    const fn check_set_up(&self) -> Result<(), RotaryError> {
        if self.is_set_up() { Ok(()) } else { Err(RotaryError::NotSetUp) }
    }

    /// Where the long at `index` of the ring lies.
    const fn place(&self, index: u32) -> HostOffset {
        self.start.plus_words(2 * index as usize)
    }
}

/// Writes a command's two longs, zero-extended. A ring's size is even, so its end never parts the two longs.
fn put(bus: &mut impl Bus, at: HostOffset, (word1, word2): (u32, u32)) -> Result<(), BusError> {
    bus.write16(at, word1 as u16)?;
    bus.write16(at.plus_words(1), (word1 >> 16) as u16)?;
    bus.write16(at.plus_words(2), word2 as u16)?;
    bus.write16(at.plus_words(3), (word2 >> 16) as u16)
}
