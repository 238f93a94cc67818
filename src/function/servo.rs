//! The servo report: motor data that PMAC copies into the DPRAM every so many servo cycles (DPRAM manual p. 14-17,
//! Turbo User Manual p. 402-403). [`ServoBlock`] says where the report lies.
//!
//! | PMAC and PMAC2 | Turbo | host | PMAC |
//! |---|---|---|---|
//! | Y:$D009 bit 0 | 0x006A bit 15 | sets Host-Busy while it reads | skips its update while it is set |
//! | X:$D009 bit 15 | 0x006E bit 15 | reads | busy: set while it writes; Turbo clears it meanwhile |
//! | X:$D009 bits 14-0 | 0x006C, 0x006E bits 7-0 | reads | stores its servo timer after the data |
//! | - | 0x006E bit 15 | clears it when it has taken the data | sets it when the data are whole |
//! | - | 0x0070 | writes which motors it wants | copies those |
//!
//! PMAC tests Host-Busy before it sets its own flag, so Host-Busy alone does not protect a slow read: an update may
//! begin right after the host polled. So in both ways of reading the host reads the status again after the data, and
//! discards the copy unless both readings are equal and not busy. Of a status in two words the host reads the flag
//! first: PMAC stores the timer before it says that the data are whole. This check does not catch a bus that returns
//! other data in the middle of a copy, for less than a servo period; nor, in optimistic reading, a servo counter that
//! is set back by one update at that moment, so that two updates in a row have the same number.
//!
//! On request (I47=0) a Turbo board waits until the host has taken an update before it makes the next one (p. 403).
//! The host always clears the flag. For reports that the board makes by itself this matters only if an update becomes
//! ready between the host's last look and its write; that update counts as missed.
//!
//! The mask is the host's, but any host can write it. The reader reads the mask again now and then, and no longer
//! reads the motors that another host took out: PMAC leaves their blocks as they are.
//!
//! If a host dies with Host-Busy set, PMAC makes no more updates; [`ServoReader::release`] clears Host-Busy.

use std::ops::Range;

use crate::clock::Clock;
use crate::device::{Bus, BusError};
use crate::format::{join32, split32};
use crate::map::{BusyRule, Flag, HostOffset, Motors, Selection, ServoBlock, WholeBoard};

/// How the host reads the buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ServoReading {
    /// PMAC's status word serves as a sequence number; the host sets no bit and PMAC never skips an update. The manual
    /// gives another procedure; no test on a card has confirmed this one yet.
    #[default]
    Optimistic,
    /// The manual's procedure: Host-Busy is set around each read, and PMAC skips updates that fall into it.
    Handshake,
}

/// The reader discards a copy that took longer: the shortest timer comes round after 32768 servo cycles, 14.5 s at the
/// default rate.
const LONGEST_COPY_NS: u64 = 1_000_000_000;
/// After so many updates the host reads the mask again: a tenth of a second at the default rate.
const MASK_UPDATES: u32 = 256;
/// How often the host reads PMAC's flag after it set Host-Busy, before it gives up this update.
const BUSY_POLLS: usize = 8;

/// The result of a poll of the servo report.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ServoPoll {
    /// No update since the last one taken.
    Unchanged,
    /// The first poll: the value is the timer of an earlier update, which the host does not take.
    First(u32),
    /// PMAC is writing the buffer.
    Busy,
    /// PMAC wrote while the host read; the copy was discarded.
    Torn,
    /// [`ServoReader::image`] holds a new update; the value is its servo timer.
    Update(u32),
}

/// Which motors move. A motor whose status the host does not read is in neither set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Motion {
    /// Their loops are closed and their desired velocity is not zero.
    pub moving: Motors,
    /// Their desired velocity is zero, or their loops are open.
    pub standing: Motors,
}

/// PMAC's flag and the servo timer, as the host read them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Status {
    flag: u16,
    timer_low: u16,
}

/// Reads the servo report of the motors that the board reports, or the selected part.
pub struct ServoReader {
    block: &'static ServoBlock,
    reading: ServoReading,
    selection: Selection,
    /// The motors that the caller said the board reports; `None` until then.
    told: Option<Motors>,
    /// Those of them that the board does report.
    motors: Motors,
    /// The host must write the report's mask.
    mask_due: bool,
    /// The host leaves the mask as it found it: another program may use the words of motors outside the mask.
    as_found: bool,
    /// The mask as the host found it, and as the host wrote it.
    mask_found: Option<[u32; 2]>,
    /// Updates left until the host reads the mask again.
    mask_updates: u32,
    /// The motors of `told` that another host has taken out of the mask, and whether that set has changed.
    taken_out: Motors,
    taken_out_changed: bool,
    /// The words that the host reads of the motors' blocks, from the first block's start.
    runs: Vec<Range<usize>>,
    last_timer: Option<u32>,
    clock: Clock,
    image: Box<[u16]>,
    /// The motors' status in the image.
    open_loops: Motors,
    motion: Motion,
}

impl ServoReader {
    /// A reader of the parts of the motors' blocks that `selection` names.
    #[must_use]
    pub fn new(block: &'static ServoBlock, reading: ServoReading, selection: Selection) -> Self {
        let mut reader = Self {
            block,
            reading,
            selection,
            told: None,
            motors: Motors::ALL,
            mask_due: false,
            as_found: false,
            mask_found: None,
            mask_updates: 0,
            taken_out: Motors::NONE,
            taken_out_changed: false,
            // Room for any selection, so that the bus thread does not allocate later.
            runs: Vec::with_capacity(block.motors.count * block.motors.words),
            last_timer: None,
            clock: Clock::real(),
            image: vec![0; block.words()].into_boxed_slice(),
            open_loops: Motors::NONE,
            motion: Motion::default(),
        };
        reader.read_motors(Motors::ALL);
        reader
    }

    /// The same reader, which measures by `clock` how long a copy takes.
    #[must_use]
    pub fn timed_by(mut self, clock: Clock) -> Self {
        self.clock = clock;
        self
    }

    /// How the host reads the buffer.
    #[must_use]
    pub fn reading(&self) -> ServoReading {
        self.reading
    }

    /// Bits of the servo timer.
    #[must_use]
    pub fn timer_bits(&self) -> u32 {
        self.block.timer.bits()
    }

    /// Reads from now on the motors that the board reports. PMAC leaves the blocks of the other motors as they are, so
    /// the host does not read those. Where the report has a mask, the next poll writes `motors` to it.
    pub fn set_motors(&mut self, motors: Motors) {
        self.told = Some(motors);
        self.mask_due = self.block.mask.is_some();
        self.mask_updates = 0;
        self.read_motors(motors);
    }

    /// Which motors another host has taken out of the mask, if that set has changed since the last call.
    pub fn take_taken_out(&mut self) -> Option<Motors> {
        std::mem::take(&mut self.taken_out_changed).then_some(self.taken_out)
    }

    /// The motors that the host does not read because it leaves the report's mask as it found it.
    #[must_use]
    pub fn left_out(&self) -> Motors {
        if self.as_found { self.told.unwrap_or_default().without(self.motors) } else { Motors::NONE }
    }

    /// Sets whether to leave the report's mask as the host finds it, and to read the motors in the mask.
    pub fn keep_as_found(&mut self, as_found: bool) {
        if self.as_found == as_found {
            return;
        }
        self.as_found = as_found;
        self.mask_updates = 0;
        if let Some(told) = self.told.filter(|_| !as_found) {
            self.read_motors(told);
        }
    }

    fn read_motors(&mut self, motors: Motors) {
        self.motors = motors;
        let ServoBlock { motors: blocks, .. } = self.block;
        self.reported().runs(blocks.words, blocks.count, &mut self.runs);
        let read = self.masked();
        let image = &mut self.image[self.block.index(blocks.first)..];
        let others = (1..).zip(image.chunks_mut(blocks.words)).filter(|(motor, _)| !read.contains(*motor));
        others.for_each(|(_, block)| block.fill(0));
        self.see_motors();
    }

    fn reported(&self) -> Selection {
        self.selection.among(self.motors.bits())
    }

    /// The last update, from the region's first word up to the last motor read. The mask, where the report has one,
    /// tells which motors the host read. Words that the host does not read (its own status, the global spares, words
    /// that were not selected) are 0.
    #[must_use]
    pub fn image(&self) -> &[u16] {
        let motors = self.reported().last_number(self.block.motors.count);
        &self.image[..self.block.motors.words_from(self.block.region.start, motors)]
    }

    /// The state of the whole board in the last update; `None` where the report does not tell.
    #[must_use]
    pub fn whole_board(&self) -> Option<WholeBoard> {
        let status = self.block.global_status.as_ref()?;
        Some(status.whole_board(status.words(&self.image, self.block.region.start)?))
    }

    /// The motors whose loop was open at the last update, among those whose status the host reads.
    #[must_use]
    pub fn open_loops(&self) -> Motors {
        self.open_loops
    }

    /// Which motors moved at the last update, among those whose status the host reads.
    #[must_use]
    pub fn motion(&self) -> Motion {
        self.motion
    }

    fn see_motors(&mut self) {
        self.open_loops = self.motors_with(self.block.open_loop);
        let known = self.motors_with(self.block.activated);
        let standing = self.motors_with(self.block.standing).and(self.open_loops);
        self.motion = Motion { moving: known.without(standing), standing: known.among(standing) };
    }

    fn motors_with(&self, flag: Flag) -> Motors {
        let status = self.image[self.block.index(flag.word)..].chunks(self.block.motors.words);
        (1..).zip(status).filter_map(|(motor, words)| flag.is_set(words[0]).then_some(motor)).collect()
    }

    /// Forgets the last update: the data in the buffer at the next poll count as old. Only a later change counts as an
    /// update, so the host never takes data from before a reset or a restart for new.
    pub fn reset(&mut self) {
        self.last_timer = None;
        self.mask_is_lost();
    }

    /// The board was reset, and no manual says whether the mask survives. The next poll writes the mask, if the caller
    /// has set motors.
    pub fn mask_is_lost(&mut self) {
        self.mask_due = self.block.mask.is_some() && self.told.is_some();
        self.mask_updates = 0;
    }

    /// Restores the mask that the host found, unless another host has written another mask since.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn give_back(&mut self, bus: &mut impl Bus) -> Result<(), BusError> {
        if let (Some(mask), Some([found, written])) = (self.block.mask, self.mask_found.take())
            && read32(bus, mask)? == written
        {
            write32(bus, mask, found)?;
        }
        Ok(())
    }

    /// Clears Host-Busy, whichever host set it.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn release(block: &ServoBlock, bus: &mut impl Bus) -> Result<(), BusError> {
        bus.write16(block.host_busy.word, 0)?;
        bus.order_writes();
        Ok(())
    }

    /// Polls once, and takes a new update, if any.
    ///
    /// # Errors
    /// When the bus cannot be reached; Host-Busy may then be left set.
    pub fn poll(&mut self, bus: &mut impl Bus) -> Result<ServoPoll, BusError> {
        if let Some(mask) = self.block.mask {
            self.keep_mask(bus, mask)?;
        }
        let Some(status) = self.status(bus)? else {
            // A flag that the host clears is clear while PMAC writes, or until PMAC has a new update.
            return Ok(if self.host_takes() { ServoPoll::Unchanged } else { ServoPoll::Busy });
        };
        let timer = self.timer(status);
        match self.last_timer {
            Some(last) if last != timer => {}
            Some(_) => {
                self.take(bus, status)?;
                return Ok(ServoPoll::Unchanged);
            }
            None => {
                self.last_timer = Some(timer);
                self.take(bus, status)?;
                return Ok(ServoPoll::First(timer));
            }
        }
        let poll = match self.reading {
            ServoReading::Optimistic => self.copy(bus, status)?,
            ServoReading::Handshake => {
                bus.write16(self.block.host_busy.word, self.block.host_busy.mask)?;
                bus.order_writes();
                let poll = self.copy_held(bus);
                Self::release(self.block, bus)?;
                poll?
            }
        };
        if let ServoPoll::Update(timer) = poll {
            self.last_timer = Some(timer);
        }
        Ok(poll)
    }

    /// Writes the mask when that is due, and reads now and then whether another host has changed it.
    fn keep_mask(&mut self, bus: &mut impl Bus, mask: HostOffset) -> Result<(), BusError> {
        let writes = self.mask_due && !self.as_found;
        if !writes && self.mask_updates > 0 {
            return Ok(());
        }
        let seen = read32(bus, mask)?;
        let (told, in_mask) = (self.told.unwrap_or(Motors::ALL), Motors::from_bits(seen));
        let (motors, before) = if writes { (told, in_mask) } else { (told.among(in_mask), self.motors) };
        if motors != self.motors {
            self.read_motors(motors);
        }
        // A mask that this host leaves as found does not show which motors another host took out.
        let taken_out =
            if self.as_found { self.taken_out } else { self.told.unwrap_or_default().without(motors) };
        self.taken_out_changed |= std::mem::replace(&mut self.taken_out, taken_out) != taken_out;
        if !before.has_all(motors) {
            // In the present update the blocks of the added motors are old, or belong to another program.
            self.last_timer = None;
        }
        if writes {
            let masked = self.masked().bits();
            let found =
                self.mask_found.filter(|[_, written]| *written == seen).map_or(seen, |[found, _]| found);
            self.mask_found = Some([found, masked]);
            write32(bus, mask, masked)?;
            self.mask_due = false;
        }
        self.mask_updates = MASK_UPDATES;
        Ok(())
    }

    /// The motors that the host reads.
    fn masked(&self) -> Motors {
        Motors::from_bits(self.reported().mask(self.block.motors.count))
    }

    /// Whether the host clears PMAC's flag.
    fn host_takes(&self) -> bool {
        self.block.busy == BusyRule::ClearWhileWriting
    }

    /// Tells PMAC that the host has taken the data, where the board waits for that.
    fn take(&self, bus: &mut impl Bus, status: Status) -> Result<(), BusError> {
        if !self.host_takes() {
            return Ok(());
        }
        let Flag { word, mask } = self.block.pmac_status;
        bus.write16(word, status.flag & !mask)
    }

    /// Reads PMAC's flag and the timer; `None` while PMAC writes. 1 read, or 2 where they are two words.
    fn status(&self, bus: &mut impl Bus) -> Result<Option<Status>, BusError> {
        let ServoBlock { pmac_status, busy, timer, .. } = self.block;
        let flag = bus.read16(pmac_status.word)?;
        // All ones is an absent board.
        if busy.is_busy(pmac_status.is_set(flag)) || flag == u16::MAX {
            return Ok(None);
        }
        let timer_low = if timer.low == pmac_status.word {
            flag
        } else {
            bus.order_reads();
            bus.read16(timer.low)?
        };
        Ok(Some(Status { flag, timer_low }))
    }

    fn timer(&self, status: Status) -> u32 {
        // Where the timer has a high part, it is in the word of the flag.
        self.block.timer.value(status.timer_low, status.flag)
    }

    /// Copies while Host-Busy is set, once PMAC is not busy.
    fn copy_held(&mut self, bus: &mut impl Bus) -> Result<ServoPoll, BusError> {
        for _ in 0..BUSY_POLLS {
            if let Some(status) = self.status(bus)? {
                return self.copy(bus, status);
            }
        }
        Ok(ServoPoll::Busy)
    }

    /// Copies the buffer; `before` is the status read before. Accepts the copy only if the status is still the same.
    fn copy(&mut self, bus: &mut impl Bus, before: Status) -> Result<ServoPoll, BusError> {
        let block = self.block;
        bus.order_reads();
        let began_ns = self.clock.ns();
        let global = block.index(block.global.first);
        bus.read_data(block.global.first, &mut self.image[global..global + block.global.words])?;
        let motors = &mut self.image[block.index(block.motors.first)..];
        for run in &self.runs {
            bus.read_data(block.motors.first.plus_words(run.start), &mut motors[run.clone()])?;
        }
        bus.order_reads();
        let after = self.status(bus)?;
        // If the timer comes round while this thread is held up, it looks as if PMAC had written nothing.
        if after != Some(before) || self.clock.ns().saturating_sub(began_ns) > LONGEST_COPY_NS {
            return Ok(ServoPoll::Torn);
        }
        self.image[block.index(block.timer.low)] = before.timer_low;
        self.image[block.index(block.pmac_status.word)] = before.flag;
        if let Some(mask) = block.mask {
            let at = block.index(mask);
            let motors = split32(self.masked().bits());
            self.image[at..at + 2].copy_from_slice(&motors);
            self.mask_updates = self.mask_updates.saturating_sub(1);
        }
        self.see_motors();
        self.take(bus, before)?;
        Ok(ServoPoll::Update(self.timer(before)))
    }
}

fn read32(bus: &mut impl Bus, first: HostOffset) -> Result<u32, BusError> {
    let low = bus.read16(first)?;
    Ok(join32(low, bus.read16(first.plus_words(1))?))
}

fn write32(bus: &mut impl Bus, first: HostOffset, value: u32) -> Result<(), BusError> {
    let [low, high] = split32(value);
    bus.write16(first, low)?;
    bus.write16(first.plus_words(1), high)
}

/// Reads the servo timer of the last update. 1 read; for a timer of two words 3, rarely 5.
///
/// # Errors
/// When the bus cannot be reached.
pub fn read_timer(bus: &mut impl Bus, report: &ServoBlock) -> Result<u32, BusError> {
    let ServoBlock { pmac_status, timer, .. } = report;
    let mut high = bus.read16(pmac_status.word)?;
    if timer.low == pmac_status.word {
        return Ok(timer.value(high, 0));
    }
    let mut low = 0;
    // The two words belong to one update if the high word is the same before and after; the high word changes once in
    // 65536 cycles.
    for _ in 0..2 {
        low = bus.read16(timer.low)?;
        let again = bus.read16(pmac_status.word)?;
        if timer.value(0, again) == timer.value(0, high) {
            break;
        }
        high = again;
    }
    Ok(timer.value(low, high))
}

#[cfg(test)]
#[path = "servo_tests.rs"]
mod tests;
