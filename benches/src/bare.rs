//! `bare`: the mirror beside a bare thread that only sleeps until each update is due.
//!
//! Both have the same priority and timer slack, at the same time and on the same processor. The bare thread's lateness
//! is what this machine costs anybody. What the mirror adds to that is its own: a wrong phase, polls that find
//! nothing, the copy.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use nix::time::ClockId;
use pmac_dpram::clock::sleep_until;
use pmac_dpram::segment::{Counter, RegionId, Sample, Subscriber, monotonic_ns};

use crate::clock::Series;
use crate::daemon::delay_ns;
use crate::machine;
use crate::process::bind;
use crate::rig::{Rig, Setup};

/// Delay and processor time of the mirror may be this multiple of the bare thread's.
const MOST: f64 = 1.5;
/// Bus accesses for servo data may be this multiple of the necessary ones.
const MOST_ACCESSES: f64 = 1.05;
/// How often the samples are fetched. The segment holds many more.
const FETCH: Duration = Duration::from_millis(100);

/// The processor of pmacd and the bare thread, and that of the simulator and the reader. If the kernel chooses, pmacd or the bare
/// thread shares the simulator's. A wake there is up to three times cheaper.
const MEASURED: usize = 1;
const OTHERS: usize = 0;

/// So many wakes of the bare thread have one phase. The next is this part of a period later, so that they spread evenly.
const WAKES_A_PHASE: usize = 100;
const NEXT_PHASE: f64 = 0.618;

/// The median lateness of a thread, in ns, and the processor seconds that it used.
struct Bare {
    lateness: f64,
    processor: f64,
}

/// Sleeps until each multiple of the period, until `stop` is set. A wake costs less soon after another on the same
/// processor, so the phase beside simulator and pmacd moves on every so many wakes.
fn sleep_only(servo_hz: f64, stop: &AtomicBool) -> Bare {
    // As the bus thread of pmacd.
    let _ = nix::sys::prctl::set_timerslack(1);
    let period = 1e9 / servo_hz;
    let (start, mut lateness) = (monotonic_ns(), Vec::new());
    while !stop.load(Ordering::Relaxed) {
        let phase = (lateness.len() / WAKES_A_PHASE) as f64 * NEXT_PHASE % 1.0;
        let passed = ((monotonic_ns() - start) as f64 / period - phase).floor() + 1.0;
        let due = start + ((passed + phase) * period) as u64;
        sleep_until(due);
        lateness.push(monotonic_ns().saturating_sub(due) as f64);
    }
    let used = ClockId::CLOCK_THREAD_CPUTIME_ID.now().map_or(Duration::ZERO, Duration::from);
    Bare { lateness: Series::from_ns(lateness).figures().median, processor: used.as_secs_f64() }
}

/// Ns from each update to the daemon's first read of it, for `time`.
fn delays(subscriber: &Subscriber, time: Duration) -> Vec<f64> {
    let first = subscriber.published(RegionId::Servo).expect("servo data") + 1;
    let mut cursor = subscriber.cursor(RegionId::Servo, first).expect("servo data");
    let (mut sample, mut delays) = (Sample::new(), Vec::new());
    let end = Instant::now() + time;
    while Instant::now() < end {
        std::thread::sleep(FETCH);
        while subscriber.next(&mut cursor, &mut sample).expect("a sample") {
            delays.push(delay_ns(&sample, sample.stamp().time_ns));
        }
    }
    assert_eq!(cursor.lost(), 0, "samples were lost");
    delays
}

/// Measures each rate `rounds` times, `seconds` each. Returns whether the median round of each rate is within the
/// limits.
pub fn run(rounds: usize, seconds: u64) -> bool {
    machine::introduce("bare");
    println!(
        "{seconds} s a line, 8 motors; delay: from the board's update to the daemon's first read, median;"
    );
    println!("late: the median lateness of a thread that only sleeps; times in us, ratios in brackets");
    println!("{:>6} {:>22} {:>22} {:>10}", "Hz", "delay / late", "pmacd / bare CPU", "accesses");
    let mut within = true;
    for servo_hz in [500.0, 2258.8, 9000.0] {
        let ratios: Vec<[f64; 3]> = (0..rounds.max(1)).map(|_| line(servo_hz, seconds)).collect();
        let median = |index: usize| {
            let mut values: Vec<f64> = ratios.iter().map(|ratios| ratios[index]).collect();
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        };
        let [delay, processor, accesses] = std::array::from_fn(median);
        let is_within = delay <= MOST && processor <= MOST && accesses <= MOST_ACCESSES;
        println!(
            "{servo_hz:>6.0} median of {rounds}: delay {delay:.2}, CPU {processor:.2} (limit {MOST}), accesses \
             {accesses:.4} (limit {MOST_ACCESSES}): {}",
            if is_within { "within" } else { "BEYOND" }
        );
        within &= is_within;
    }
    within
}

fn line(servo_hz: f64, seconds: u64) -> [f64; 3] {
    let setup = Setup { servo_hz, ..Setup::default() };
    bind(OTHERS);
    let mut rig = Rig::simulator_alone(&setup);
    bind(MEASURED);
    rig.start_daemon(&setup);
    bind(OTHERS);
    let subscriber = rig.subscriber();
    // The daemon asks the board who it is at first; the phase is found meanwhile.
    std::thread::sleep(Duration::from_millis(1000));
    let counts =
        || [Counter::Updates, Counter::ServoAccesses].map(|counter| subscriber.counter(counter) as f64);
    let stop = AtomicBool::new(false);
    let (before, used_before) = (counts(), rig.daemon().processor_seconds());
    let (delays, bare) = std::thread::scope(|scope| {
        let bare = scope.spawn(|| {
            bind(MEASURED);
            sleep_only(servo_hz, &stop)
        });
        let delays = delays(&subscriber, Duration::from_secs(seconds));
        stop.store(true, Ordering::Relaxed);
        (delays, bare.join().expect("the bare thread ends"))
    });
    let (after, used) = (counts(), rig.daemon().processor_seconds() - used_before);
    let necessary = f64::from(6 + 30 * u32::from(setup.motors)) * (after[0] - before[0]);
    let accesses = (after[1] - before[1]) / necessary;
    let delay = Series::from_ns(delays).figures().median;
    let (late, processor) = (delay / bare.lateness, used / bare.processor);
    let share = |used: f64| used / seconds as f64 * 100.0;
    println!(
        "{servo_hz:>6.0} {:>22} {:>22} {accesses:>10.4}",
        format!("{:.1} / {:.1} ({late:.2})", delay / 1e3, bare.lateness / 1e3),
        format!("{:.1} / {:.1} % ({processor:.2})", share(used), share(bare.processor)),
    );
    [late, processor, accesses]
}
