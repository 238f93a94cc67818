//! PMAC's half of the servo report (DPRAM manual p. 14, Turbo User Manual p. 403).
//!
//! Every I19 servo cycles, when Host-Busy is clear: set PMAC-Busy, copy the registers of motors 1 to I59, store the
//! timer, clear PMAC-Busy. PMAC tests Host-Busy before it sets PMAC-Busy, as the manual says, so a host that sets
//! Host-Busy in between meets an update under way. In a family with a mask of motors the report copies the motors of
//! the mask, and the family's [`BusyRule`] may invert PMAC's flag.
//!
//! Turbo needs no `GATHER`. With a period of 0 PMAC makes an update whenever the host has cleared the flag; otherwise
//! it makes updates unasked. With I57=1 PMAC makes the update together with the background report.
//!
//! With tags on, every 24-bit half of every copied register carries the number of the update (modulo 2^24): a reader that
//! finds two numbers in one copy has read across two updates.
//!
//! With times on, motor 1's compensation position (its position bias, in a report without compensation position)
//! carries CLOCK_MONOTONIC in ns at the update (modulo 2^48): from this time a reader computes the age of the data.

use nix::time::{ClockId, clock_gettime};

use crate::format::int24;
use crate::map::{BusyRule, HostOffset, ReportStart};
use crate::sim::board::Board;
use crate::sim::board::firmware::FirmwareTables;
use crate::sim::board::gather::Activity;
use crate::sim::board::memory::Memory;
use crate::sim::functions::copies::Copies;

/// The report's state.
#[derive(Debug, Clone)]
pub struct ServoReport {
    copies: Copies,
    /// Where the compensation position or the position bias of motor 1 goes.
    stamp: Option<HostOffset>,
    wait: u32,
    /// Fields carry the update's number.
    pub tag: bool,
    /// A field carries the time of the update.
    pub time: bool,
    /// Updates made.
    pub updates: u64,
    /// Updates held off because Host-Busy was set.
    pub skipped: u64,
}

impl ServoReport {
    /// No update made.
    #[must_use]
    pub fn new(tables: &FirmwareTables) -> Self {
        let copies = Copies::new(tables.family, "servo");
        let motor = copies.numbers.first();
        let stamps = [tables.registers.compensation, tables.registers.bias].map(|register| register.of(0));
        let stamp = stamps.iter().find_map(|&register| motor?.iter().find(|copy| copy.is_of(register)));
        Self {
            stamp: stamp.map(|copy| copy.offset()),
            copies,
            wait: 0,
            tag: false,
            time: false,
            updates: 0,
            skipped: 0,
        }
    }

    /// After a reset the next update is due at once. The counts go on.
    pub fn reset(&mut self) {
        self.wait = 0;
    }

    /// One servo cycle.
    pub fn cycle(&mut self, board: &mut Board) {
        let family = board.family();
        let started = match family.servo.start {
            ReportStart::Gather => board.gather.runs(Activity::ServoReport),
            ReportStart::Enable => true,
        };
        if !started || !board.enabled(family.i.servo_enable) {
            self.wait = 0;
        } else if self.is_due(board) {
            self.update(board);
        }
    }

    /// Whether an update is due in this servo cycle.
    fn is_due(&mut self, board: &Board) -> bool {
        let period = board.variables.i(board.family().i.servo_period.into()) as u32;
        if period == 0 {
            self.wait = 0;
            // On request: the host has taken the last update.
            let servo = &board.family().servo;
            return servo.busy == BusyRule::ClearWhileWriting
                && !board.memory.dpram.is_set(servo.pmac_status);
        }
        if self.wait > 0 {
            self.wait = self.wait.min(period) - 1;
            if self.wait > 0 {
                return false;
            }
        }
        self.wait = period;
        true
    }

    /// Makes an update, unless the host holds it off.
    pub fn update(&mut self, board: &mut Board) {
        let servo = &board.family().servo;
        let motors = motors(board);
        if motors == 0 || board.faults.servo_silent {
            self.wait = 0;
            return;
        }
        let memory = &mut board.memory;
        if memory.dpram.is_set(servo.host_busy) {
            self.skipped += 1;
            return;
        }
        memory.dpram.set(servo.pmac_status, servo.busy.flag(true));
        if board.faults.servo_busy_stuck {
            return;
        }
        memory.dpram.order_writes();
        self.updates += 1;
        self.copy(motors, memory);
        if self.time {
            self.stamp(memory);
        }
        memory.dpram.order_writes();
        let count = memory.read(memory.registers().servo_counter);
        memory.dpram.store_timer(servo.timer, count);
        memory.dpram.set(servo.pmac_status, servo.busy.flag(false));
    }

    fn stamp(&self, memory: &mut Memory) {
        let Some(place) = self.stamp else { return };
        let now = clock_gettime(ClockId::CLOCK_MONOTONIC)
            .map_or(0, |now| now.tv_sec().cast_unsigned() * 1_000_000_000 + now.tv_nsec().cast_unsigned());
        for (half, words) in [(now, 0), (now >> 24, 2)] {
            memory.dpram.write32(place.plus_words(words), int24::extend(half as u32 & int24::MASK));
        }
    }

    /// Copies the words of the board, and the words of the motors whose bits are set in `motors`.
    fn copy(&self, motors: u32, memory: &mut Memory) {
        let tag = self.tag.then_some(self.updates as u32 & int24::MASK);
        let chosen = self.copies.numbers.iter().enumerate().filter(|(motor, _)| motors >> motor & 1 == 1);
        for copy in self.copies.board.iter().chain(chosen.flat_map(|(_, copies)| copies)) {
            let word = tag.unwrap_or_else(|| copy.read(0, memory));
            copy.write(word, memory);
        }
    }
}

/// The motors that the report has, bit 0 for motor 1.
fn motors(board: &Board) -> u32 {
    let family = board.family();
    let all = first(family.servo.motors.count);
    let mask = family.servo.mask.map_or(all, |mask| board.memory.dpram.read32(mask));
    let reported = family.i.reported.map_or(all, |number| first(board.variables.i(number.into()) as usize));
    all & mask & reported
}

/// The bits of the first `count` motors.
fn first(count: usize) -> u32 {
    u32::MAX.checked_shr(32_u32.saturating_sub(count as u32)).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use crate::sim::testing::Bench;

    #[test]
    fn updates_come_every_i19_cycles_after_gather_and_carry_the_timer() {
        let mut bench = Bench::bare("1.16D");
        for (variable, value) in [(48, 1.0), (59, 2.0), (19, 5.0)] {
            bench.set(variable, value);
        }
        bench.run(20);
        assert_eq!(bench.world.report.updates, 0, "no GATHER yet");
        bench.world.board.gather(false).unwrap();
        bench.run(1);
        assert_eq!(bench.read(0x0026), 21);
        bench.run(4);
        assert_eq!(bench.read(0x0026), 21);
        bench.run(1);
        assert_eq!(bench.read(0x0026), 26);
        assert_eq!(bench.world.report.updates, 2);
        bench.world.board.end_gather().unwrap();
        bench.run(20);
        assert_eq!(bench.world.report.updates, 2);
    }

    #[test]
    fn host_busy_holds_updates_off_and_each_is_counted() {
        let mut bench = Bench::started();
        bench.run(3);
        bench.write(0x0024, 1);
        bench.run(7);
        assert_eq!(bench.read(0x0026), 3);
        assert_eq!((bench.world.report.updates, bench.world.report.skipped), (3, 7));
        bench.write(0x0024, 0);
        bench.run(1);
        assert_eq!(bench.read(0x0026), 11);
        assert!(bench.violations().is_empty());
    }

    #[test]
    fn the_timer_has_fifteen_bits() {
        let mut bench = Bench::started();
        bench.world.board.memory.write_x(0, 0xFF_FFFE);
        bench.run(1);
        assert_eq!(bench.read(0x0026), 0x7FFF);
        bench.run(1);
        assert_eq!(bench.read(0x0026), 0);
    }

    #[test]
    fn tagged_updates_carry_their_number_everywhere_and_only_for_i59_motors() {
        let mut bench = Bench::started();
        bench.set(59, 3.0);
        bench.world.report.tag = true;
        bench.world.report.updates = 0xFF_FFF0;
        bench.run(5);
        // 0xFFFFF5 is negative as a 24-bit word: sign-extended.
        for motor in 0..3 {
            for register in (0x0048..0x007C).step_by(4) {
                assert_eq!(bench.read32(register + 0x3C * motor), 0xFFFF_FFF5);
            }
        }
        assert_eq!(bench.read32(0x0028), 0xFFFF_FFF5);
        assert_eq!(bench.read32(0x0048 + 0x3C * 3), 0);
    }

    #[test]
    fn a_stuck_busy_bit_stays_until_the_fault_is_gone() {
        let mut bench = Bench::started();
        bench.run(4);
        bench.world.board.faults.servo_busy_stuck = true;
        bench.run(10);
        assert_eq!(bench.read(0x0026), 0x8004);
        bench.world.board.faults.servo_busy_stuck = false;
        bench.run(1);
        assert_eq!(bench.read(0x0026), 15);
    }
}
