//! The background variable read against the rules of the manual, pp. 21-24.

use crate::sim::testing::{Bench, d};

const CONTROL: u32 = 0x07E8;
const TIMER: u32 = 0x07EA;
const COUNT: u32 = 0x07EC;
const START: u32 = 0x07EE;
/// $D400.
const TABLE: u32 = 0x1000;

/// Entries at $D400; control, count last.
fn set_up(bench: &Bench, control: u16, entries: &[(u16, u16)]) {
    bench.write(COUNT, 0);
    bench.write(START, 0xD400);
    for (index, &(address, kind)) in entries.iter().enumerate() {
        bench.write(TABLE + 4 * index as u32, address);
        bench.write(TABLE + 4 * index as u32 + 2, kind);
    }
    bench.write(CONTROL, control);
    bench.write(COUNT, entries.len() as u16);
}

fn bench() -> Bench {
    let mut bench = Bench::bare("1.16D");
    bench.set(55, 1.0);
    let memory = &mut bench.world.board.memory;
    memory.write_y(0x2000, 0x80_0001);
    memory.write_x(0x2000, 0x12_3456);
    memory.write_y(0x2001, 0xFF_FFFE);
    memory.write_x(0x2001, 0x80_0000);
    bench
}

#[test]
fn registers_of_every_type_lie_right_behind_the_table() {
    let mut bench = bench();
    bench.world.board.memory.write_y(0x9FFF, 0x3000);
    bench.world.board.memory.write_d(d(0x3002), -5);
    set_up(&bench, 0, &[(0x2000, 0), (0x2001, 1), (0x2000, 2), (2, 4), (0x2001, 0)]);
    bench.run(1);
    let data: Vec<u32> = (0..7).map(|long| bench.read32(TABLE + 20 + 4 * long)).collect();
    let expected =
        [0xFF80_0001, 0xFFFF_FFFE, 0xFF80_0000, 0x0012_3456, 0xFFFF_FFFB, 0xFFFF_FFFF, 0xFFFF_FFFE];
    assert_eq!(data, expected);
    assert_eq!((bench.read(CONTROL), bench.read(TIMER)), (1, 1));
    assert!(bench.violations().is_empty(), "{:?}", bench.violations());
}

#[test]
fn single_user_data_stand_still_until_the_host_clears_the_ready_bit() {
    let mut bench = bench();
    set_up(&bench, 0, &[(0, 2)]);
    bench.run(10);
    assert_eq!((bench.read32(TABLE + 4), bench.read(TIMER)), (1, 1));
    bench.write(CONTROL, 0);
    bench.world.board.memory.write_x(0, 0x81_2344);
    bench.run(1);
    assert_eq!((bench.read32(TABLE + 4), bench.read(TIMER), bench.read(CONTROL)), (0xFF81_2345, 0x2345, 1));
    assert!(bench.violations().is_empty());
}

#[test]
fn multi_user_entries_go_one_by_one_and_the_timer_every_pass() {
    let mut bench = bench();
    set_up(&bench, 256, &[(0, 2), (0x2001, 1), (0, 2)]);
    bench.run(4);
    let flags = |bench: &Bench| [0, 1, 2].map(|entry| bench.read(TABLE + 4 * entry + 2));
    assert_eq!(flags(&bench), [0x8002, 0x8001, 0x8002]);
    let data = |bench: &Bench| [0, 4, 8, 12].map(|at| bench.read32(TABLE + 12 + at));
    assert_eq!(data(&bench), [1, 0xFFFF_FFFE, 0xFF80_0000, 1]);
    assert_eq!((bench.read(CONTROL), bench.read(TIMER)), (256, 4), "the control word is never modified");
    bench.write(TABLE + 10, 2);
    bench.run(1);
    assert_eq!((flags(&bench), data(&bench)), ([0x8002, 0x8001, 0x8002], [1, 0xFFFF_FFFE, 0xFF80_0000, 5]));
    bench.run(3);
    assert_eq!(bench.read(TIMER), 8);
    assert!(bench.violations().is_empty());
}

#[test]
fn the_host_can_replace_an_entry_that_is_ready() {
    let mut bench = bench();
    set_up(&bench, 256, &[(0, 2), (0x2000, 0)]);
    bench.run(2);
    bench.write(TABLE, 0x2000);
    bench.write(TABLE + 2, 2);
    bench.run(1);
    assert_eq!(bench.read32(TABLE + 8), 0x12_3456);
    assert!(bench.violations().is_empty(), "{:?}", bench.violations());
}

#[test]
fn i55_or_a_count_of_zero_stop_it() {
    let mut bench = bench();
    set_up(&bench, 0, &[(0, 2)]);
    bench.set(55, 0.0);
    bench.run(3);
    assert_eq!(bench.read(CONTROL), 0);
    bench.set(55, 1.0);
    bench.write(COUNT, 0);
    bench.run(3);
    assert_eq!(bench.read(CONTROL), 0);
    bench.write(COUNT, 1);
    bench.run(1);
    assert_eq!(bench.read(CONTROL), 1);
}

#[test]
fn headers_against_the_rules_are_not_acted_on_and_recorded_once() {
    let cases = [(129, 0xD400), (1, 0xD1FF), (1, 0xE000), (2, 0xDFFE), (1, 0xDFFF)];
    for (count, start) in cases {
        let mut bench = bench();
        bench.write(START, start);
        bench.write(COUNT, count);
        bench.run(5);
        assert_eq!(bench.read(CONTROL), 0, "{count} at {start:#x}");
        assert_eq!(bench.violations().len(), 1, "{:?}", bench.violations());
    }
    let mut bench = bench();
    bench.write(START, 0xDFFE);
    bench.write(COUNT, 1);
    bench.run(1);
    assert_eq!(bench.read(CONTROL), 1, "one entry and its datum fill the DPRAM to its end");
}

#[test]
fn a_host_that_writes_into_pmacs_half_is_recorded() {
    let mut bench = bench();
    set_up(&bench, 0, &[(0, 2), (0x2001, 1)]);
    bench.run(2);
    bench.write(TABLE + 8, 77);
    bench.write(TIMER, 77);
    bench.run(1);
    assert_eq!(bench.violations().len(), 2, "{:?}", bench.violations());
    bench.world.board.faults.variable_read.stuck = true;
    bench.write(CONTROL, 0);
    bench.run(2);
    bench.write(CONTROL, 1);
    bench.run(2);
    assert_eq!(bench.violations().len(), 3, "{:?}", bench.violations());
    set_up(&bench, 0, &[(0, 3)]);
    bench.run(2);
    assert_eq!(bench.violations().len(), 4, "{:?}", bench.violations());
}

#[test]
fn a_table_in_the_gather_buffer_is_recorded() {
    let mut bench = bench();
    bench.set(45, 3.0);
    bench.world.board.define_gather(Some(1000), 0).unwrap();
    set_up(&bench, 0, &[(0, 2)]);
    bench.run(5);
    assert_eq!(bench.violations().len(), 1, "{:?}", bench.violations());
    assert!(bench.violations()[0].contains("overlap"));
    bench.world.board.define_gather(Some(100), 0).unwrap();
    bench.run(5);
    assert_eq!(bench.violations().len(), 1);
}

#[test]
fn faults_hold_delay_and_tear() {
    let mut bench = bench();
    bench.world.board.faults.variable_read.stuck = true;
    set_up(&bench, 0, &[(0, 2), (0x2000, 2)]);
    bench.run(50);
    assert_eq!(bench.read(CONTROL), 0);
    bench.world.board.faults.variable_read.stuck = false;
    bench.world.board.faults.variable_read.late = 3;
    bench.run(3);
    assert_eq!(bench.read(CONTROL), 0);
    bench.world.board.faults.variable_read.torn = true;
    bench.run(1);
    assert_eq!((bench.read(CONTROL), bench.read32(TABLE + 8), bench.read32(TABLE + 12)), (1, 54, 0));
    bench.run(1);
    assert_eq!((bench.read32(TABLE + 8), bench.read32(TABLE + 12)), (54, 0x12_3456));
    assert!(bench.violations().is_empty());
}
