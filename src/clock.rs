//! The time that everything on the bus side goes by: the machine's, or one that a test sets (layer 0).
//!
//! Whoever needs the time has a [`Clock`] or is given the time; nobody asks the machine for it. A whole daemon can so be
//! stepped through hours in milliseconds, and what it does at which time is the same in each run.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use nix::time::{ClockId, clock_gettime};

/// Tells the time. Two readings are apart by what CLOCK_MONOTONIC moved, or by what [`ManualTime`] was moved.
///
/// Nanoseconds and [`Instant`]s of one clock, and of its clones, say the same: both count from its zero.
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

    /// The time in nanoseconds: what stamps and heartbeats hold.
    #[must_use]
    #[inline]
    pub fn ns(&self) -> u64 {
        self.manual.as_ref().map_or_else(monotonic_ns, |manual| manual.load(Ordering::Acquire))
    }

    /// The time, for deadlines and for how long something took.
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

    /// Whether the time stands still until a test moves it.
    #[must_use]
    pub fn is_manual(&self) -> bool {
        self.manual.is_some()
    }
}

/// Time that moves only when it is told to. Its clocks follow it, in whatever thread they are.
#[derive(Debug, Clone)]
pub struct ManualTime {
    ns: Arc<AtomicU64>,
    zero: Instant,
}

impl ManualTime {
    /// It is `ns` and stays so.
    #[must_use]
    pub fn at(ns: u64) -> Self {
        Self { ns: Arc::new(AtomicU64::new(ns)), zero: Instant::now() }
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

    /// Moves on.
    pub fn advance(&self, by: Duration) {
        self.move_to(self.ns().saturating_add(u64::try_from(by.as_nanos()).unwrap_or(u64::MAX)));
    }

    /// Moves on to `ns`; a time that is past changes nothing.
    pub fn move_to(&self, ns: u64) {
        self.ns.fetch_max(ns, Ordering::AcqRel);
    }
}

/// CLOCK_MONOTONIC in nanoseconds.
#[must_use]
pub fn monotonic_ns() -> u64 {
    // It cannot fail on Linux, nor stand before its origin.
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
        // The zero is as exact as two readings can be taken together.
        assert!(
            now + Duration::from_secs(1) > instant_before && now < Instant::now() + Duration::from_secs(1)
        );
        assert_eq!(clock.ns_of(clock.at(ns)), ns);
        assert!(!clock.is_manual());
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
