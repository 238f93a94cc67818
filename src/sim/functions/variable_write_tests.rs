//! The background variable write against the rules of the manual, pp. 24-25.

use crate::format::{float48, write48};
use crate::sim::testing::{Bench, d, l};

const COUNT: u32 = 0x07D4;
const START: u32 = 0x07D6;
/// $D300.
const RECORDS: u32 = 0x0C00;

fn bench() -> Bench {
    let mut bench = Bench::bare("1.16D");
    bench.set(55, 1.0);
    bench
}

/// Puts records (address, type word, data 1, data 2) at $D300 and sets the count.
fn ask(bench: &Bench, records: &[(u16, u16, u32, u32)]) {
    bench.write(START, 0xD300);
    for (index, &(address, kind, data1, data2)) in records.iter().enumerate() {
        let words = [address, kind, data1 as u16, (data1 >> 16) as u16, data2 as u16, (data2 >> 16) as u16];
        for (word, value) in words.into_iter().enumerate() {
            bench.write(RECORDS + 12 * index as u32 + 2 * word as u32, value);
        }
    }
    bench.write(COUNT, records.len() as u16);
}

fn write(bench: &mut Bench, records: &[(u16, u16, u32, u32)]) {
    ask(bench, records);
    bench.run(2);
    assert_eq!(bench.read(COUNT), 0);
}

#[test]
fn every_width_at_every_offset_leaves_the_other_bits_alone() {
    for (space, width) in [0u16, 2].into_iter().flat_map(|x| [1u16, 4, 8, 12, 16, 20].map(|w| (x, w))) {
        for offset in 0..=24 - width {
            for (old, new) in [(0u32, u32::MAX), (0xFF_FFFF, 0), (0xA5_5AC3, 0x5A_A53C)] {
                let mut bench = bench();
                bench.world.board.memory.write_x(0x2000, old);
                bench.world.board.memory.write_y(0x2000, old);
                write(&mut bench, &[(0x2000, space | width << 3 | offset << 8, new, u32::MAX)]);
                let memory = &bench.world.board.memory;
                let mask = ((1 << width) - 1) << offset;
                let expected = old & !mask | new << offset & mask;
                let [target, other] = if space == 2 {
                    [memory.read_x(0x2000), memory.read_y(0x2000)]
                } else {
                    [memory.read_y(0x2000), memory.read_x(0x2000)]
                };
                assert_eq!((target, other), (expected, old), "type {space} width {width} offset {offset}");
                assert!(bench.violations().is_empty(), "{:?}", bench.violations());
            }
        }
    }
}

#[test]
fn whole_words_and_longs_packed_32_and_16() {
    let mut bench = bench();
    let [y, x] = float48::encode(-3.25);
    let [data1, data2] = write48::pack([y, x]);
    write(
        &mut bench,
        &[
            (0x2000, 0, 0xFF80_0001, 0),
            (0x2000, 2, 0x0012_3456, 0),
            (0x2001, 1, data1, data2),
            (0x2002, 1, 0xBC12_3456, 0x0000_789A),
            // Width and offset mean nothing for a long one.
            (0x2003, 1 | 4 << 3 | 5 << 8, 0xFFFF_FFFF, 0xFFFF_FFFF),
        ],
    );
    let memory = &bench.world.board.memory;
    assert_eq!((memory.read_y(0x2000), memory.read_x(0x2000)), (0x80_0001, 0x12_3456));
    assert_eq!(memory.read_l(l(0x2001)), -3.25);
    assert_eq!((memory.read_y(0x2002), memory.read_x(0x2002)), (0x12_3456, 0x78_9ABC));
    assert_eq!(memory.read_d(d(0x2003)), -1);
    assert!(bench.violations().is_empty(), "{:?}", bench.violations());
}

#[test]
fn the_manuals_p_variable_is_written_without_a_command() {
    let mut bench = bench();
    let [data1, data2] = write48::pack(float48::encode(98.5));
    write(&mut bench, &[(0x1000 + 7, 1, data1, data2)]);
    let reply = bench.world.execute(b"P7");
    assert_eq!(reply.lines, ["98.5"]);
}

#[test]
fn thirty_two_records_at_once_and_function_blocks() {
    let mut bench = bench();
    bench.world.board.memory.write_y(0x9FFF, 0x3000);
    let mut records: Vec<_> = (0..30u16).map(|n| (0x2000 + n, 0, u32::from(n), 0)).collect();
    records.extend([(0, 4, 11, 0), (5, 6, 22, 0)]);
    write(&mut bench, &records);
    let memory = &bench.world.board.memory;
    assert!((0..30).all(|n| memory.read_y(0x2000 + n) == n));
    assert_eq!((memory.read_y(0x3000), memory.read_x(0x3005)), (11, 22), "block 0 is not the servo clock");
    assert!(bench.violations().is_empty(), "{:?}", bench.violations());
}

#[test]
fn nothing_is_written_without_i55_or_beyond_the_rules() {
    let mut bench = bench();
    bench.set(55, 0.0);
    ask(&bench, &[(0x2000, 0, 5, 0)]);
    bench.run(5);
    assert_eq!((bench.read(COUNT), bench.world.board.memory.read_y(0x2000)), (1, 0));
    bench.set(55, 1.0);
    for (count, start) in [(33, 0xD300), (1, 0xD1FF), (1, 0xE000), (2, 0xDFFB), (1, 0xDFFE)] {
        bench.write(START, start);
        bench.write(COUNT, count);
        let before = bench.violations().len();
        bench.run(5);
        assert_eq!((bench.read(COUNT), bench.violations().len()), (count, before + 1), "{count} {start:#x}");
    }
    bench.write(COUNT, 0);
    bench.run(1);
    for word in 0..6 {
        bench.write(0x3FF4 + 2 * word, [0x2000, 0, 5, 0, 0, 0][word as usize]);
    }
    bench.write(START, 0xDFFD);
    bench.write(COUNT, 1);
    bench.run(2);
    assert_eq!((bench.read(COUNT), bench.world.board.memory.read_y(0x2000)), (0, 5));
}

#[test]
fn records_outside_the_table_are_recorded() {
    let mut bench = bench();
    let cases = [
        (5 << 3, 0x1F),
        (8 << 3 | 20 << 8, 0xF0_0000),
        (24 << 8, 0),
        (3, 0),
        (1 << 13, 0),
        (20 << 3 | 5 << 8, 0xFF_FFE0),
    ];
    for (kind, expected) in cases {
        let before = bench.violations().len();
        bench.world.board.memory.write_y(0x2000, 0);
        write(&mut bench, &[(0x2000, kind, u32::MAX, 0)]);
        assert_eq!(bench.world.board.memory.read_y(0x2000), expected, "{kind:#x}");
        assert_eq!(bench.violations().len(), before + 1, "{kind:#x}");
    }
}

#[test]
fn address_zero_trips_the_watchdog_until_a_reset() {
    for kind in [0, 1, 2] {
        let mut bench = bench();
        bench.run(10);
        ask(&bench, &[(0x2000, 0, 1, 0), (0, kind, 5, 0), (0x2001, 0, 1, 0)]);
        bench.run(10);
        let board = &bench.world.board;
        assert!(board.watchdog);
        assert_eq!((board.memory.read_y(0x2000), board.memory.read_y(0x2001)), (1, 0));
        assert_eq!((bench.read(COUNT), board.stats.servo_cycles), (3, 12), "dead");
        assert_eq!(bench.violations().len(), 1, "{:?}", bench.violations());
        bench.set(58, 1.0);
        bench.write_text("P1");
        bench.write(0x062C, 1);
        bench.run(20);
        assert_eq!((bench.read(0x062C), bench.read(0x06D0)), (1, 0), "nobody answers");
        bench.world.reset();
        bench.run(3);
        assert_eq!((bench.read(COUNT), bench.world.board.memory.read_x(0)), (0, 3), "{kind}");
    }
}

#[test]
fn a_change_after_the_count_and_an_overlap_are_recorded() {
    let mut bench = bench();
    ask(&bench, &[(0x2000, 0, 1, 0)]);
    bench.run(1);
    bench.write(RECORDS + 4, 9);
    bench.run(1);
    assert_eq!(bench.violations().len(), 1, "{:?}", bench.violations());
    bench.set(45, 3.0);
    bench.world.board.define_gather(Some(500), 0).unwrap();
    ask(&bench, &[(0x2000, 0, 1, 0)]);
    bench.run(3);
    assert_eq!(bench.violations().len(), 2, "{:?}", bench.violations());
}

#[test]
fn faults_hold_delay_and_tear() {
    let mut bench = bench();
    bench.world.board.faults.variable_write.stuck = true;
    ask(&bench, &[(0x2000, 0, 1, 0), (0x2001, 0, 2, 0)]);
    bench.run(50);
    assert_eq!((bench.read(COUNT), bench.world.board.memory.read_y(0x2000)), (2, 0));
    bench.world.board.faults.variable_write.stuck = false;
    bench.world.board.faults.variable_write.late = 2;
    bench.run(2);
    assert_eq!(bench.read(COUNT), 2);
    bench.world.board.faults.variable_write.torn = true;
    bench.run(1);
    let both = |bench: &Bench| [0x2000, 0x2001].map(|address| bench.world.board.memory.read_y(address));
    assert_eq!((bench.read(COUNT), both(&bench)), (0, [1, 0]));
    bench.run(1);
    assert_eq!(both(&bench), [1, 2]);
}
