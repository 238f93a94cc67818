//! Rows 11 and 14: nothing lost, nothing mixed, no permission needed, and no reader held up by a writer that stands still.

use std::hint::black_box;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;
use nix::unistd::{Gid, Uid, setgid, setuid};
use pmac_dpram::segment::{RegionId, Sample, WaitOutcome};

use super::fresh;
use super::ours::{self, SERVO, WORDS};
use crate::clock;
use crate::process::{Child, Shared, bind, unbind};
use crate::table::{Bar, Table};

/// Nobody, on every Linux.
const NOBODY: u32 = 65_534;

/// All rows of this page, once; the loss test lasts `seconds`.
pub fn round(table: &mut Table, directory: &Path, seconds: u64) {
    sleeping_readers(table, directory, seconds);
    stopped_writers(table, directory);
    without_permission(table, directory);
}

/// 16 readers that look a hundred times a second at a region written at 9 kHz, and want every sample.
fn sleeping_readers(table: &mut Table, directory: &Path, seconds: u64) {
    const READERS: u64 = 16;
    let updates = 9000 * seconds;
    bind(0);
    let mut publisher = ours::publisher(directory, "loss");
    let shared = Shared::cells(5);
    let readers: Vec<Child> = (0..READERS)
        .map(|_| {
            Child::run(|| {
                unbind();
                let (subscriber, mut sample) = (ours::subscriber(directory, "loss"), Sample::new());
                let mut cursor = subscriber.cursor(SERVO, 1).expect("the region");
                let (mut read, mut mixed) = (0, 0);
                shared.cell(0).fetch_add(1, std::sync::atomic::Ordering::AcqRel);
                loop {
                    let over = shared.value(1) == 1;
                    while subscriber.next(&mut cursor, &mut sample).expect("a sample") {
                        read += 1;
                        mixed +=
                            u64::from(sample.words().iter().any(|word| *word != sample.sequence() as u16));
                    }
                    if over {
                        break;
                    }
                    std::thread::sleep(Duration::from_millis(10));
                }
                for (cell, value) in [(2, read), (3, cursor.lost()), (4, mixed)] {
                    shared.cell(cell).fetch_add(value, std::sync::atomic::Ordering::AcqRel);
                }
            })
        })
        .collect();
    shared.wait(0, READERS);
    let mut words = [0; WORDS];
    let period = clock::ticks(111_111.0);
    let mut next = clock::before();
    for number in 1..=updates {
        ours::fill(&mut words, number);
        publisher.publish(SERVO, ours::stamp(number), &words);
        next += period;
        clock::spin_until(next);
    }
    shared.set(1, 1);
    readers.into_iter().for_each(Child::join);
    let [read, lost, mixed] = [2, 3, 4].map(|cell| shared.value(cell) as f64);
    assert_eq!(read + lost, (updates * READERS) as f64, "every sample is read or counted");
    table.add("11", "9 kHz, 16 readers at 100 Hz: samples lost / read", "", Bar::AtMost(0.0), [lost, read]);
    table.add("11", "- mixed / read", "", Bar::AtMost(0.0), [mixed, read]);
}

/// Copies checked word by word against a writer at full speed, `reads` of them. Returns how many were mixed, retried, and the most retries.
pub fn checked_reads(directory: &Path, reads: u64) -> (u64, u64, u32) {
    let shared = Shared::cells(2);
    let mut publisher = ours::publisher(directory, "checked");
    let writer = Child::on(0, || fresh::write(&shared, &mut publisher, 0.0));
    bind(1);
    shared.wait(0, 1);
    let (subscriber, mut sample) = (ours::subscriber(directory, "checked"), Sample::new());
    let (mut mixed, mut retries, mut most) = (0, 0, 0);
    for _ in 0..reads {
        let found = black_box(subscriber.latest(SERVO, &mut sample)).expect("a copy");
        assert!(found.is_some(), "the writer has begun");
        let words = sample.words();
        // Branch-free, so that checking costs less than reading.
        mixed += u64::from(words.iter().fold(0, |all, word| all | (word ^ words[0])) != 0);
        retries += u64::from(sample.retries());
        most = most.max(sample.retries());
    }
    shared.set(1, 1);
    writer.join();
    (mixed, retries, most)
}

/// Writers at full speed, stopped or killed at random moments, most of them in mid-write: the longest a read took then.
fn stopped_writers(table: &mut Table, directory: &Path) {
    const STOPS: u64 = 100;
    let shared = Shared::cells(2);
    let (mut worst, mut reads, mut failed) = (0.0_f64, 0_u32, 0_u32);
    for signal in [Signal::SIGSTOP, Signal::SIGKILL] {
        let mut writer = None;
        for stop in 0..STOPS {
            let running = writer.get_or_insert_with(|| {
                shared.set(0, 0);
                let directory = directory.to_owned();
                let shared = &shared;
                Child::on(0, move || {
                    let mut publisher = ours::publisher(&directory, "stopped");
                    fresh::write(shared, &mut publisher, 0.0);
                })
            });
            bind(1);
            shared.wait(0, 1);
            running.signal(Signal::SIGCONT);
            clock::spin_until(
                clock::before() + clock::ticks(20_000.0 + (stop * 7919 % 10_007) as f64 * 10.0),
            );
            running.signal(signal);
            std::thread::sleep(Duration::from_micros(200));
            let (subscriber, mut sample) = (ours::subscriber(directory, "stopped"), Sample::new());
            for _ in 0..20 {
                let start = Instant::now();
                let found = subscriber.latest(SERVO, &mut sample);
                worst = worst.max(start.elapsed().as_secs_f64() * 1e6);
                let words = sample.words();
                let is_whole = matches!(found, Ok(Some(_))) && words.iter().all(|word| *word == words[0]);
                (reads, failed) = (reads + 1, failed + u32::from(!is_whole));
            }
            if signal == Signal::SIGKILL {
                writer = None;
            }
        }
    }
    table.add("14", "longest read of 4000 after 100 SIGSTOP, 100 kill -9", "us", Bar::None, [worst, 1.0]);
    let counts = [f64::from(failed), f64::from(reads)];
    table.add("14", "- reads that failed, or were mixed / made", "", Bar::AtMost(0.0), counts);
}

/// A process of another user, with nothing but the right to read: opens, reads, sleeps and is woken.
fn without_permission(table: &mut Table, directory: &Path) {
    bind(0);
    let mut publisher = ours::publisher(directory, "permission");
    std::fs::set_permissions(directory, std::fs::Permissions::from_mode(0o755)).expect("readable");
    let words = [1; WORDS];
    publisher.publish(SERVO, ours::stamp(1), &words);
    // The reader is ready; what it tried; what of that failed.
    let shared = Shared::cells(3);
    let root = Uid::effective().is_root();
    let reader = Child::run(|| {
        let (mut tried, mut failed) = (0, 0);
        let mut expect = |is_so: bool| (tried, failed) = (tried + 1, failed + u64::from(!is_so));
        if root {
            setgid(Gid::from_raw(NOBODY)).expect("setgid");
            setuid(Uid::from_raw(NOBODY)).expect("setuid");
            let opened = std::fs::OpenOptions::new().write(true).open(directory.join("permission"));
            expect(opened.is_err());
        }
        let (subscriber, mut sample) = (ours::subscriber(directory, "permission"), Sample::new());
        expect(matches!(subscriber.latest(SERVO, &mut sample), Ok(Some(1))));
        shared.set(0, 1);
        let waited = subscriber.wait_newer(SERVO, 1, Duration::from_secs(5));
        expect(matches!(waited, Ok(WaitOutcome::Newer)));
        expect(subscriber.published(RegionId::Panel).is_ok());
        shared.set(1, tried);
        shared.set(2, failed);
    });
    shared.wait(0, 1);
    std::thread::sleep(Duration::from_millis(20));
    publisher.publish(SERVO, ours::stamp(2), &words);
    reader.join();
    let figure = if root {
        "- uid nobody reads, is woken, cannot write: failed / tried"
    } else {
        "- reads and is woken (not run as root): failed / tried"
    };
    let [tried, failed] = [1, 2].map(|cell| shared.value(cell) as f64);
    table.add("14", figure, "", Bar::AtMost(0.0), [failed, tried]);
}
