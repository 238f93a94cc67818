//! What publishing and reading cost, beside a plain copy of the same bytes in the same rounds. Absolute times
//! depend on the machine and on what else runs there; only the ratios of one run mean something.
//!
//! `cargo test --release --test it segment_cost -- --ignored --nocapture`

use std::hint::black_box;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use pmac_dpram::segment::{Publisher, RegionId, Sample, Stamp, monotonic_ns};

use super::segment::{assert_unmixed, attach, options, publish_numbered, regions};

const ROUNDS: usize = 15;

/// Nanoseconds a call, the fastest of several batches.
fn cost(mut call: impl FnMut()) -> f64 {
    const BATCH: u32 = 2000;
    let batch = |call: &mut dyn FnMut()| {
        let start = Instant::now();
        for _ in 0..BATCH {
            call();
        }
        start.elapsed().as_nanos() as f64 / f64::from(BATCH)
    };
    (0..20).map(|_| batch(&mut call)).fold(f64::MAX, f64::min)
}

/// Nanoseconds a sample of a walk through 4001 of them, the faster of two.
fn cost_of_a_walk(mut walk: impl FnMut()) -> f64 {
    let mut once = || {
        let start = Instant::now();
        walk();
        start.elapsed().as_nanos() as f64 / 4001.0
    };
    once().min(once())
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

#[test]
#[ignore = "measures; run it in a release build on a quiet machine"]
fn publishing_and_reading_beside_a_plain_copy() {
    let directory = tempfile::tempdir().unwrap();
    let mut publisher = Publisher::create(&options(directory.path(), regions())).unwrap();
    let reader = attach(directory.path());
    let mut sample = Sample::new();
    let words = [0x1234u16; 258];
    let stamp = Stamp { time_ns: monotonic_ns(), servo_timer: 1, valid: true };
    for _ in 0..5000 {
        publisher.publish(RegionId::Servo, stamp, &words);
    }
    let mut copy = [0u16; 258];
    let (private, mut row) = (vec![7u64; 4096 * 72], [0u64; 65]);
    let mut table: Vec<[f64; 6]> = Vec::new();
    for _ in 0..ROUNDS {
        let plain = cost(|| black_box(&mut copy).copy_from_slice(black_box(&words)));
        let latest = cost(|| {
            black_box(reader.latest(RegionId::Servo, &mut sample).unwrap());
        });
        let publish = cost(|| {
            publisher.publish(RegionId::Servo, stamp, black_box(&words));
        });
        let getpid = cost(|| {
            black_box(nix::unistd::getppid());
        });
        let first = reader.published(RegionId::Servo).unwrap() - 4000;
        let drain = cost_of_a_walk(|| {
            let mut cursor = reader.cursor(RegionId::Servo, first).unwrap();
            while cursor.next(&reader, &mut sample).unwrap() {}
        });
        let walk = cost_of_a_walk(|| {
            for slot in private.chunks_exact(72).take(4001) {
                black_box(&mut row).copy_from_slice(&slot[4..69]);
            }
        });
        table.push([plain, latest, publish, getpid, drain, walk]);
    }
    let column = |index: usize| median(table.iter().map(|row| row[index]).collect());
    let plain = column(0);
    println!("516 bytes, ns each, median of {ROUNDS} interleaved rounds; beside a plain copy");
    for (what, index) in [
        ("plain copy", 0),
        ("latest", 1),
        ("plain walk", 5),
        ("drain", 4),
        ("publish and wake", 2),
        ("getppid", 3),
    ] {
        println!("{what:17} {:8.1} {:8.2}", column(index), column(index) / plain);
    }
}

#[test]
#[ignore = "measures; run it in a release build on a quiet machine"]
fn snapshots_checked_against_a_writer_at_full_speed() {
    let directory = tempfile::tempdir().unwrap();
    let mut publisher = Publisher::create(&options(directory.path(), regions())).unwrap();
    let reader = attach(directory.path());
    let done = AtomicBool::new(false);
    let (looks, retries, worst) = thread::scope(|scope| {
        let look = scope.spawn(|| {
            let (mut sample, mut looks, mut retries, mut worst) = (Sample::new(), 0u64, 0u64, 0);
            while !done.load(Ordering::Relaxed) {
                if reader.latest(RegionId::Servo, &mut sample).unwrap().is_some() {
                    assert_unmixed(&sample);
                    looks += 1;
                    retries += u64::from(sample.retries);
                    worst = sample.retries.max(worst);
                }
            }
            (looks, retries, worst)
        });
        let end = Instant::now() + Duration::from_secs(10);
        while Instant::now() < end {
            publish_numbered(&mut publisher);
        }
        done.store(true, Ordering::Relaxed);
        look.join().unwrap()
    });
    let published = publisher.published(RegionId::Servo);
    println!("published {published}, checked {looks}, none mixed, retries {retries}, worst {worst}");
}
