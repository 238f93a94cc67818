//! The background report: data that PMAC copies between its PLC scans (DPRAM manual p. 17-21). [`BackgroundBlock`]
//! says where the report lies.
//!
//! PMAC and the host share Data-Ready: PMAC sets it after an update, the host clears it to ask for another. While
//! Data-Ready is set PMAC leaves the buffer alone, so PMAC cannot overtake a reader that waits for it. While it is
//! clear PMAC makes a report at its next background pass, some milliseconds later at most, and keeps that report until
//! the host clears Data-Ready again. So the host clears Data-Ready when it wants a report, not when it has read the
//! last one: the closer together the host polls, the newer is the report that it reads.
//!
//! A Turbo board may make reports by itself, the next one before the host has read the last (Turbo User Manual p.
//! 403). The reader drops a report that the board overtook. It then sets Host-Busy while it reads the next one: PMAC
//! makes no report meanwhile (p. 405). The reader sets Host-Busy only when a report is there, so it never waits for
//! one that PMAC holds back.
//!
//! PMAC chooses the register that an axis target position comes from (the manual's Note 1). The program status of the
//! same report tells which: bit 7 set and bit 5 clear, the segmented move's target; else bit 9 set, the
//! cutter-compensated target; else the programmed target.

use std::ops::Range;

use crate::device::{Bus, BusError};
use crate::map::functions::Flag;
use crate::map::{BackgroundBlock, Motors, Selection, Systems, WholeBoard};

/// The result of a poll of the background report.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BackgroundPoll {
    /// PMAC has nothing ready.
    Nothing,
    /// The reader has read a part of a report; poll again for the rest.
    Partial,
    /// [`BackgroundReader::image`] holds a whole report; the value is its servo timer.
    Report(u32),
}

/// Reads the background fixed data of motors and coordinate systems 1 to `numbers`, or the selected part.
///
/// A report is long, and the servo data must not wait for it, so each poll reads one block. Reading in parts is safe:
/// PMAC leaves the buffer alone until the host clears Data-Ready to ask for the next report.
pub struct BackgroundReader {
    block: &'static BackgroundBlock,
    selection: Selection,
    numbers: usize,
    /// The count of blocks that another host set; the reader reads no more of them. `None` where this host sets the
    /// count.
    as_found: Option<usize>,
    /// The words that the host reads of a block, from the block's start.
    runs: Vec<Range<usize>>,
    image: Box<[u16]>,
    /// The count as the host found it, and as the host wrote it.
    count_found: Option<[u16; 2]>,
    /// The next block to read, while the host reads a report.
    next_block: Option<usize>,
    /// PMAC made another report while the host read the last one.
    was_overtaken: bool,
    /// Host-Busy is set: PMAC makes no other report meanwhile.
    holds: bool,
}

/// The bits of the count's word that hold the count.
const COUNT: u16 = 0xFF;

impl BackgroundReader {
    /// A reader of the parts of `block` that `selection` names.
    #[must_use]
    pub fn new(block: &'static BackgroundBlock, selection: Selection) -> Self {
        let mut runs = Vec::new();
        let (words, _) = selection.left_out();
        Selection::without(words, 0).runs(block.blocks.words, 1, &mut runs);
        let image = vec![0; block.words()].into_boxed_slice();
        Self {
            block,
            selection,
            numbers: block.blocks.count,
            as_found: None,
            runs,
            image,
            count_found: None,
            next_block: None,
            was_overtaken: false,
            holds: false,
        }
    }

    /// Bits of the servo timer.
    #[must_use]
    pub fn timer_bits(&self) -> u32 {
        self.block.timer.bits()
    }

    /// Reads blocks 1 to `numbers` from now on, but no more than the report has.
    pub fn set_numbers(&mut self, numbers: usize) {
        self.numbers = numbers.min(self.block.blocks.count);
        self.next_block = None;
    }

    /// Sets whether to leave the report's count as the host finds it, and to read that many blocks: another program
    /// may use the words of the further blocks. Returns whether the setting changed.
    pub fn keep_as_found(&mut self, as_found: bool) -> bool {
        let keeps = as_found && self.block.count.is_some();
        if self.as_found.is_some() == keeps {
            return false;
        }
        self.as_found = keeps.then_some(0);
        true
    }

    /// The most blocks that the host reads.
    fn count(&self) -> usize {
        self.as_found.map_or(self.numbers, |found| found.min(self.numbers))
    }

    /// The last report, from the region's first word up to the last block read. Words that the host does not read (the
    /// spares, words that were not selected) are 0.
    #[must_use]
    pub fn image(&self) -> &[u16] {
        let numbers = self.selection.last_number(self.count());
        &self.image[..self.block.blocks.words_from(self.block.region.start, numbers)]
    }

    /// The state of the whole board in the last report; `None` where the report does not tell.
    #[must_use]
    pub fn whole_board(&self) -> Option<WholeBoard> {
        let status = self.block.global_status.as_ref()?;
        Some(status.whole_board(status.words(&self.image, self.block.region.start)?))
    }

    /// The motors whose amplifier was off at the last report (killed motors), among those whose status the host reads.
    #[must_use]
    pub fn amplifiers_off(&self) -> Motors {
        let Some(flag) = self.block.amplifier_enabled else { return Motors::NONE };
        self.flags(flag).filter_map(|(motor, is_set)| (!is_set).then_some(motor)).collect()
    }

    /// The coordinate systems that ran a motion program at the last report; `None` unless the host reads the status of
    /// every system.
    #[must_use]
    pub fn programs_run(&self) -> Option<Systems> {
        let flags = || self.flags(self.block.program_runs);
        (flags().count() == self.block.blocks.count)
            .then(|| flags().filter_map(|(system, is_set)| is_set.then_some(system)).collect())
    }

    /// A flag of each block that the host reads, with the block's number, from 1.
    fn flags(&self, flag: Flag) -> impl Iterator<Item = (usize, bool)> + '_ {
        let blocks = &self.block.blocks;
        let word = flag.word.words_since(blocks.first);
        let is_read = self.runs.iter().any(|run| run.contains(&word));
        let status = self.image.iter().skip(self.block.index(flag.word)).step_by(blocks.words);
        let read = status.take(if is_read { self.count() } else { 0 });
        (1..)
            .zip(read)
            .filter(|(number, _)| self.selection.has_number(*number))
            .map(move |(number, word)| (number, flag.is_set(*word)))
    }

    /// Gives up the report in the buffer, so that the next report is a new one, and clears Host-Busy.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn release(block: &BackgroundBlock, bus: &mut impl Bus) -> Result<(), BusError> {
        if let Some(host_busy) = block.host_busy {
            bus.write16(host_busy.word, 0)?;
        }
        bus.write16(block.ready.word, 0)?;
        bus.order_writes();
        Ok(())
    }

    /// Asks for a new report, and gives up the one in the buffer. 1 write, and one each for a host-busy word and a
    /// count, where the report has them; the first time 1 read of the count.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn ask(&mut self, bus: &mut impl Bus) -> Result<(), BusError> {
        self.reset();
        if let (Some(count), Some(found)) = (self.block.count, &mut self.as_found) {
            *found = usize::from(bus.read16(count)? & COUNT);
        } else if let Some(count) = self.block.count {
            let found = match self.count_found {
                Some([found, _]) => found,
                None => bus.read16(count)?,
            };
            let own = self.selection.last_number(self.numbers) as u16;
            self.count_found = Some([found, own]);
            bus.write16(count, own)?;
        }
        Self::release(self.block, bus)
    }

    /// Whether PMAC has made a report. 1 read.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn is_ready(&self, bus: &mut impl Bus) -> Result<bool, BusError> {
        Ok(self.block.ready.is_set(bus.read16(self.block.ready.word)?))
    }

    /// Restores the count that the host found, unless another host has written another count since.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn give_back(&mut self, bus: &mut impl Bus) -> Result<(), BusError> {
        self.let_go(bus)?;
        if let (Some(count), Some([found, written])) = (self.block.count, self.count_found.take())
            && bus.read16(count)? == written
        {
            bus.write16(count, found)?;
        }
        Ok(())
    }

    /// Forgets a half-read report, for instance after the board was silent or reset.
    pub fn reset(&mut self) {
        self.next_block = None;
    }

    /// Polls once: reads the next part of the report, if PMAC has made one. After its last part the report stays until
    /// the host asks for another. 1 access without a report; a report of n blocks of 62 words costs 62n + 11 in all: 1
    /// to ask for it, 8 to begin with, 62 a poll, and in the last poll 2 more, to see that PMAC made no other report.
    /// 3 more after an overtaken report.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn poll(&mut self, bus: &mut impl Bus) -> Result<BackgroundPoll, BusError> {
        let Some(next) = self.next_block else { return self.poll_for_report(bus) };
        if let Some(block) = self.selected_from(next) {
            let blocks = &self.block.blocks;
            let start = block * blocks.words;
            let words = &mut self.image[self.block.index(blocks.first) + start..];
            for run in &self.runs {
                bus.read_data(blocks.first.plus_words(start + run.start), &mut words[run.clone()])?;
            }
            self.next_block = Some(block + 1);
            if self.selected_from(block + 1).is_some() {
                return Ok(BackgroundPoll::Partial);
            }
        }
        self.next_block = None;
        bus.order_reads();
        // A board that was reset meanwhile may have begun or made another report (`tests/models/background.pml`).
        let [ready, timer] = [self.block.ready.word, self.block.timer.low];
        self.was_overtaken = false;
        for word in [ready, timer] {
            self.was_overtaken |= bus.read16(word)? != self.image[self.block.index(word)];
        }
        self.let_go(bus)?;
        if self.was_overtaken {
            return Ok(BackgroundPoll::Nothing);
        }
        Ok(BackgroundPoll::Report(self.block.timer.read(&self.image, self.block.region.start)))
    }

    /// Clears Host-Busy, if it is set.
    fn let_go(&mut self, bus: &mut impl Bus) -> Result<(), BusError> {
        if let Some(host_busy) = self.block.host_busy.filter(|_| std::mem::take(&mut self.holds)) {
            bus.write16(host_busy.word, 0)?;
            bus.order_writes();
        }
        Ok(())
    }

    /// The first selected block from `next` on.
    fn selected_from(&self, next: usize) -> Option<usize> {
        (next..self.count()).find(|block| self.selection.has_number(block + 1))
    }

    /// Reads the global words if PMAC has a report ready.
    fn poll_for_report(&mut self, bus: &mut impl Bus) -> Result<BackgroundPoll, BusError> {
        let block = self.block;
        // An absent board reads as all ones. A report never does: most bits are reserved and 0.
        let is_report = |ready| block.ready.is_set(ready) && ready != u16::MAX;
        let mut ready = bus.read16(block.ready.word)?;
        if let Some(host_busy) = block.host_busy.filter(|_| self.was_overtaken && is_report(ready)) {
            self.holds = true;
            bus.write16(host_busy.word, host_busy.mask)?;
            bus.order_writes();
            ready = bus.read16(block.ready.word)?;
        }
        if !is_report(ready) {
            self.let_go(bus)?;
            return Ok(BackgroundPoll::Nothing);
        }
        bus.order_reads();
        let global = block.index(block.global.first);
        self.image[block.index(block.ready.word)] = ready;
        self.image[block.index(block.timer.low)] = bus.read16(block.timer.low)?;
        bus.read_data(block.global.first, &mut self.image[global..global + block.global.words])?;
        self.next_block = Some(0);
        Ok(BackgroundPoll::Partial)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::{Counted, FileBoard};
    use crate::map::pmac::{BACKGROUND_BLOCK, BACKGROUND_DATA_READY, BACKGROUND_SERVO_TIMER, DATA_READY};
    use crate::map::{HostOffset, PMAC, TURBO2};

    #[test]
    fn a_report_is_held_until_the_next_is_asked_for() {
        let file = tempfile::tempfile().unwrap();
        file.set_len(0x4000).unwrap();
        let mut bus = Counted::new(FileBoard::from_file(&file, 0x4000).unwrap());
        let mut reader = BackgroundReader::new(&PMAC.background, crate::map::Selection::ALL);
        assert_eq!(reader.poll(&mut bus).unwrap(), BackgroundPoll::Nothing);
        reader.set_numbers(3);
        bus.write16(BACKGROUND_BLOCK, 0xABCD).unwrap();
        bus.write16(BACKGROUND_SERVO_TIMER, 0x9000).unwrap();
        bus.write16(BACKGROUND_DATA_READY, DATA_READY).unwrap();
        let before = bus.accesses();
        for _ in 0..3 {
            assert_eq!(reader.poll(&mut bus).unwrap(), BackgroundPoll::Partial);
            assert_eq!(
                bus.read16(BACKGROUND_DATA_READY).unwrap(),
                DATA_READY,
                "held until the last word is read"
            );
        }
        assert_eq!(reader.poll(&mut bus).unwrap(), BackgroundPoll::Report(0x9000));
        assert_eq!(bus.accesses() - before, 2 + 6 + 3 * 62 + 2 + 3, "3 are the test's own");
        assert_eq!(reader.image().len(), PMAC.background.index(BACKGROUND_BLOCK) + 3 * 62);
        assert_eq!(reader.image()[PMAC.background.index(BACKGROUND_BLOCK)], 0xABCD);
        assert_eq!(
            bus.read16(BACKGROUND_DATA_READY).unwrap(),
            DATA_READY,
            "PMAC makes none that nobody wants yet"
        );
        reader.ask(&mut bus).unwrap();
        assert_eq!(bus.read16(BACKGROUND_DATA_READY).unwrap(), 0);
        assert_eq!(reader.poll(&mut bus).unwrap(), BackgroundPoll::Nothing);
    }

    #[test]
    fn a_report_across_a_reset_is_not_taken() {
        let file = tempfile::tempfile().unwrap();
        file.set_len(0x4000).unwrap();
        let mut bus = FileBoard::from_file(&file, 0x4000).unwrap();
        let mut reader = BackgroundReader::new(&PMAC.background, crate::map::Selection::ALL);
        reader.set_numbers(1);
        for (ready, timer) in [(0, 0), (DATA_READY, 8), (u16::MAX, u16::MAX)] {
            bus.write16(BACKGROUND_SERVO_TIMER, 7).unwrap();
            bus.write16(BACKGROUND_DATA_READY, DATA_READY).unwrap();
            assert_eq!(reader.poll(&mut bus).unwrap(), BackgroundPoll::Partial);
            bus.write16(BACKGROUND_SERVO_TIMER, timer).unwrap();
            bus.write16(BACKGROUND_DATA_READY, ready).unwrap();
            assert_eq!(reader.poll(&mut bus).unwrap(), BackgroundPoll::Nothing);
            assert_eq!(
                bus.read16(BACKGROUND_DATA_READY).unwrap(),
                ready,
                "a whole new report is left for the next looks"
            );
        }
    }

    #[test]
    fn behind_a_report_that_was_overtaken_the_board_is_held_off() {
        let file = tempfile::tempfile().unwrap();
        file.set_len(TURBO2.length.into()).unwrap();
        let mut bus = FileBoard::from_file(&file, TURBO2.length as usize).unwrap();
        let mut reader = BackgroundReader::new(&TURBO2.background, crate::map::Selection::ALL);
        let [busy, timer, ready] = [0x0676, 0x0678, 0x067A].map(HostOffset::new);
        let mut timers = 1..;
        // The board makes a report at each look, unless Host-Busy is set.
        let mut poll = |reader: &mut BackgroundReader, bus: &mut FileBoard| {
            if bus.read16(busy).unwrap() & 0x8000 == 0 {
                bus.write16(timer, timers.next().unwrap()).unwrap();
                bus.write16(ready, 0x8000).unwrap();
            }
            reader.poll(bus).unwrap()
        };
        reader.ask(&mut bus).unwrap();
        let mut reports = (0..100).map(|_| (poll(&mut reader, &mut bus), bus.read16(busy).unwrap() >> 15));
        assert_eq!(
            reports.find(|(poll, _)| *poll != BackgroundPoll::Partial),
            Some((BackgroundPoll::Nothing, 0))
        );
        assert_eq!(reports.next(), Some((BackgroundPoll::Partial, 1)));
        let whole = reports.find(|(poll, _)| *poll != BackgroundPoll::Partial);
        assert!(matches!(whole, Some((BackgroundPoll::Report(_), 0))), "{whole:?}");
    }

    #[test]
    fn an_absent_board_has_nothing_to_report() {
        let file = tempfile::tempfile().unwrap();
        file.set_len(0x4000).unwrap();
        let mut bus = FileBoard::from_file(&file, 0x4000).unwrap();
        bus.write16(BACKGROUND_DATA_READY, u16::MAX).unwrap();
        assert_eq!(
            BackgroundReader::new(&PMAC.background, crate::map::Selection::ALL).poll(&mut bus).unwrap(),
            BackgroundPoll::Nothing
        );
    }
}
