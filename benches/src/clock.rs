//! Time and what is made of it: the processor's own counter, and the figures of a series of measurements.
//!
//! A single operation here takes a few to a few hundred nanoseconds, far less than asking the kernel's clock, so operations are timed by
//! the time stamp counter, whose own cost is measured and taken off. Elsewhere than on x86-64 the kernel's clock has to do.

use std::sync::OnceLock;
use std::time::{Duration, Instant};

/// A reading of the counter before what is measured: nothing after it begins earlier.
#[inline(always)]
#[cfg(target_arch = "x86_64")]
pub fn before() -> u64 {
    // SAFETY: every x86-64 processor has both instructions; they touch no memory.
    unsafe {
        std::arch::x86_64::_mm_lfence();
        let ticks = std::arch::x86_64::_rdtsc();
        std::arch::x86_64::_mm_lfence();
        ticks
    }
}

/// A reading of the counter after what is measured: everything before it is done.
#[inline(always)]
#[cfg(target_arch = "x86_64")]
pub fn after() -> u64 {
    let mut processor = 0;
    // SAFETY: as in `before`; `processor` is a place of our own.
    unsafe {
        let ticks = std::arch::x86_64::__rdtscp(&raw mut processor);
        std::arch::x86_64::_mm_lfence();
        ticks
    }
}

/// The kernel's clock, where there is no counter to be had.
#[cfg(not(target_arch = "x86_64"))]
pub fn before() -> u64 {
    pmac_dpram::segment::monotonic_ns()
}

/// The kernel's clock, where there is no counter to be had.
#[cfg(not(target_arch = "x86_64"))]
pub fn after() -> u64 {
    pmac_dpram::segment::monotonic_ns()
}

/// The counter's rate and what a pair of readings costs.
struct Scale {
    ns_per_tick: f64,
    overhead: u64,
}

fn scale() -> &'static Scale {
    static SCALE: OnceLock<Scale> = OnceLock::new();
    SCALE.get_or_init(|| {
        let (start, ticks) = (Instant::now(), before());
        while start.elapsed() < Duration::from_millis(200) {}
        let ns_per_tick = start.elapsed().as_nanos() as f64 / (after() - ticks) as f64;
        let mut pairs: Vec<u64> = (0..20_000).map(|_| cost_of_a_pair()).collect();
        pairs.sort_unstable();
        Scale { ns_per_tick, overhead: pairs[pairs.len() / 2] }
    })
}

fn cost_of_a_pair() -> u64 {
    let start = before();
    after() - start
}

/// Measures the counter, once; to be called before processes are forked, so that all use the same scale.
pub fn calibrate() -> (f64, f64) {
    let scale = scale();
    (scale.ns_per_tick, scale.overhead as f64 * scale.ns_per_tick)
}

/// Nanoseconds of as many ticks.
pub fn ns(ticks: u64) -> f64 {
    ticks as f64 * scale().ns_per_tick
}

/// Ticks of as many nanoseconds.
pub fn ticks(ns: f64) -> u64 {
    (ns / scale().ns_per_tick) as u64
}

/// Ticks between two readings in one process, without what reading costs.
#[inline(always)]
pub fn between(start: u64, end: u64) -> u64 {
    end.saturating_sub(start).saturating_sub(scale().overhead)
}

/// Spins until the counter reaches `tick`.
#[inline(always)]
pub fn spin_until(tick: u64) {
    while before() < tick {
        std::hint::spin_loop();
    }
}

/// Ticks a call of `operation`.
#[inline(always)]
pub fn time<R>(operation: impl FnOnce() -> R) -> u64 {
    let start = before();
    std::hint::black_box(operation());
    between(start, after())
}

/// Ns a call of each of `operations`, from batches taken in turn so that all see the same minutes of the machine: the median batch.
pub fn batches<const N: usize>(operations: [&mut dyn FnMut(); N]) -> [f64; N] {
    const CALLS: u32 = 64;
    const BATCHES: usize = 1000;
    let mut series: [Series; N] = std::array::from_fn(|_| Series::default());
    let mut operations = operations;
    for _ in 0..BATCHES {
        for (operation, series) in operations.iter_mut().zip(&mut series) {
            let start = before();
            for _ in 0..CALLS {
                operation();
            }
            series.push(between(start, after()));
        }
    }
    series.map(|series| series.figures().median / f64::from(CALLS))
}

/// A series of measurements in ticks.
#[derive(Default)]
pub struct Series(Vec<u64>);

/// What is told of a series, in ns.
#[derive(Clone, Copy, Debug, Default)]
pub struct Figures {
    pub count: usize,
    pub median: f64,
    pub p99: f64,
    pub p999: f64,
    /// Mean of the fastest 99 %.
    pub mean: f64,
}

impl Series {
    pub fn with_room(count: usize) -> Self {
        Self(Vec::with_capacity(count))
    }

    #[inline]
    pub fn push(&mut self, ticks: u64) {
        self.0.push(ticks);
    }

    pub fn from_ns(values: impl IntoIterator<Item = f64>) -> Self {
        Self(values.into_iter().map(ticks).collect())
    }

    pub fn figures(mut self) -> Figures {
        let values = &mut self.0;
        if values.is_empty() {
            return Figures::default();
        }
        values.sort_unstable();
        let at = |part: f64| ns(values[((values.len() - 1) as f64 * part).round() as usize]);
        let kept = &values[..(values.len() * 99).div_ceil(100)];
        Figures {
            count: values.len(),
            median: at(0.5),
            p99: at(0.99),
            p999: at(0.999),
            mean: kept.iter().map(|value| ns(*value)).sum::<f64>() / kept.len() as f64,
        }
    }
}

impl FromIterator<u64> for Series {
    fn from_iter<I: IntoIterator<Item = u64>>(ticks: I) -> Self {
        Self(ticks.into_iter().collect())
    }
}
