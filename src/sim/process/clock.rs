//! The servo clock in real time.
//!
//! Interrupts are due at absolute times. The clock skips an interrupt that comes a whole period or more too late, and
//! all interrupts due meanwhile: simulated time then slips behind, and no burst of cycles makes up for it.

use std::time::Duration;

use nix::sys::time::TimeSpec;
use nix::time::{ClockId, ClockNanosleepFlags, clock_gettime, clock_nanosleep};

/// When the next servo interrupt is due.
#[derive(Debug)]
pub struct Clock {
    next: Duration,
}

impl Clock {
    /// A clock whose first interrupt is due now.
    ///
    /// # Errors
    /// When the system has no monotonic clock.
    pub fn start() -> nix::Result<Self> {
        // The default slack of 50 us is half a period at 9 kHz. If the system refuses the call, the clock is only
        // coarser.
        let _ = nix::sys::prctl::set_timerslack(1);
        Ok(Self { next: now()? })
    }

    /// Sleeps until the next interrupt, `period` after the last; returns the number of interrupts skipped as too late.
    /// A signal ends the sleep early; the next call makes up for it.
    ///
    /// # Errors
    /// When the system has no monotonic clock.
    pub fn wait(&mut self, period: Duration) -> nix::Result<u64> {
        let skipped = self.schedule(period, now()?);
        match clock_nanosleep(
            ClockId::CLOCK_MONOTONIC,
            ClockNanosleepFlags::TIMER_ABSTIME,
            &TimeSpec::from(self.next),
        ) {
            Ok(_) | Err(nix::errno::Errno::EINTR) => Ok(skipped),
            Err(errno) => Err(errno),
        }
    }

    fn schedule(&mut self, period: Duration, now: Duration) -> u64 {
        self.next += period;
        let period = period.as_nanos().max(1);
        let skipped = now.saturating_sub(self.next).as_nanos() / period;
        // Stays on the grid of the period, so that the rate does not change.
        self.next += Duration::from_nanos((skipped * period) as u64);
        skipped as u64
    }
}

fn now() -> nix::Result<Duration> {
    clock_gettime(ClockId::CLOCK_MONOTONIC).map(Duration::from)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_comes_too_late_is_skipped_and_counted_once() {
        let ms = Duration::from_millis;
        let mut clock = Clock { next: ms(100) };
        assert_eq!(clock.schedule(ms(10), ms(105)), 0);
        assert_eq!(clock.next, ms(110));
        // A little late: taken at once, nothing skipped.
        assert_eq!(clock.schedule(ms(10), ms(128)), 0);
        assert_eq!(clock.next, ms(120));
        // 45 ms late: four interrupts are gone, the next one is on the grid.
        assert_eq!(clock.schedule(ms(10), ms(175)), 4);
        assert_eq!(clock.next, ms(170));
        assert_eq!(clock.schedule(ms(10), ms(176)), 0);
        assert_eq!(clock.next, ms(180));
    }
}
