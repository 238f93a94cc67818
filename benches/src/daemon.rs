//! `daemon`: the phase-locked mirror against a simulated board in real time, at three servo rates and in both ways of reading.
//!
//! The simulator writes the time of each update into the data (CLOCK_MONOTONIC is everybody's), so that a client that was woken knows how
//! long the whole way took: update → daemon's copy → segment → client.

use std::time::{Duration, Instant};

use pmac_dpram::segment::{Counter, RegionId, Sample, Subscriber, WaitOutcome, monotonic_ns};

use crate::clock::{Figures, Series};
use crate::machine;
use crate::rig::{Rig, Setup};

/// 48 bits of nanoseconds, as the simulator writes them.
const STAMP_MASK: u64 = (1 << 48) - 1;
/// Where in the words of a sample: motor 1's compensation position at host offset 0x60, the region from 0x24 on.
const STAMP_WORD: usize = (0x60 - 0x24) / 2;

/// When the simulated board made the update, as far as 48 bits hold it.
pub fn update_ns(sample: &Sample) -> u64 {
    let words = &sample.words()[STAMP_WORD..];
    let half = |index: usize| u64::from(words[index]) | u64::from(words[index + 1] & 0xFF) << 16;
    half(0) | half(2) << 24
}

/// Ns from an update to `now`; 0 if `now`, taken before the board was looked at, was just before it.
pub fn delay_ns(sample: &Sample, now: u64) -> f64 {
    let delay = now.wrapping_sub(update_ns(sample)) & STAMP_MASK;
    if delay > STAMP_MASK / 2 { 0.0 } else { delay as f64 }
}

/// What a client saw of the servo data for a while.
#[derive(Default)]
pub struct Watched {
    /// Ns from each update to the daemon's first read of it.
    pub mirrored: Vec<f64>,
    /// Ns from each update to the woken client, with its copy.
    pub woken: Vec<f64>,
    pub samples: u64,
    pub lost: u64,
}

/// Follows every sample for `time`, sleeping in between.
pub fn watch(subscriber: &Subscriber, time: Duration) -> Watched {
    let first = subscriber.published(RegionId::Servo).expect("servo data") + 1;
    let mut cursor = subscriber.cursor(RegionId::Servo, first).expect("servo data");
    let (mut sample, mut samples) = (Sample::new(), 0);
    let (mut mirrored, mut woken) = (Vec::new(), Vec::new());
    let end = Instant::now() + time;
    while Instant::now() < end {
        let waited = subscriber.wait_newer(RegionId::Servo, cursor.position() - 1, Duration::from_secs(1));
        assert_eq!(waited.expect("servo data"), WaitOutcome::Newer, "the board is silent");
        while subscriber.next(&mut cursor, &mut sample).expect("a sample") {
            woken.push(delay_ns(&sample, monotonic_ns()));
            mirrored.push(delay_ns(&sample, sample.stamp().time_ns));
            samples += 1;
        }
    }
    Watched { mirrored, woken, samples, lost: cursor.lost() }
}

impl Watched {
    /// Adds what was seen in another while.
    pub fn append(&mut self, mut other: Self) {
        self.mirrored.append(&mut other.mirrored);
        self.woken.append(&mut other.woken);
        self.samples += other.samples;
        self.lost += other.lost;
    }

    /// The figures of both delays: mirrored, woken.
    pub fn figures(&self) -> [Figures; 2] {
        [&self.mirrored, &self.woken].map(|delays| Series::from_ns(delays.iter().copied()).figures())
    }
}

/// Measures every rate and way of reading `rounds` times, `seconds` each.
pub fn run(rounds: usize, seconds: u64) {
    machine::introduce("daemon");
    println!(
        "{seconds} s a line, 8 motors, a client that sleeps and follows every update; delays in us from the board's update to"
    );
    println!("the daemon's first read of it (mirrored) and to the woken client with its copy (woken)");
    println!(
        "{:<10} {:>7} {:>7} {:>7} {:>6} {:>7} {:>4} {:>7} {:>6} {:>24} {:>24} {:>6} {:>6}",
        "reading",
        "Hz",
        "made",
        "seen",
        "missed",
        "skipped",
        "lost",
        "ratio",
        "polls",
        "mirrored 50/99/99.9",
        "woken 50/99/99.9",
        "pmacd",
        "sim"
    );
    let can_be_kept_awake = machine::keep_awake().is_some();
    for _ in 0..rounds {
        for servo_hz in [500.0, 2258.8, 9000.0] {
            for reading in ["optimistic", "handshake"] {
                line(&Setup { servo_hz, reading, ..Setup::default() }, seconds);
            }
            if can_be_kept_awake {
                line(&Setup { servo_hz, awake: true, ..Setup::default() }, seconds);
            }
        }
    }
    println!(
        "ratio: bus accesses for servo data per update / (6 + 30 motors), handshake / (9 + 30 motors); polls: accesses beyond that per update"
    );
    println!("awake: optimistic, with cpu_latency_us = 0");
    println!(
        "made: updates by the simulator's own count; skipped: by the simulator's count / by the daemon's estimate"
    );
}

fn line(setup: &Setup, seconds: u64) {
    let rig = Rig::start(setup);
    let subscriber = rig.subscriber();
    // The daemon asks the board who it is at first; the phase is found meanwhile.
    std::thread::sleep(Duration::from_millis(1000));
    let counts = || {
        [Counter::Updates, Counter::Missed, Counter::Skipped, Counter::ServoAccesses]
            .map(|counter| subscriber.counter(counter))
    };
    let board = || [rig.simulated("updates"), rig.simulated("skipped")];
    let cpu = || [rig.daemon().processor_seconds(), rig.simulator.processor_seconds()];
    let (start, before, board_before, cpu_before) = (Instant::now(), counts(), board(), cpu());
    let watched = watch(&subscriber, Duration::from_secs(seconds));
    let [mirrored, woken] = watched.figures();
    let (after, board_after, cpu_after) = (counts(), board(), cpu());
    let wall = start.elapsed().as_secs_f64();
    let [seen, missed, skipped, accesses] = std::array::from_fn(|index| after[index] - before[index]);
    let [made, held_off] = std::array::from_fn(|index| board_after[index] - board_before[index]);
    let share: [f64; 2] = std::array::from_fn(|index| (cpu_after[index] - cpu_before[index]) / wall * 100.0);
    let overhead = if setup.reading == "handshake" { 9 } else { 6 };
    let formula = (overhead + 30 * u64::from(setup.motors)) * seen;
    let us = |figures: &Figures| {
        format!("{:.1}/{:.1}/{:.1}", figures.median / 1e3, figures.p99 / 1e3, figures.p999 / 1e3)
    };
    println!(
        "{:<10} {:>7.0} {:>7} {:>7} {:>6} {:>7} {:>4} {:>7.4} {:>6.2} {:>24} {:>24} {:>5.1}% {:>5.1}%",
        if setup.awake { "awake" } else { setup.reading },
        setup.servo_hz,
        made,
        seen,
        missed,
        format!("{held_off}/{skipped}"),
        watched.lost,
        accesses as f64 / formula as f64,
        accesses.saturating_sub(formula) as f64 / seen as f64,
        us(&mirrored),
        us(&woken),
        share[0],
        share[1]
    );
}
