//! Rows 2 to 5: data that the other processor has just written.

use std::hint::black_box;
use std::path::Path;

use pmac_dpram::segment::{Publisher, Sample, Subscriber};

use super::hot::plain_copy;
use super::ours::{self, BYTES, SERVO, WORDS};
use super::peer;
use crate::clock::{self, Figures, Series};
use crate::process::{Child, Shared, bind};
use crate::table::{Bar, Table};

/// All rows of this page, once.
pub fn round(table: &mut Table, directory: &Path) {
    let hop = hop();
    latest(table, directory);
    let at_10_khz = first_reads(directory, 100_000.0);
    let [median, p99] = [at_10_khz.figures.median, at_10_khz.figures.p99];
    table.add(
        "3",
        "first read of an update at 10 kHz, median / line hop",
        "ns",
        Bar::AtMost(1.2),
        [median, hop],
    );
    table.add("3", "- p99 / median", "ns", Bar::AtMost(2.0), [p99, median]);
    let floor = unguarded(100_000.0);
    table.add("3", "- unguarded copy behind a head, median / line hop", "ns", Bar::None, [floor.median, hop]);
    let board = peer::blackboard_first_reads(100_000.0);
    table.add("3", "- iceoryx2's blackboard, median / line hop", "ns", Bar::None, [board.median, hop]);
    ping_pong(table, directory);
    let full_speed = first_reads(directory, 0.0);
    let board = peer::blackboard_first_reads(0.0);
    table.add(
        "5",
        "read p99, writer at full speed / iceoryx2's blackboard",
        "ns",
        Bar::AtMost(0.3),
        [full_speed.figures.p99, board.p99],
    );
    table.add("5", "- retries per read", "", Bar::AtMost(0.001), [full_speed.retries_per_read, 1.0]);
    table.add(
        "5",
        "- most retries of a read",
        "",
        Bar::AtMost(4.0),
        [f64::from(full_speed.most_retries), 1.0],
    );
}

/// Ns that one cache line takes from one processor to the other: half a round trip of a word.
pub fn hop() -> f64 {
    const TRIPS: u64 = 20_000;
    let shared = Shared::cells(2);
    let other = Child::on(0, || {
        for trip in 1..=TRIPS {
            shared.spin(0, trip);
            shared.set(1, trip);
        }
    });
    bind(1);
    let trips: Series = (1..=TRIPS)
        .map(|trip| {
            clock::time(|| {
                shared.set(0, trip);
                shared.spin(1, trip);
            })
        })
        .collect();
    other.join();
    trips.figures().median / 2.0
}

/// A read of what was written a moment ago, against a plain copy of what was plainly copied there a moment ago.
fn latest(table: &mut Table, directory: &Path) {
    const READS: u64 = 8000;
    let shared = Shared::cells(2);
    let plain = Shared::words(1024);
    // SAFETY: the mapping outlives both processes' use; the cells of `shared` keep writing and reading apart.
    let line = || unsafe { std::slice::from_raw_parts_mut(plain.address(), BYTES) };
    let mut publisher = ours::publisher(directory, "fresh");
    let writer = Child::on(0, || {
        let (mut words, from) = ([0; WORDS], vec![7; BYTES]);
        for number in 1..=READS {
            plain_copy(&from, line(), BYTES);
            shared.set(0, 2 * number - 1);
            shared.spin(1, 2 * number - 1);
            ours::fill(&mut words, number);
            publisher.put(SERVO, ours::stamp(number), &words);
            shared.set(0, 2 * number);
            shared.spin(1, 2 * number);
        }
    });
    bind(1);
    let (subscriber, mut sample) = (ours::subscriber(directory, "fresh"), Sample::new());
    let mut to = vec![0; BYTES];
    let (mut copies, mut reads) = (Series::default(), Series::default());
    for number in 1..=READS {
        shared.spin(0, 2 * number - 1);
        copies.push(clock::time(|| plain_copy(line(), &mut to, BYTES)));
        shared.set(1, 2 * number - 1);
        shared.spin(0, 2 * number);
        reads.push(clock::time(|| black_box(subscriber.latest(SERVO, &mut sample).is_ok())));
        assert_eq!(sample.sequence(), number);
        shared.set(1, 2 * number);
    }
    writer.join();
    let [reads, copies] = [reads.figures().mean, copies.figures().mean];
    table.add("2", "fresh latest / fresh memcpy", "ns", Bar::AtMost(2.0), [reads, copies]);
}

/// What reads against a writer gave.
pub struct FirstReads {
    pub figures: Figures,
    pub retries_per_read: f64,
    pub most_retries: u32,
}

/// Reads again and again while another process publishes every `period_ns` (0: as fast as it can); times each first read of an update.
pub fn first_reads(directory: &Path, period_ns: f64) -> FirstReads {
    let shared = Shared::cells(2);
    let mut publisher = ours::publisher(directory, "first");
    let writer = Child::on(0, || write(&shared, &mut publisher, period_ns));
    bind(1);
    shared.wait(0, 1);
    let (subscriber, mut sample) = (ours::subscriber(directory, "first"), Sample::new());
    let mut first = Series::default();
    let (mut reads, mut retries, mut most, mut last) = (0_u64, 0_u64, 0, 0);
    let end = clock::before() + clock::ticks(4e8);
    while clock::before() < end {
        for _ in 0..64 {
            let ticks = clock::time(|| black_box(subscriber.latest(SERVO, &mut sample).is_ok()));
            reads += 1;
            retries += u64::from(sample.retries());
            most = most.max(sample.retries());
            if sample.sequence() != last {
                last = sample.sequence();
                first.push(ticks);
            }
            let words = sample.words();
            assert!(words.iter().all(|word| *word == words[0]), "a mixed sample");
        }
    }
    shared.set(1, 1);
    writer.join();
    FirstReads {
        figures: first.figures(),
        retries_per_read: retries as f64 / reads as f64,
        most_retries: most,
    }
}

/// The floor of [`first_reads`]: a plain copy behind a plain head, which is two misses, the second known only when the first is there.
/// Nothing says whether the copy is whole.
fn unguarded(period_ns: f64) -> Figures {
    const LINES: usize = 576 / 8;
    let slots = ours::SLOTS as usize;
    let (shared, memory) = (Shared::cells(4), Shared::words(LINES * slots));
    let place = |number: u64| number as usize % slots * LINES;
    let writer = Child::on(0, || {
        let period = clock::ticks(period_ns);
        let (mut number, mut next) = (0, clock::before());
        while shared.value(1) == 0 {
            number += 1;
            for word in 0..LINES {
                memory.word(place(number) + word).store(number, std::sync::atomic::Ordering::Relaxed);
            }
            shared.set(2, number);
            shared.set(0, 1);
            next += period;
            clock::spin_until(next);
        }
    });
    bind(1);
    shared.wait(0, 1);
    let (mut first, mut last, mut to) = (Series::default(), 0, [0_u8; 576]);
    let end = clock::before() + clock::ticks(4e8);
    while clock::before() < end {
        let mut number = 0;
        let ticks = clock::time(|| {
            number = shared.value(2);
            // SAFETY: inside the mapping, which outlives this; the writer is a whole ring ahead before it comes here again.
            let slot = unsafe { std::slice::from_raw_parts(memory.address().add(place(number) * 8), 576) };
            plain_copy(slot, &mut to, BYTES);
            black_box(&to);
        });
        if number != last {
            last = number;
            first.push(ticks);
        }
    }
    shared.set(1, 1);
    writer.join();
    first.figures()
}

/// Publishes until cell 1 is set.
pub fn write(shared: &Shared, publisher: &mut Publisher, period_ns: f64) {
    let mut words = [0; WORDS];
    let period = clock::ticks(period_ns);
    let (mut number, mut next) = (0, clock::before());
    while shared.value(1) == 0 {
        number += 1;
        ours::fill(&mut words, number);
        publisher.put(SERVO, ours::stamp(number), &words);
        shared.set(0, 1);
        if period > 0 {
            next += period;
            clock::spin_until(next);
        }
    }
}

/// An update there and one back, each written whole and copied out whole; both sides spin.
fn ping_pong(table: &mut Table, directory: &Path) {
    const TRIPS: u64 = 20_000;
    let (mut there, mut back) = (ours::publisher(directory, "there"), ours::publisher(directory, "back"));
    let shared = Shared::cells(1);
    let take = |subscriber: &Subscriber, sample: &mut Sample, number: u64| {
        while !matches!(subscriber.latest(SERVO, sample), Ok(Some(found)) if found >= number) {
            while subscriber.published(SERVO).expect("the region") < number {}
        }
    };
    let other = Child::on(0, || {
        let (subscriber, mut sample) = (ours::subscriber(directory, "there"), Sample::new());
        let mut words = [0; WORDS];
        shared.set(0, 1);
        for trip in 1..=TRIPS {
            take(&subscriber, &mut sample, trip);
            words.copy_from_slice(sample.words());
            back.put(SERVO, ours::stamp(trip), &words);
        }
    });
    bind(1);
    shared.wait(0, 1);
    let (subscriber, mut sample) = (ours::subscriber(directory, "back"), Sample::new());
    let mut words = [0; WORDS];
    let trips: Series = (1..=TRIPS)
        .map(|trip| {
            words[0] = trip as u16;
            clock::time(|| {
                there.put(SERVO, ours::stamp(trip), &words);
                take(&subscriber, &mut sample, trip);
            })
        })
        .collect();
    other.join();
    assert_eq!(sample.words()[0], TRIPS as u16);
    let [ours, peer] = [trips.figures().median / 2.0, peer::ping_pong(TRIPS) / 2.0];
    table.add("4", "ping-pong, 516 B, one way / iceoryx2 pub/sub", "ns", Bar::AtMost(0.6), [ours, peer]);
}
