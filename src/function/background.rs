//! Background fixed data: what PMAC reports between its PLC scans (DPRAM manual p. 17-21).
//!
//! Data-Ready (Y:$D08A bit 0) belongs to both: PMAC sets it after an update, the host clears it to have another.
//! While it is set PMAC leaves the buffer alone, so a reader that waits for it cannot be overtaken. While it is clear PMAC
//! makes a report at its next background pass, some milliseconds later at most, and that one lies there until it is
//! cleared again. So Data-Ready is cleared when a report is wanted, not when the last one has been read: what is
//! read then is as new as the looks for it are close together.
//!
//! Which register an axis target position comes from is PMAC's choice (the manual's Note 1), told by the program
//! status of the same report: bit 7 set and bit 5 clear, the segmented move's target; else bit 9 set, the
//! cutter-compensated one; else the programmed one.

use std::ops::Range;

use crate::device::{Bus, BusError};
use crate::map::Selection;
use crate::map::classic::{
    self, BACKGROUND_BLOCK, BACKGROUND_BLOCK_WORDS, BACKGROUND_DATA_READY, BACKGROUND_PANEL_PORT,
    BACKGROUND_SERVO_TIMER, DATA_READY,
};

/// Words of the background buffer, from the data-ready word at 0x0228 to the end of block 8.
pub const BACKGROUND_WORDS: usize = word_index(BACKGROUND_BLOCK) + classic::MOTORS * BACKGROUND_BLOCK_WORDS;
/// The three port longs.
const PORT_WORDS: usize = 6;

const fn word_index(offset: crate::map::HostOffset) -> usize {
    offset.word() - BACKGROUND_DATA_READY.word()
}

/// What a look at the background buffer gave.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BackgroundLook {
    /// PMAC has nothing ready.
    Nothing,
    /// A part of a report was read; look again for the rest.
    Partial,
    /// A whole report lies in [`BackgroundReader::image`]; the value is its servo timer.
    Report(u16),
}

/// Reads the background fixed data of motors and coordinate systems 1 to `numbers`, or what was selected of it.
///
/// A report is long, and the servo data must not wait for it, so each look reads one block. That is safe: PMAC leaves
/// the buffer alone until the host clears Data-Ready, which it does to ask for the next report.
pub struct BackgroundReader {
    selection: Selection,
    numbers: usize,
    /// What is read of a block, in words from its start.
    runs: Vec<Range<usize>>,
    image: [u16; BACKGROUND_WORDS],
    /// The next block to read, while a report is being read.
    next_block: Option<usize>,
}

impl Default for BackgroundReader {
    fn default() -> Self {
        Self::selecting(Selection::ALL)
    }
}

impl BackgroundReader {
    /// A reader that has seen nothing yet, and reads of the blocks only what `selection` has.
    #[must_use]
    pub fn selecting(selection: Selection) -> Self {
        let mut runs = Vec::new();
        let (words, _) = selection.left_out();
        Selection::without(words, 0).runs(BACKGROUND_BLOCK_WORDS, 1, &mut runs);
        let image = [0; BACKGROUND_WORDS];
        Self { selection, numbers: classic::MOTORS, runs, image, next_block: None }
    }

    /// Reads motors and coordinate systems 1 to `numbers` from now on (I59); at most 8.
    pub fn set_numbers(&mut self, numbers: usize) {
        self.numbers = numbers.min(classic::MOTORS);
        self.next_block = None;
    }

    /// The buffer as last taken, from the word at 0x0228 on, up to the last block read. Words the host does not read
    /// (the spares, what was not selected) are 0.
    #[must_use]
    pub fn image(&self) -> &[u16] {
        let numbers = self.selection.last_number(self.numbers);
        &self.image[..word_index(BACKGROUND_BLOCK) + numbers * BACKGROUND_BLOCK_WORDS]
    }

    /// Gives up whatever lies in the buffer, so that the next report is a new one.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn release(bus: &mut impl Bus) -> Result<(), BusError> {
        bus.write16(BACKGROUND_DATA_READY, 0)?;
        bus.order_writes();
        Ok(())
    }

    /// Asks for a report made from now on; what lies in the buffer is given up. 1 write.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn ask(&mut self, bus: &mut impl Bus) -> Result<(), BusError> {
        self.forget();
        Self::release(bus)
    }

    /// Forgets a report half read, as after the board was silent or reset.
    pub fn forget(&mut self) {
        self.next_block = None;
    }

    /// Looks once: reads the next part of the report if there is one. After its last part it lies there until another is
    /// asked for. 1 access when there is nothing; a report of n numbers costs 62n + 11 in all: 1 to ask for it, 8 to
    /// begin with, 62 a look, and in the last look 2 more, to see that it still stands.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn look(&mut self, bus: &mut impl Bus) -> Result<BackgroundLook, BusError> {
        let Some(next) = self.next_block else { return self.look_for_report(bus) };
        if let Some(block) = self.selected_from(next) {
            let start = block * BACKGROUND_BLOCK_WORDS;
            let words = &mut self.image[word_index(BACKGROUND_BLOCK) + start..];
            for run in &self.runs {
                bus.read_data(BACKGROUND_BLOCK.plus_words(start + run.start), &mut words[run.clone()])?;
            }
            self.next_block = Some(block + 1);
            if self.selected_from(block + 1).is_some() {
                return Ok(BackgroundLook::Partial);
            }
        }
        self.next_block = None;
        bus.order_reads();
        // A board that was reset meanwhile may have begun, or made, another report (`tests/models/background.pml`).
        let again = [bus.read16(BACKGROUND_DATA_READY)?, bus.read16(BACKGROUND_SERVO_TIMER)?];
        if again != [self.image[0], self.image[word_index(BACKGROUND_SERVO_TIMER)]] {
            return Ok(BackgroundLook::Nothing);
        }
        Ok(BackgroundLook::Report(self.image[word_index(BACKGROUND_SERVO_TIMER)]))
    }

    /// The first block from `next` on that is to be read.
    fn selected_from(&self, next: usize) -> Option<usize> {
        (next..self.numbers).find(|block| self.selection.has_number(block + 1))
    }

    /// Reads the global words if PMAC has a report ready.
    fn look_for_report(&mut self, bus: &mut impl Bus) -> Result<BackgroundLook, BusError> {
        let ready = bus.read16(BACKGROUND_DATA_READY)?;
        // All ones is what an absent board reads as, not a report: bits 15-1 are reserved and 0.
        if ready & DATA_READY == 0 || ready == u16::MAX {
            return Ok(BackgroundLook::Nothing);
        }
        bus.order_reads();
        let ports = word_index(BACKGROUND_PANEL_PORT);
        self.image[0] = ready;
        self.image[word_index(BACKGROUND_SERVO_TIMER)] = bus.read16(BACKGROUND_SERVO_TIMER)?;
        bus.read_data(BACKGROUND_PANEL_PORT, &mut self.image[ports..ports + PORT_WORDS])?;
        self.next_block = Some(0);
        Ok(BackgroundLook::Partial)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::{Counted, FileBoard};

    #[test]
    fn a_report_is_held_until_the_next_is_asked_for() {
        let file = tempfile::tempfile().unwrap();
        file.set_len(0x4000).unwrap();
        let mut bus = Counted::new(FileBoard::from_file(&file, 0x4000).unwrap());
        let mut reader = BackgroundReader::default();
        assert_eq!(reader.look(&mut bus).unwrap(), BackgroundLook::Nothing);
        reader.set_numbers(3);
        bus.write16(BACKGROUND_BLOCK, 0xABCD).unwrap();
        bus.write16(BACKGROUND_SERVO_TIMER, 0x9000).unwrap();
        bus.write16(BACKGROUND_DATA_READY, DATA_READY).unwrap();
        let before = bus.accesses();
        for _ in 0..3 {
            assert_eq!(reader.look(&mut bus).unwrap(), BackgroundLook::Partial);
            assert_eq!(
                bus.read16(BACKGROUND_DATA_READY).unwrap(),
                DATA_READY,
                "held until the last word is read"
            );
        }
        assert_eq!(reader.look(&mut bus).unwrap(), BackgroundLook::Report(0x9000));
        assert_eq!(bus.accesses() - before, 2 + PORT_WORDS as u64 + 3 * 62 + 2 + 3, "3 are the test's own");
        assert_eq!(reader.image().len(), word_index(BACKGROUND_BLOCK) + 3 * 62);
        assert_eq!(reader.image()[word_index(BACKGROUND_BLOCK)], 0xABCD);
        assert_eq!(
            bus.read16(BACKGROUND_DATA_READY).unwrap(),
            DATA_READY,
            "PMAC makes none that nobody wants yet"
        );
        reader.ask(&mut bus).unwrap();
        assert_eq!(bus.read16(BACKGROUND_DATA_READY).unwrap(), 0);
        assert_eq!(reader.look(&mut bus).unwrap(), BackgroundLook::Nothing);
    }

    #[test]
    fn a_report_across_a_reset_is_not_taken() {
        let file = tempfile::tempfile().unwrap();
        file.set_len(0x4000).unwrap();
        let mut bus = FileBoard::from_file(&file, 0x4000).unwrap();
        let mut reader = BackgroundReader::default();
        reader.set_numbers(1);
        for (ready, timer) in [(0, 0), (DATA_READY, 8), (u16::MAX, u16::MAX)] {
            bus.write16(BACKGROUND_SERVO_TIMER, 7).unwrap();
            bus.write16(BACKGROUND_DATA_READY, DATA_READY).unwrap();
            assert_eq!(reader.look(&mut bus).unwrap(), BackgroundLook::Partial);
            bus.write16(BACKGROUND_SERVO_TIMER, timer).unwrap();
            bus.write16(BACKGROUND_DATA_READY, ready).unwrap();
            assert_eq!(reader.look(&mut bus).unwrap(), BackgroundLook::Nothing);
            assert_eq!(
                bus.read16(BACKGROUND_DATA_READY).unwrap(),
                ready,
                "a whole new report is left for the next looks"
            );
        }
    }

    #[test]
    fn an_absent_board_has_nothing_to_report() {
        let file = tempfile::tempfile().unwrap();
        file.set_len(0x4000).unwrap();
        let mut bus = FileBoard::from_file(&file, 0x4000).unwrap();
        bus.write16(BACKGROUND_DATA_READY, u16::MAX).unwrap();
        assert_eq!(BackgroundReader::default().look(&mut bus).unwrap(), BackgroundLook::Nothing);
    }
}
