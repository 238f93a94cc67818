//! Rows 1, 6, 9 and 10: what reading and publishing cost while nobody else moves the memory.

use std::hint::black_box;
use std::path::Path;

use pmac_dpram::segment::{Publisher, Sample, Subscriber};

use super::ours::{self, BYTES, SERVO, SLOTS, WORDS};
use super::peer;
use crate::clock::{self, Series};
use crate::process::{Child, Shared, bind};
use crate::table::{Bar, Table};

/// A copy whose length the compiler does not know, as the C library makes it.
#[inline(never)]
pub fn plain_copy(from: &[u8], to: &mut [u8], length: usize) {
    let length = black_box(length);
    to[..length].copy_from_slice(&from[..length]);
}

/// Whole cache lines, and never moved out of here: where its buffers lie makes a plain copy up to twice as slow, and where they lie on a
/// page still moves it.
#[repr(align(64))]
struct Lines([u8; 576]);

/// All rows of this page, once.
pub fn round(table: &mut Table, directory: &Path) {
    bind(1);
    let mut publisher = ours::publisher(directory, "hot");
    let words = [0x1234; WORDS];
    for number in 1..=u64::from(SLOTS) + 100 {
        publisher.put(SERVO, ours::stamp(number), &words);
    }
    let subscriber = ours::subscriber(directory, "hot");
    read_and_publish(table, &subscriber, &mut publisher);
    drain(table, directory, &subscriber);
    two_readers(table, directory, &subscriber);
    drop(publisher);
    publish_to_sixteen(table, directory);
}

fn read_and_publish(table: &mut Table, subscriber: &Subscriber, publisher: &mut Publisher) {
    let (from, mut to) = (Lines([1; 576]), Lines([0; 576]));
    let mut sample = Sample::new();
    let words = black_box([0x4321_u16; WORDS]);
    let [copy, latest, put] = clock::batches([
        &mut || plain_copy(&from.0, &mut to.0, BYTES),
        &mut || {
            black_box(subscriber.latest(SERVO, &mut sample).is_ok());
        },
        &mut || {
            publisher.put(SERVO, ours::stamp(1), &words);
        },
    ]);
    table.add("1", "hot latest, 516 B / memcpy", "ns", Bar::AtMost(1.5), [latest, copy]);
    table.add("9", "publish, 516 B, nobody reads / memcpy", "ns", Bar::AtMost(4.0), [put, copy]);
    let [wake, call] = clock::batches([
        &mut || {
            publisher.publish(SERVO, ours::stamp(1), &words);
        },
        &mut || {
            black_box(nix::unistd::getppid());
        },
    ]);
    table.add("9", "publish with its wake, nobody waits / getppid", "ns", Bar::None, [wake, call]);
}

/// A walk through everything the ring holds, against plain copies out of the very same memory.
fn drain(table: &mut Table, directory: &Path, subscriber: &Subscriber) {
    const WALKS: usize = 12;
    let file = std::fs::File::open(directory.join("hot")).expect("the segment's file");
    let info = subscriber.region(SERVO).expect("the region");
    let map = memmap2::MmapOptions::new().populate().map_raw_read_only(&file).expect("a mapping");
    // The last region of the segment ends it; slots are 576 bytes for 516 of payload behind 32 of stamp.
    let stride = 576;
    let length = info.slots as usize * stride;
    // SAFETY: the last `length` bytes of the mapping, which nobody writes while this runs.
    let slots = unsafe { std::slice::from_raw_parts(map.as_ptr().add(map.len() - length), length) };
    let (mut ours, mut plain) = (Series::default(), Series::default());
    let (mut sample, mut to) = (Sample::new(), Lines([0; 576]));
    for _ in 0..WALKS {
        plain.push(clock::time(|| {
            for slot in slots.chunks_exact(stride) {
                plain_copy(&slot[32..], &mut to.0, BYTES);
            }
        }));
        let first = subscriber.published(SERVO).expect("the region") - u64::from(SLOTS) + 1;
        let mut cursor = subscriber.cursor(SERVO, first).expect("the region");
        let mut count = 0;
        ours.push(clock::time(|| {
            while subscriber.next(&mut cursor, &mut sample).expect("a sample") {
                count += 1;
            }
        }));
        assert_eq!((count, cursor.lost()), (SLOTS, 0));
    }
    let rate = |series: Series| f64::from(SLOTS) * 1000.0 / series.figures().median;
    let [ours, plain] = [rate(ours), rate(plain)];
    table.add(
        "10",
        "drain of a full ring / memcpy from the same array",
        "M/s",
        Bar::AtLeast(0.9),
        [ours, plain],
    );
}

/// The cost of a read with and without a second reader at it on the other processor.
fn two_readers(table: &mut Table, directory: &Path, subscriber: &Subscriber) {
    let shared = Shared::cells(2);
    let second = Child::on(0, || {
        let (subscriber, mut sample) = (ours::subscriber(directory, "hot"), Sample::new());
        let mut turn = 0;
        loop {
            match shared.value(0) {
                0 => std::thread::yield_now(),
                1 => {
                    for _ in 0..100 {
                        black_box(subscriber.latest(SERVO, &mut sample).is_ok());
                    }
                }
                _ => break,
            }
            turn += 1;
            shared.set(1, turn);
        }
    });
    let mut sample = Sample::new();
    let mut figure = |readers: u64| {
        shared.set(0, readers - 1);
        let turn = shared.value(1);
        shared.wait(1, turn + 2);
        let [ns] = clock::batches([&mut || {
            black_box(subscriber.latest(SERVO, &mut sample).is_ok());
        }]);
        ns
    };
    // Twice each, in turn, because the second reader changes what the machine does besides.
    let times = [figure(1), figure(2), figure(1), figure(2)];
    shared.set(0, 2);
    second.join();
    let [one, two] = [times[0].min(times[2]), times[1].min(times[3])];
    table.add("6", "a read beside a second reader / alone", "ns", Bar::AtMost(1.05), [two, one]);
    let [two, one] = peer::blackboard_two_readers();
    table.add("6", "- the same of iceoryx2's blackboard", "ns", Bar::None, [two, one]);
}

/// What a publish costs at 9 kHz while 16 processes spin on it.
fn publish_to_sixteen(table: &mut Table, directory: &Path) {
    const UPDATES: u64 = 5000;
    bind(0);
    let mut publisher = ours::publisher(directory, "sixteen");
    let shared = Shared::cells(2);
    let readers: Vec<Child> = (0..16)
        .map(|_| {
            Child::on(1, || {
                let (subscriber, mut sample) = (ours::subscriber(directory, "sixteen"), Sample::new());
                shared.cell(0).fetch_add(1, std::sync::atomic::Ordering::AcqRel);
                while shared.value(1) == 0 {
                    black_box(subscriber.latest(SERVO, &mut sample).is_ok());
                }
            })
        })
        .collect();
    shared.wait(0, 16);
    let mut words = [0; WORDS];
    let mut costs = Series::with_room(UPDATES as usize);
    let period = clock::ticks(111_111.0);
    let mut next = clock::before();
    for number in 1..=UPDATES {
        ours::fill(&mut words, number);
        next += period;
        clock::spin_until(next);
        costs.push(clock::time(|| publisher.put(SERVO, ours::stamp(number), &words)));
    }
    shared.set(1, 1);
    readers.into_iter().for_each(Child::join);
    let p99 = costs.figures().p99 / 1000.0;
    table.add("9", "publish at 9 kHz with 16 readers, p99", "us", Bar::AtMost(1.0), [p99, 1.0]);
}
