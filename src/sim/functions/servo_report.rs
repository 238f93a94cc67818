//! PMAC's half of the servo fixed data buffer (DPRAM manual p. 14).
//!
//! Every I19 servo cycles, when Host-Busy is clear: set bit 15 of 0x0026, copy the registers of motors 1 to I59, store
//! the timer, clear bit 15. Host-Busy is tested before bit 15 is set, as the manual says, so a host that sets it in
//! between meets a running update.
//!
//! With tags on, every 24-bit half of every copied register carries the number of the update (modulo 2^24) instead of
//! the register's content: a reader that finds two numbers in one copy has read across two updates.
//!
//! With times on, motor 1's compensation position is CLOCK_MONOTONIC in ns at the update (modulo 2^48): what a reader's own clock is
//! later when it has the data is how long they took.

use nix::time::{ClockId, clock_gettime};

use crate::format::int24;
use crate::map::classic::{HOST_BUSY, PMAC_BUSY, SERVO_TIMER_MASK};
use crate::sim::board::gather::{Activity, Gather};
use crate::sim::board::memory::Memory;
use crate::sim::board::offsets;
use crate::sim::board::variables::Variables;
use crate::sim::fault::Faults;

/// One long word of the report: where it comes from and where it goes.
#[derive(Debug, Clone, Copy)]
struct Copy {
    x: bool,
    source: u16,
    offset: u16,
}

/// The registers of one motor: source, whether it is a long (`D:`) one, and offset in the motor's block.
const REGISTERS: [(u16, bool, u16); 9] = [
    (offsets::COMMANDED, true, 0x00),
    (offsets::ACTUAL, true, 0x08),
    (offsets::MASTER, true, 0x10),
    (offsets::COMPENSATION, true, COMPENSATION_PLACE),
    (offsets::DAC, false, 0x20),
    (offsets::SERVO_STATUS, false, 0x24),
    (offsets::VELOCITY, false, 0x28),
    (offsets::TIME_LEFT, false, 0x2C),
    (offsets::FEEDBACK_ADDRESS, false, 0x30),
];

/// The compensation position's offset in the motor's block.
const COMPENSATION_PLACE: u16 = 0x18;

/// Long words copied for one motor.
const PER_MOTOR: usize = 13;

/// The report's state.
#[derive(Debug, Clone)]
pub struct ServoReport {
    copies: Vec<Copy>,
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

impl Default for ServoReport {
    fn default() -> Self {
        let mut copies = Vec::with_capacity(8 * PER_MOTOR);
        for motor in 0..8 {
            let block = offsets::SERVO_MOTOR + offsets::SERVO_MOTOR_LENGTH * motor as u16;
            for (register, long, place) in REGISTERS {
                let source = offsets::motor(register, motor);
                if long {
                    copies.push(Copy { x: false, source, offset: block + place });
                    copies.push(Copy { x: true, source, offset: block + place + 4 });
                } else {
                    copies.push(Copy { x: true, source, offset: block + place });
                }
            }
        }
        Self { copies, wait: 0, tag: false, time: false, updates: 0, skipped: 0 }
    }
}

impl ServoReport {
    /// After a reset the next update is due at once. The counts go on.
    pub fn reset(&mut self) {
        self.wait = 0;
    }

    /// One servo cycle.
    pub fn cycle(&mut self, variables: &Variables, gather: &Gather, faults: &Faults, memory: &mut Memory) {
        let period = variables.i(19) as u32;
        let motors = (variables.i(59) as usize).min(8);
        let enabled = variables.i(48) == 1.0 && period > 0 && motors > 0;
        if !enabled || !gather.runs(Activity::ServoReport) || faults.servo_silent {
            self.wait = 0;
            return;
        }
        if self.wait > 0 {
            self.wait = self.wait.min(period) - 1;
            if self.wait > 0 {
                return;
            }
        }
        self.wait = period;
        if memory.dpram.read16(offsets::SERVO_HOST_STATUS) & HOST_BUSY != 0 {
            self.skipped += 1;
            return;
        }
        let busy = memory.dpram.shadow(offsets::SERVO_PMAC_STATUS) | PMAC_BUSY;
        memory.dpram.write16(offsets::SERVO_PMAC_STATUS, busy);
        if faults.servo_busy_stuck {
            return;
        }
        memory.dpram.order_writes();
        self.updates += 1;
        self.copy(motors, memory);
        if self.time {
            Self::stamp(memory);
        }
        memory.dpram.order_writes();
        let timer = memory.read_x(offsets::SERVO_COUNTER) as u16 & SERVO_TIMER_MASK;
        memory.dpram.write16(offsets::SERVO_PMAC_STATUS, timer | PMAC_BUSY);
        memory.dpram.write16(offsets::SERVO_PMAC_STATUS, timer);
    }

    fn stamp(memory: &mut Memory) {
        let now = clock_gettime(ClockId::CLOCK_MONOTONIC)
            .map_or(0, |now| now.tv_sec().cast_unsigned() * 1_000_000_000 + now.tv_nsec().cast_unsigned());
        for (half, place) in [(now, 0), (now >> 24, 4)] {
            let offset = offsets::SERVO_MOTOR + COMPENSATION_PLACE + place;
            memory.dpram.write32(offset, int24::extend(half as u32 & int24::MASK));
        }
    }

    fn copy(&self, motors: usize, memory: &mut Memory) {
        let tag = self.tag.then_some(self.updates as u32 & int24::MASK);
        let y = tag.unwrap_or_else(|| memory.read_y(offsets::GLOBAL_STATUS));
        memory.dpram.write32(offsets::SERVO_GLOBAL_Y, int24::extend(y));
        let x = tag.unwrap_or_else(|| memory.read_x(offsets::GLOBAL_STATUS));
        memory.dpram.write32(offsets::SERVO_GLOBAL_X, int24::extend(x));
        for copy in &self.copies[..motors * PER_MOTOR] {
            let word = match tag {
                Some(tag) => tag,
                None if copy.x => memory.read_x(copy.source),
                None => memory.read_y(copy.source),
            };
            memory.dpram.write32(copy.offset, int24::extend(word));
        }
    }
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
