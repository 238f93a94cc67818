//! PMAC's half of the background report (DPRAM manual pp. 17-21).
//!
//! Each background pass, with I49=1 and I59>0 and Data-Ready clear: copy the registers of motors and coordinate systems
//! 1 to I59, store the servo timer, set Data-Ready. Some families have a count in the DPRAM in place of I59, and a
//! Host-Busy flag that holds the report off.
//!
//! Turbo (User Manual p. 403): with I50 above 0 the board reports unasked, when more than I50 servo cycles have passed
//! since the last report. With I57=1 the board copies the motors in the same pass, also when the host asks for no
//! coordinate system.

use crate::format::{float48, int24};
use crate::map::{Family, HostOffset};
use crate::sim::board::Board;
use crate::sim::functions::copies::{Copies, calculated};
use crate::sim::functions::servo_report::ServoReport;

const FUNCTION: &str = "background";

/// Bits of PSTATUS that choose an axis position's source (manual p. 21, note 1).
const SEGMENTED: u32 = 1 << 7;
const SEGMENTED_STOP: u32 = 1 << 5;
const COMPENSATED: u32 = 1 << 9;

/// Values of a coordinate system's program, and the long of each row that takes the value. Turbo's manuals name a
/// register for none of these values, PMAC's for some.
const CALCULATED: [(&str, usize); 7] = [
    ("cs_time_left_in_acceleration", 0),
    ("cs_program_address_offset", 0),
    ("cs_time_left_in_move", 0),
    ("cs_program_lines_remaining", 0),
    ("cs_feedpot_pointer", 0),
    ("cs_feedrate_or_time", 0),
    ("cs_feedrate_or_time", 1),
];
/// In the time base's pointer: a feed hold is in progress (the vendor's header for Turbo).
const FEED_HOLD: u32 = 1 << 22;

/// The background report.
#[derive(Debug)]
pub struct BackgroundReport {
    copies: Copies,
    /// For each number: the places of those values in [`CALCULATED`] for which no manual names a register.
    calculated: Vec<[Option<HostOffset>; CALCULATED.len()]>,
    /// The servo cycle of the last report.
    last: u64,
}

impl BackgroundReport {
    /// The report of `family`.
    #[must_use]
    pub fn new(family: &Family) -> Self {
        let calculated = (0..family.background.blocks.count).map(|index| {
            CALCULATED
                .map(|(name, long)| Some(calculated(family, FUNCTION, name, index)?.plus_words(2 * long)))
        });
        let copies = Copies::new(family, FUNCTION);
        Self { copies, calculated: calculated.collect(), last: 0 }
    }

    /// Makes a due report; true when it did.
    ///
    /// `programs` has time left in acceleration, execution address offset and time left in the move of each coordinate system.
    /// `motors` makes the servo report where that belongs to this report.
    pub fn poll(&mut self, board: &mut Board, programs: &[[u32; 3]], motors: &mut ServoReport) -> bool {
        let family = board.family();
        let background = &family.background;
        let count = count(board);
        let with_motors = family.i.servo_in_background.is_some_and(|number| board.enabled(number));
        let wanted = count > 0 || with_motors;
        if !board.enabled(family.i.background_enable) || !wanted || board.faults.background_stuck {
            return false;
        }
        let status = board.memory.dpram.read16(background.ready.word);
        let held = background.host_busy.is_some_and(|busy| board.memory.dpram.is_set(busy));
        if held || !self.is_due(board, background.ready.is_set(status)) {
            return false;
        }
        self.last = board.stats.servo_cycles;
        if with_motors {
            motors.update(board);
        }
        let memory = &mut board.memory;
        // The host may have cleared the flag, and the timer may share its word.
        memory.dpram.adopt(background.ready.word, status);
        if background.ready.is_set(status) {
            memory.dpram.set(background.ready, false);
        }
        for copy in &self.copies.board {
            copy.write(copy.read(0, memory), memory);
        }
        for (index, copies) in self.copies.numbers.iter().enumerate().take(count) {
            let status = memory.read(memory.registers().program_status.of(index));
            let choice = if status & SEGMENTED != 0 && status & SEGMENTED_STOP == 0 {
                0
            } else if status & COMPENSATED != 0 {
                1
            } else {
                2
            };
            for copy in copies {
                copy.write(copy.read(choice, memory), memory);
            }
        }
        for (index, (places, &run)) in self.calculated.iter().take(count).zip(programs).enumerate() {
            for (place, word) in places.iter().zip(calculated_words(board, index, run)) {
                if let Some(place) = *place {
                    board.memory.dpram.write32(place, int24::extend(word));
                }
            }
        }
        let memory = &mut board.memory;
        let count = memory.read(memory.registers().servo_counter);
        memory.dpram.store_timer(background.timer, count);
        memory.dpram.order_writes();
        memory.dpram.set(background.ready, true);
        true
    }

    /// Whether a report is due. `ready`: the host has not taken the last report.
    fn is_due(&self, board: &Board, ready: bool) -> bool {
        let number = board.family().i.background_period;
        let period = number.map_or(0, |number| board.variables.i(number.into()) as u64);
        if period == 0 {
            return !ready;
        }
        board.stats.servo_cycles.saturating_sub(self.last) > period
    }
}

/// The words of [`CALCULATED`]. `run` has time left in acceleration, execution address offset and time left in the move.
fn calculated_words(board: &Board, index: usize, run: [u32; 3]) -> [u32; CALCULATED.len()] {
    let i = |number| board.variables.i(board.memory.tables().coordinate_i(index, number));
    let lines = board.memory.read(board.memory.registers().lines_remaining.of(index));
    let hold = if board.is_held(index) { FEED_HOLD } else { 0 };
    let [low, high] = float48::encode(i(89));
    [run[0], run[1], run[2], lines, i(93) as u32 | hold, low, high]
}

/// How many blocks the report has.
fn count(board: &Board) -> usize {
    let family = board.family();
    let most = family.background.blocks.count;
    let asked = match (family.background.count, family.i.reported) {
        (Some(word), _) => board.memory.dpram.read16(word).into(),
        (None, Some(number)) => board.variables.i(number.into()) as usize,
        (None, None) => most,
    };
    asked.min(most)
}

#[cfg(test)]
mod tests {
    use crate::format::float48;
    use crate::sim::testing::{Bench, l};

    #[test]
    fn a_report_waits_for_the_host_to_clear_data_ready() {
        let mut bench = Bench::started();
        bench.run(5);
        assert_eq!((bench.read(0x0228), bench.read(0x022A)), (1, 1));
        bench.write(0x0228, 0);
        bench.world.board.memory.write_x(0, 0xFFFF);
        bench.run(1);
        assert_eq!((bench.read(0x0228), bench.read(0x022A)), (1, 0));
        assert!(bench.violations().is_empty());
        bench.set(49, 0.0);
        bench.write(0x0228, 0);
        bench.run(3);
        assert_eq!(bench.read(0x0228), 0);
    }

    #[test]
    fn the_program_status_chooses_where_axis_positions_come_from() {
        for (status, expected) in
            [(0, 3.0), (1 << 7, 1.0), (1 << 7 | 1 << 5, 3.0), (1 << 9, 2.0), (1 << 9 | 1 << 7, 1.0)]
        {
            let mut bench = Bench::started();
            let memory = &mut bench.world.board.memory;
            // X axis of C.S. 2
            memory.write_l(l(0x093C), 1.0);
            memory.write_l(l(0x095C), 2.0);
            memory.write_l(l(0x08DF), 3.0);
            memory.write_y(0x08D7, status);
            bench.run(1);
            let found = float48::decode(bench.read32(0x0314), bench.read32(0x0318));
            assert_eq!(found, expected, "{status:#x}");
        }
    }
}
