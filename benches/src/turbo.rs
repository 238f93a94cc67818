//! `turbo`: all 32 motors of a Turbo board, every update followed by a client.

use std::time::{Duration, Instant};

use pmac_dpram::segment::{Counter, RegionId, Sample, Subscriber, WaitOutcome};

use crate::machine;
use crate::rig::{Rig, Setup};

/// Follows each rate for `seconds`, and says whether the client lost none.
pub fn run(seconds: u64) -> bool {
    machine::introduce("turbo");
    println!(
        "{seconds} s a line, 32 motors of a simulated Turbo PMAC2, a client that sleeps and takes every update"
    );
    println!(
        "{:>7} {:>8} {:>8} {:>8} {:>6} {:>10} {:>6}",
        "Hz", "made", "taken", "missed", "lost", "accesses", "pmacd"
    );
    let lost = [2258.8, 9000.0].map(|servo_hz| line(servo_hz, seconds));
    lost == [0, 0]
}

/// Prints the line of a rate; how many updates the client lost.
fn line(servo_hz: f64, seconds: u64) -> u64 {
    let rig = Rig::start(&Setup { family: "turbo2", servo_hz, ..Setup::default() });
    // What is asked at the start is over then.
    std::thread::sleep(Duration::from_secs(10));
    let subscriber = rig.subscriber();
    let daemon = rig.daemon();
    let counts =
        || [Counter::Updates, Counter::Missed, Counter::ServoAccesses].map(|what| subscriber.counter(what));
    let (before, cpu, began) = (counts(), daemon.processor_seconds(), Instant::now());
    let (taken, lost) = follow(&subscriber, Duration::from_secs(seconds));
    let (after, cpu, time) = (counts(), daemon.processor_seconds() - cpu, began.elapsed());
    let [updates, missed, accesses] = [0, 1, 2].map(|index| after[index] - before[index]);
    println!(
        "{servo_hz:>7} {:>8} {taken:>8} {missed:>8} {lost:>6} {:>10.1} {:>5.1}%",
        updates + missed,
        accesses as f64 / updates as f64,
        100.0 * cpu / time.as_secs_f64(),
    );
    lost
}

/// Takes every sample for `time`, sleeping in between: how many it took, and how many it lost.
fn follow(subscriber: &Subscriber, time: Duration) -> (u64, u64) {
    let first = subscriber.published(RegionId::Servo).expect("servo data") + 1;
    let mut cursor = subscriber.cursor(RegionId::Servo, first).expect("servo data");
    let (mut sample, mut taken, end) = (Sample::new(), 0, Instant::now() + time);
    while Instant::now() < end {
        let waited = subscriber.wait_newer(RegionId::Servo, cursor.position() - 1, Duration::from_secs(1));
        assert_eq!(waited.expect("servo data"), WaitOutcome::Newer, "the board is silent");
        while subscriber.next(&mut cursor, &mut sample).expect("a sample") {
            taken += 1;
        }
    }
    (taken, cursor.lost())
}
