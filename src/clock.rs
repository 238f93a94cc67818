//! The clock of everything on the bus side: the machine's, or one that a test or a replay moves (layer 0).
//!
//! Code that needs the time gets a [`Clock`] or a time; none asks the machine. A test can so step a whole daemon
//! through hours in milliseconds, and each run does the same things at the same times.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use nix::sys::time::TimeSpec;
use nix::time::{ClockId, ClockNanosleepFlags, clock_gettime, clock_nanosleep};

/// A clock. Between two readings pass as many nanoseconds as CLOCK_MONOTONIC advanced, or as [`ManualTime`] was moved.
///
/// A clock and its clones have one zero; nanoseconds and [`Instant`]s both count from it.
#[derive(Debug, Clone)]
pub struct Clock {
    zero: Instant,
    manual: Option<Arc<AtomicU64>>,
}

impl Clock {
    /// CLOCK_MONOTONIC.
    #[must_use]
    pub fn real() -> Self {
        let ns = monotonic_ns();
        let now = Instant::now();
        Self { zero: now.checked_sub(Duration::from_nanos(ns)).unwrap_or(now), manual: None }
    }

    /// The time in nanoseconds, as stamps and heartbeats hold it.
    #[must_use]
    #[inline]
    pub fn ns(&self) -> u64 {
        self.manual.as_ref().map_or_else(monotonic_ns, |manual| manual.load(Ordering::Acquire))
    }

    /// The time for deadlines and durations.
    #[must_use]
    #[inline]
    pub fn now(&self) -> Instant {
        self.at(self.ns())
    }

    /// The time `ns` of this clock.
    #[must_use]
    #[inline]
    pub fn at(&self, ns: u64) -> Instant {
        self.zero + Duration::from_nanos(ns)
    }

    /// The time `instant` of this clock in nanoseconds; 0 before its zero.
    #[must_use]
    #[inline]
    pub fn ns_of(&self, instant: Instant) -> u64 {
        u64::try_from(instant.saturating_duration_since(self.zero).as_nanos()).unwrap_or(u64::MAX)
    }

    /// Whether it shows a [`ManualTime`].
    #[must_use]
    pub fn is_manual(&self) -> bool {
        self.manual.is_some()
    }
}

/// Sleeps until CLOCK_MONOTONIC is at `ns`, or until a signal comes.
pub fn sleep_until(ns: u64) {
    let until = TimeSpec::from_duration(Duration::from_nanos(ns));
    let _ = clock_nanosleep(ClockId::CLOCK_MONOTONIC, ClockNanosleepFlags::TIMER_ABSTIME, &until);
}

/// Time that a test or a replay moves. Its clocks follow it in every thread.
#[derive(Debug, Clone)]
pub struct ManualTime {
    ns: Arc<AtomicU64>,
    zero: Instant,
}

impl ManualTime {
    /// Time that stands at `ns`.
    #[must_use]
    pub fn at(ns: u64) -> Self {
        Self { ns: Arc::new(AtomicU64::new(ns)), zero: Instant::now() }
    }

    /// Time whose [`Instant`]s begin `by` before now. Its nanoseconds begin at 1 s.
    #[must_use]
    pub fn ago(by: Duration) -> Self {
        let time = Self::at(1_000_000_000);
        let zero = time.zero.checked_sub(by + Duration::from_secs(1)).unwrap_or(time.zero);
        Self { zero, ..time }
    }

    /// A clock that follows this time.
    #[must_use]
    pub fn clock(&self) -> Clock {
        Clock { zero: self.zero, manual: Some(Arc::clone(&self.ns)) }
    }

    /// The time in nanoseconds.
    #[must_use]
    pub fn ns(&self) -> u64 {
        self.ns.load(Ordering::Acquire)
    }

    /// Moves the time forward.
    pub fn advance(&self, by: Duration) {
        self.move_to(self.ns().saturating_add(u64::try_from(by.as_nanos()).unwrap_or(u64::MAX)));
    }

    /// Moves the time forward to `ns`; an earlier time changes nothing.
    pub fn move_to(&self, ns: u64) {
        self.ns.fetch_max(ns, Ordering::AcqRel);
    }
}

/// CLOCK_MONOTONIC in nanoseconds.
#[must_use]
pub fn monotonic_ns() -> u64 {
    // Linux always has this clock, and it is never negative.
    let now = clock_gettime(ClockId::CLOCK_MONOTONIC).map_or(Duration::ZERO, Duration::from);
    u64::try_from(now.as_nanos()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_real_clock_is_the_machines_in_both_units() {
        let clock = Clock::real();
        let (before, instant_before) = (monotonic_ns(), Instant::now());
        let (ns, now) = (clock.ns(), clock.now());
        assert!((before..=monotonic_ns()).contains(&ns));
        // The two clocks are not read at the same instant.
        assert!(
            now + Duration::from_secs(1) > instant_before && now < Instant::now() + Duration::from_secs(1)
        );
        assert_eq!(clock.ns_of(clock.at(ns)), ns);
        assert!(!clock.is_manual());
    }

    #[test]
    fn time_that_begins_long_ago_is_now_when_that_has_passed() {
        let day = Duration::from_secs(24 * 3600);
        let time = ManualTime::ago(day);
        let clock = time.clock();
        assert_eq!(clock.ns(), 1_000_000_000);
        time.advance(day);
        let now = Instant::now();
        assert!(clock.now() <= now && now < clock.now() + Duration::from_secs(1));
    }

    #[test]
    fn a_manual_clock_moves_only_when_it_is_moved_and_never_back() {
        let time = ManualTime::at(1_000);
        let (clock, other) = (time.clock(), time.clock());
        let began = clock.now();
        assert_eq!((clock.ns(), clock.ns_of(began)), (1_000, 1_000));
        time.advance(Duration::from_secs(3600));
        assert_eq!(other.now() - began, Duration::from_secs(3600));
        time.move_to(5);
        assert_eq!(clock.ns(), 3_600_000_001_000);
        assert_eq!(clock.at(clock.ns()), other.now());
    }
}
