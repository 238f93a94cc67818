//! PMAC's half of the background fixed data buffer (DPRAM manual pp. 17-21).
//!
//! Each background pass, with I49=1 and I59>0 and Data-Ready clear: copy the registers of motors and coordinate
//! systems 1 to I59, store the 16-bit servo timer, set Data-Ready.

use crate::format::int24;
use crate::map::classic::DATA_READY;
use crate::sim::board::memory::Memory;
use crate::sim::board::offsets;
use crate::sim::board::variables::Variables;
use crate::sim::fault::Faults;

/// Axes in the report: A B C U V W X Y Z.
const AXES: u16 = 9;

/// Bits of PSTATUS that choose an axis position's source (manual p. 21, note 1).
const SEGMENTED: u32 = 1 << 7;
const SEGMENTED_STOP: u32 = 1 << 5;
const COMPENSATED: u32 = 1 << 9;

/// Makes the report when it is due; says whether it did.
///
/// `programs` has time left in acceleration and execution address offset of each coordinate system.
pub fn poll(variables: &Variables, faults: &Faults, programs: &[[u32; 2]], memory: &mut Memory) -> bool {
    let count = (variables.i(59) as usize).min(8);
    if variables.i(49) != 1.0 || count == 0 || faults.background_stuck {
        return false;
    }
    let ready = memory.dpram.read16(offsets::BACKGROUND_READY);
    if ready & DATA_READY != 0 {
        return false;
    }
    for port in 0..3 {
        let word = memory.read_y(offsets::PORTS + port);
        memory.dpram.write32(offsets::BACKGROUND_PORTS + 4 * port, int24::extend(word));
    }
    for index in 0..count {
        copy(index, programs.get(index).copied().unwrap_or_default(), memory);
    }
    let timer = memory.read_x(offsets::SERVO_COUNTER) as u16;
    memory.dpram.write16(offsets::BACKGROUND_TIMER, timer);
    memory.dpram.order_writes();
    memory.dpram.write16(offsets::BACKGROUND_READY, ready | DATA_READY);
    true
}

fn copy(index: usize, [ramp_left, program_offset]: [u32; 2], memory: &mut Memory) {
    let block = offsets::BACKGROUND_MOTOR + offsets::BACKGROUND_MOTOR_LENGTH * index as u16;
    let register = |register| offsets::background(register, index);
    let status = memory.read_y(register(offsets::PROGRAM_STATUS));
    let axes = if status & SEGMENTED != 0 && status & SEGMENTED_STOP == 0 {
        offsets::AXIS_TARGET_A
    } else if status & COMPENSATED != 0 {
        offsets::AXIS_TARGET_B
    } else {
        offsets::AXIS_TARGET_C
    };
    long(memory, register(offsets::TARGET), block);
    long(memory, register(offsets::BIAS), block + 0x08);
    let word = memory.read_y(register(offsets::BACKGROUND_STATUS));
    short(memory, word, block + 0x10);
    long(memory, register(offsets::COORDINATE_STATUS), block + 0x14);
    for axis in 0..AXES {
        long(memory, register(axes) + axis, block + 0x1C + 8 * axis);
    }
    short(memory, status, block + 0x64);
    let lines = memory.read_y(register(offsets::LINES_REMAINING));
    short(memory, lines, block + 0x68);
    let time_left = memory.read_x(offsets::motor(offsets::TIME_LEFT, index));
    short(memory, time_left, block + 0x6C);
    // These two have no documented source register.
    short(memory, ramp_left, block + 0x70);
    short(memory, program_offset, block + 0x74);
    let average = memory.read_y(register(offsets::AVERAGE_VELOCITY));
    short(memory, average, block + 0x78);
}

fn long(memory: &mut Memory, source: u16, offset: u16) {
    let y = memory.read_y(source);
    memory.dpram.write32(offset, int24::extend(y));
    let x = memory.read_x(source);
    memory.dpram.write32(offset + 4, int24::extend(x));
}

fn short(memory: &mut Memory, word: u32, offset: u16) {
    memory.dpram.write32(offset, int24::extend(word));
}

#[cfg(test)]
mod tests {
    use crate::format::float48;
    use crate::sim::testing::Bench;

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
            memory.write_l(0x093C, 1.0);
            memory.write_l(0x095C, 2.0);
            memory.write_l(0x08DF, 3.0);
            memory.write_y(0x08D7, status);
            bench.run(1);
            let found = float48::decode(bench.read32(0x0314), bench.read32(0x0318));
            assert_eq!(found, expected, "{status:#x}");
        }
    }
}
