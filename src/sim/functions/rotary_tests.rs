//! The binary rotary transfer against the rules of the manual, p. 30.

use crate::sim::program::binary::{self, Command};
use crate::sim::program::store::Open;
use crate::sim::testing::Bench;

const FIRST: u32 = 0x07F0;
const SECOND: u32 = 0x07DC;
const BUSY: u16 = 1 << 14;
const ERROR: u16 = 1 << 15;

/// X10, X10 Y-3.25 and X10 Y20 F5 M3 as lines.
const ONE: &[Command] = &[(0x00_0E23, 0x50_0000)];
const TWO: &[Command] = &[(0x00_0E23, 0x50_0000), (0x00_0661, 0x98_0000)];
const FOUR: &[Command] =
    &[(0x00_0E23, 0x50_0000), (0x00_0664, 0x50_0000), (0x00_01A2, 0x50_0000), (0x00_0361, 0x60_0000)];

struct Host {
    header: u32,
    data: u32,
    size: u16,
    index: u16,
}

impl Host {
    /// A buffer of `size` words at PMAC address `start` for coordinate system `cs`; I57 comes last.
    fn new(bench: &mut Bench, header: u32, start: u16, size: u16, cs: u16) -> Self {
        for (word, value) in [(0, 0), (1, cs), (2, 0), (3, 0), (4, size), (5, start)] {
            bench.write(header + 2 * word, value);
        }
        bench.set(57, 1.0);
        Self { header, data: 4 * u32::from(start - 0xD000), size, index: 0 }
    }

    fn put(&self, bench: &Bench, index: u16, command: Command) {
        let at = self.data + 4 * u32::from(index % self.size);
        for (offset, word) in [(0, command.0), (4, command.1)] {
            bench.write(at + offset, word as u16);
            bench.write(at + offset + 2, (word >> 16) as u16);
        }
    }

    /// A line with the end marker behind it; then the index.
    fn send(&mut self, bench: &Bench, line: &[Command]) {
        let mut at = self.index;
        for &command in line {
            self.put(bench, at, command);
            at = (at + 2) % self.size;
        }
        self.put(bench, at, (0x800, 0xFFFF));
        self.index = at;
        bench.write(self.header + 4, at);
    }

    fn pmac_index(&self, bench: &Bench) -> u16 {
        bench.read(self.header + 6)
    }

    fn status(&self, bench: &Bench) -> u16 {
        bench.read(self.header)
    }
}

fn bench(room: usize) -> Bench {
    let mut bench = Bench::bare("1.16D");
    define(&mut bench, 0, room);
    bench
}

/// An internal buffer for `room` commands for the 0-based coordinate system.
fn define(bench: &mut Bench, cs: usize, room: usize) {
    let store = &mut bench.world.programs.store;
    store.close();
    // The highest coordinate system comes first.
    let size = |cs: usize| store.rotary(cs).map(|rotary| rotary.size);
    let mut sizes: Vec<_> = (0..8).map(|other| if other == cs { Some(room) } else { size(other) }).collect();
    for other in 0..8 {
        let _ = store.delete_rotary(other);
    }
    for (other, size) in sizes.drain(..).enumerate().rev().filter_map(|(other, size)| Some((other, size?))) {
        store.define_rotary(other, size, 1000).unwrap();
    }
    store.open_buffer(Open::Rotary).unwrap();
}

/// The oldest line of an internal buffer, which leaves it.
fn take(bench: &mut Bench, cs: usize) -> Option<Vec<Command>> {
    let rotary = bench.world.programs.store.rotary_mut(cs)?;
    let items = rotary.line(rotary.first())?.items.clone();
    rotary.free_before(rotary.first() + 1);
    let known =
        [ONE, TWO, FOUR].into_iter().find(|line| binary::line(line, binary::CODE2, 8) == Ok(items.clone()));
    Some(known.expect("a line of these").to_vec())
}

#[test]
fn lines_arrive_whole_and_in_order_and_the_index_follows() {
    let mut bench = bench(100);
    let mut host = Host::new(&mut bench, FIRST, 0xD300, 20, 1);
    host.send(&bench, TWO);
    host.send(&bench, ONE);
    bench.run(2);
    assert_eq!((host.pmac_index(&bench), host.status(&bench)), (6, 0));
    host.send(&bench, FOUR);
    bench.run(2);
    host.send(&bench, FOUR);
    bench.run(2);
    assert_eq!(host.pmac_index(&bench), 2, "round the end of the buffer");
    let taken: Vec<_> = std::iter::from_fn(|| take(&mut bench, 0)).collect();
    assert_eq!(taken, [TWO, ONE, FOUR, FOUR]);
    assert!(bench.violations().is_empty(), "{:?}", bench.violations());
}

#[test]
fn the_smallest_buffer_takes_one_command_a_line_for_ever() {
    let mut bench = bench(100);
    let mut host = Host::new(&mut bench, FIRST, 0xD300, 6, 1);
    for _ in 0..20 {
        host.send(&bench, ONE);
        bench.run(2);
        assert_eq!(host.pmac_index(&bench), host.index);
    }
    assert!(bench.violations().is_empty(), "{:?}", bench.violations());
}

#[test]
fn both_buffers_work_side_by_side_and_i57_enables_them() {
    let mut bench = bench(100);
    define(&mut bench, 7, 100);
    let mut first = Host::new(&mut bench, FIRST, 0xD300, 20, 1);
    let mut second = Host::new(&mut bench, SECOND, 0xD400, 30, 8);
    bench.set(57, 0.0);
    first.send(&bench, ONE);
    second.send(&bench, FOUR);
    bench.run(10);
    assert_eq!((first.pmac_index(&bench), second.pmac_index(&bench)), (0, 0));
    bench.set(57, 1.0);
    bench.run(2);
    assert_eq!((first.pmac_index(&bench), second.pmac_index(&bench)), (2, 8));
    assert_eq!(take(&mut bench, 7).as_deref(), Some(FOUR));
    assert!(bench.violations().is_empty(), "{:?}", bench.violations());
}

#[test]
fn the_coordinate_systems_number_may_count_from_zero() {
    let mut bench = bench(100);
    bench.world.board.rotary_cs_base = 0;
    let mut host = Host::new(&mut bench, FIRST, 0xD300, 20, 0);
    host.send(&bench, ONE);
    bench.run(2);
    assert_eq!(host.pmac_index(&bench), 2);
}

#[test]
fn a_full_internal_buffer_holds_the_transfer_and_says_so() {
    let mut bench = bench(5);
    let mut host = Host::new(&mut bench, FIRST, 0xD300, 20, 1);
    host.send(&bench, FOUR);
    host.send(&bench, TWO);
    bench.run(10);
    assert_eq!((host.pmac_index(&bench), host.status(&bench)), (8, BUSY));
    take(&mut bench, 0).unwrap();
    bench.run(1);
    assert_eq!((host.pmac_index(&bench), host.status(&bench)), (12, 0));
    assert!(bench.violations().is_empty(), "{:?}", bench.violations());
}

#[test]
fn without_an_internal_buffer_there_is_an_error_until_there_is_one() {
    let mut bench = bench(5);
    let mut host = Host::new(&mut bench, FIRST, 0xD300, 20, 2);
    host.send(&bench, ONE);
    bench.run(3);
    assert_eq!((host.pmac_index(&bench), host.status(&bench)), (0, ERROR | 5));
    define(&mut bench, 1, 10);
    bench.run(1);
    assert_eq!((host.pmac_index(&bench), host.status(&bench)), (2, 0));
}

#[test]
fn words_that_are_no_command_stop_the_transfer_with_an_error() {
    let mut bench = bench(50);
    let mut host = Host::new(&mut bench, FIRST, 0xD300, 20, 1);
    host.send(&bench, ONE);
    host.send(&bench, &[(0x00_0800, 0)]);
    bench.run(5);
    assert_eq!((host.pmac_index(&bench), host.status(&bench)), (2, ERROR | 3));
}

#[test]
fn headers_against_the_rules_are_errors_and_recorded_once() {
    let good = [1, 0, 0, 20, 0xD300];
    let cases = [
        (3, 7),      // odd size
        (3, 4),      // less than 6
        (3, 0x1000), // beyond the end
        (4, 0xD1FF),
        (4, 0xE000),
        (1, 3),  // odd host index
        (1, 20), // beyond the size
        (2, 1),
        (0, 0), // no such coordinate system
        (0, 9),
    ];
    for (word, value) in cases {
        let mut bench = bench(10);
        let mut header = good;
        header[word] = value;
        for (at, value) in header.into_iter().enumerate() {
            bench.write(FIRST + 2 + 2 * at as u32, value);
        }
        bench.set(57, 1.0);
        bench.run(5);
        assert_eq!(bench.read(FIRST), ERROR | 3, "{header:?}");
        assert_eq!(bench.violations().len(), 1, "{header:?} {:?}", bench.violations());
    }
}

/// The judge's findings on a host that does `wrong` after two good lines.
fn found(wrong: impl Fn(&mut Bench, &mut Host)) -> Vec<String> {
    let mut bench = bench(2);
    let mut host = Host::new(&mut bench, FIRST, 0xD300, 20, 1);
    host.send(&bench, TWO);
    bench.run(2);
    // This one waits for room.
    host.send(&bench, TWO);
    bench.run(2);
    wrong(&mut bench, &mut host);
    bench.run(2);
    bench.violations().to_vec()
}

#[test]
fn what_a_host_does_wrong_is_recorded() {
    assert!(found(|_, _| {}).is_empty());
    let split = found(|bench, host| {
        host.send(bench, &FOUR[..2]);
        bench.run(1);
        host.send(bench, &FOUR[2..]);
    });
    assert_eq!(split.len(), 1, "{split:?}");
    assert!(split[0].contains("split a line"), "{split:?}");
    let marker = found(|bench, host| {
        host.put(bench, host.index, ONE[0]);
        bench.write(FIRST + 4, host.index + 2);
    });
    assert!(marker.len() == 1 && marker[0].contains("no end marker"), "{marker:?}");
    let marker = found(|bench, host| {
        host.send(bench, ONE);
        host.put(bench, host.index, (0x800, 0));
    });
    assert!(marker.len() == 1 && marker[0].contains("no end marker"), "{marker:?}");
    let quick = found(|bench, host| {
        host.send(bench, ONE);
        host.put(bench, host.index, FOUR[0]);
    });
    assert!(quick.is_empty(), "a host that is writing the next line: {quick:?}");
    let changed = found(|bench, host| host.put(bench, 4, ONE[0]));
    assert!(changed.is_empty(), "the same words are no change: {changed:?}");
    let changed = found(|bench, host| host.put(bench, 4, FOUR[1]));
    assert!(changed.len() == 1 && changed[0].contains("changed after"), "{changed:?}");
    let index = found(|bench, _| bench.write(FIRST + 6, 0));
    assert!(index[0].contains("0x07F6, which is PMAC's"), "{index:?}");
    let status = found(|bench, _| bench.write(FIRST, 0));
    assert!(status.len() == 1 && status[0].contains("0x07F0"), "{status:?}");
    // 4 to 8 is waiting; 12 more words would leave 2 free, but 4 it has to be.
    let full = found(|bench, host| {
        for _ in 0..7 {
            host.send(bench, ONE);
        }
    });
    assert!(full.len() == 1 && full[0].contains("beyond full"), "{full:?}");
    let back = found(|bench, host| bench.write(host.header + 4, 4));
    assert!(back.len() == 1 && back[0].contains("went back"), "{back:?}");
}

#[test]
fn a_buffer_in_the_variable_table_is_recorded() {
    let mut bench = bench(5);
    bench.set(55, 1.0);
    bench.write(0x07EE, 0xD304);
    bench.write(0x07EC, 2);
    bench.run(1);
    Host::new(&mut bench, FIRST, 0xD300, 6, 1);
    bench.run(3);
    assert_eq!(bench.violations().len(), 1, "{:?}", bench.violations());
    assert!(bench.violations()[0].contains("overlap"));
}

#[test]
fn faults_hold_delay_and_tear() {
    let mut bench = bench(50);
    let mut host = Host::new(&mut bench, FIRST, 0xD300, 20, 1);
    bench.world.board.faults.rotary.stuck = true;
    host.send(&bench, FOUR);
    bench.run(50);
    assert_eq!(host.pmac_index(&bench), 0);
    bench.world.board.faults.rotary.stuck = false;
    bench.world.board.faults.rotary.late = 3;
    bench.run(3);
    assert_eq!(host.pmac_index(&bench), 0);
    bench.world.board.faults.rotary.torn = true;
    bench.run(1);
    assert_eq!(host.pmac_index(&bench), 6, "in the middle of the line");
    bench.run(1);
    assert_eq!(host.pmac_index(&bench), 8);
    assert_eq!(take(&mut bench, 0).as_deref(), Some(FOUR));
    assert_eq!(take(&mut bench, 0), None);
    assert!(bench.violations().is_empty(), "{:?}", bench.violations());
}
