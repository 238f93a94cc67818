//! A family that no program offers yet, on the board as it is: Turbo PMAC2's DPRAM of 64 KiB with 32 motors, addresses
//! of 19 bits, masks and 24-bit timers. Registers are test data.

use crate::map::{PmacAddress, Space, TURBO2};
use crate::sim::board::firmware::{Controller, DpramHandshake, FirmwareTables};
use crate::sim::board::i_rows;
use crate::sim::board::register_table::{self, Each, RegisterTable};
use crate::sim::testing::Bench;

const fn motor(space: Space, number: u32) -> Each {
    Each::new(TURBO2.motor_source_stride, PmacAddress::new(space, number))
}

const fn system(space: Space, number: u32) -> Each {
    Each::new(TURBO2.system_source_stride, PmacAddress::new(space, number))
}

static TABLES: FirmwareTables = FirmwareTables {
    family: &TURBO2,
    variables: 8192,
    p_address: 0x6000,
    q_addresses: &[0x8000; 16],
    i_rows: &[i_rows::GLOBAL, i_rows::MOTOR, i_rows::COORDINATE, i_rows::PMAC2],
    registers: RegisterTable {
        conversion_table: PmacAddress::new(Space::Y, 0x3501),
        machine_inputs: PmacAddress::new(Space::Y, 0x7_8402),
        end: 0x4000,
        time_left: motor(Space::X, 0xA0),
        desired_velocity: motor(Space::X, 0x86),
        commanded: motor(Space::D, 0x88),
        feedback_address: motor(Space::X, 0x89),
        master_address: motor(Space::X, 0x8A),
        actual: motor(Space::D, 0x8B),
        velocity: motor(Space::X, 0x9D),
        dac: motor(Space::X, 0xBF),
        servo_status: motor(Space::X, 0xB0),
        compensation: motor(Space::D, 0x90),
        target: motor(Space::D, 0xC7),
        bias: motor(Space::D, 0xCC),
        background_status: motor(Space::Y, 0xC0),
        home_capture: motor(Space::Y, 0xCE),
        average_velocity: motor(Space::X, 0xEF),
        jog_variable: motor(Space::L, 0xD7),
        time_base_commanded: system(Space::X, 0x2000),
        time_base_present: system(Space::X, 0x2001),
        program_status: system(Space::Y, 0x203F),
        coordinate_status: system(Space::X, 0x2040),
        coordinate_motors: system(Space::Y, 0x2040),
        axis_targets: system(Space::L, 0x2041),
        segmented_axis_targets: system(Space::L, 0x204A),
        lines_remaining: system(Space::Y, 0x2053),
        ..register_table::pmac(&TURBO2)
    },
    decimals: 10,
    dpram_handshake: DpramHandshake::Untouched,
    controller: Controller::Pmac2,
    type_text: "TURBO2, X4",
    startup: "",
};

fn bench() -> Bench {
    Bench::of(&TABLES, "1.947")
}

fn send(bench: &mut Bench, line: &str) -> Vec<String> {
    let reply = bench.world.execute(line.as_bytes());
    assert_eq!(reply.error, None, "{line}");
    reply.lines
}

#[test]
fn the_servo_report_has_the_masked_motors_and_a_timer_of_24_bits() {
    let mut bench = bench();
    send(&mut bench, "I3200=1 #32J/");
    send(&mut bench, "#32J=1000");
    bench.run(5000);
    assert_eq!(send(&mut bench, "#32P"), ["1000"]);
    for (number, value) in [(47, 1.0), (48, 1.0)] {
        bench.set(number, value);
    }
    bench.world.board.memory.write_x(0, 0x12_FFFE);
    // Motors 2 and 32; bit 15 of 0x006E is set when the data are whole.
    bench.write(0x0070, 0b10);
    bench.write(0x0072, 0x8000);
    send(&mut bench, "GATHER");
    bench.run(2);
    assert_eq!([bench.read(0x006C), bench.read(0x006E)], [0x0000, 0x8013]);
    let position = |motor: u32| bench.read32(0x0074 + 0x30 * (motor - 1) + 40);
    assert_eq!((position(2), position(32)), (0, 1000 * 3072));
    bench.write(0x006A, 1 << 15);
    bench.run(3);
    assert_eq!((bench.read(0x006C), bench.world.report.skipped), (0, 3));
    bench.write(0x006A, 0);
    bench.world.board.faults.servo_busy_stuck = true;
    bench.run(1);
    assert_eq!(bench.read(0x006E), 0x0013, "not ready while PMAC writes");
    assert!(bench.violations().is_empty(), "{:?}", bench.violations());
}

#[test]
fn addresses_have_19_bits_and_the_dpram_64_kib() {
    let mut bench = bench();
    send(&mut bench, "WX$63FFF,$1234");
    assert_eq!(bench.read(0xFFFE), 0x1234);
    send(&mut bench, "WY$7FFFF,$ABCDEF");
    assert_eq!(send(&mut bench, "RHY$7FFFF"), ["ABCDEF"]);
    assert!(bench.world.execute(b"RX$80000").error.is_some());
    send(&mut bench, "M1->DP:$60450");
    send(&mut bench, "M1=-2");
    assert_eq!(bench.read32(0x1140), 0xFFFF_FFFE);
}

#[test]
fn the_background_report_obeys_its_own_count_and_busy_flag() {
    let mut bench = bench();
    bench.set(49, 1.0);
    bench.run(2);
    assert_eq!(bench.read(0x067A), 0, "no coordinate system is asked for");
    bench.write(0x0674, 16);
    bench.write(0x0676, 1 << 15);
    bench.run(2);
    assert_eq!(bench.read(0x067A), 0, "the host is busy");
    bench.write(0x0676, 0);
    bench.world.board.memory.write_x(0, 0x45_6788);
    bench.run(1);
    assert_eq!([bench.read(0x0678), bench.read(0x067A)], [0x6789, 0x8045]);
}

#[test]
fn lines_go_through_the_ascii_port() {
    let mut bench = bench();
    bench.set(58, 1.0);
    bench.set(3, 2.0);
    for (at, byte) in [(0x0EA0, u16::from_le_bytes(*b"#3")), (0x0EA2, u16::from(b'P'))] {
        bench.write(at, byte);
    }
    bench.write(0x0E9C, 1);
    bench.run(3);
    let [control, count, text] = [0x0F40, 0x0F42, 0x0F44].map(|at| bench.read(at));
    assert_eq!((control, count, text), (0x000D, 2, u16::from(b'0')));
    bench.write(0x0F40, 0);
    bench.run(1);
    assert_eq!(bench.read(0x0F40), 0x0006);
    assert!(bench.violations().is_empty(), "{:?}", bench.violations());
}

#[test]
fn variables_are_read_and_written_by_offset_and_19_bits() {
    let mut bench = bench();
    bench.set(55, 1.0);
    send(&mut bench, "WX$78205,$7FFFFE");
    // One record at 0x1140 + 4 * $40: X (kind 2), all 24 bits, to X:$78206.
    let record = [0x8206, 2 << 4 | 0x7, 0x1234, 0x0056, 0, 0];
    for (value, word) in record.into_iter().zip(0..) {
        bench.write(0x1240 + 2 * word, value);
    }
    bench.write(0x104E, 0x40);
    bench.write(0x104C, 1);
    // Two entries at 0x1140: X:$78205 and X:$78206.
    for (address, at) in [(0x8205, 0x1140), (0x8206, 0x1144)] {
        bench.write(at, address);
        bench.write(at + 2, 2 << 4 | 0x7);
    }
    bench.write(0x104A, 0);
    bench.write(0x1048, 2);
    bench.run(3);
    assert_eq!((bench.read(0x104C), bench.read(0x1044)), (0, 1));
    assert_eq!(bench.read32(0x1148), 0x7F_FFFE);
    bench.write(0x1044, 0);
    bench.run(1);
    assert_eq!(bench.read32(0x114C), 0x56_1234);
    assert!(bench.violations().is_empty(), "{:?}", bench.violations());
}

#[test]
fn each_of_sixteen_rotary_buffers_is_watched() {
    let mut bench = bench();
    // Buffer 16, a size that is odd.
    bench.write(0x1050 + 12 * 15 + 8, 7);
    bench.run(1);
    assert_eq!(bench.read(0x1050 + 12 * 15), 0x8003);
    assert!(bench.violations()[0].contains("rotary buffer 16: its size is 7"), "{:?}", bench.violations());
}

#[test]
fn gathering_takes_sources_of_both_masks() {
    let mut bench = bench();
    for (number, value) in [(5000, 2.0), (5049, 1.0), (5050, 1.0), (5051, f64::from(1 << 23))] {
        bench.set(number, value);
    }
    // Source 1 is Y:$78001, source 48 is X:$78002.
    bench.set(5001, f64::from(0x07_8001));
    bench.set(5048, f64::from(0x47_8002));
    send(&mut bench, "WY$78001,5 WX$78002,6");
    send(&mut bench, "DELETE GATHER");
    send(&mut bench, "DEFINE GATHER 4");
    send(&mut bench, "GATHER");
    bench.run(1);
    assert_eq!([bench.read32(0x1140), bench.read32(0x1144)], [5, 6]);
    assert_eq!([bench.read(0x113C), bench.read(0x113E)], [4, 2]);
}
