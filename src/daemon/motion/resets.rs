//! Counts the board's resets, as far as they show: a sequence must not go on after the board has forgotten its
//! beginning.
//!
//! After a reset the servo report needs a new `GATHER`, while the board, with I58=1 saved, answers lines as before: the
//! bus thread learns of the reset late, or never. So a sequence has the daemon ask the board for its servo counter:
//! X:$0 counts servo interrupts in 24 bits, on Turbo boards too, and begins at 0 after a reset. A servo report that
//! stops or a timer that jumps is only a reason to ask: the bus thread may see late news of an older reset.

use std::time::{Duration, Instant};

/// The question for the servo counter.
pub const QUESTION: &str = "RX$0";
/// The counter's values.
const VALUES: u64 = 1 << 24;
/// The daemon assumes that no servo cycle is shorter: the counter goes round once in 335 s at the soonest. The cycle
/// that the board's settings give does not count here: an I10 may be wrong, and a simulator on a busy machine is slow.
const SHORTEST_CYCLE: Duration = Duration::from_micros(20);

/// A reading of the servo counter.
#[derive(Debug, Clone, Copy)]
struct Reading {
    counter: u64,
    asked: Instant,
}

/// The resets so far, and the readings that reveal the next reset.
#[derive(Debug, Default)]
pub struct Resets {
    seen_by_bus: u32,
    servo_was_live: bool,
    doubts: u64,
    count: u64,
    last: Option<Reading>,
    /// When the daemon last sent a reset, or saw the board come up again.
    at: Option<Instant>,
}

impl Resets {
    /// How many resets the counter has shown.
    pub const fn count(&self) -> u64 {
        self.count
    }

    /// How often the bus thread has seen signs that a reset may have caused.
    pub const fn doubts(&self) -> u64 {
        self.doubts
    }

    /// The daemon may have sent a reset to the board.
    pub fn was_sent(&mut self, now: Instant) {
        self.at = Some(now);
    }

    /// How long ago the board was reset or came up again, as far as the daemon knows.
    pub fn ago(&self, now: Instant) -> Option<Duration> {
        self.at.map(|at| now.saturating_duration_since(at))
    }

    /// The bus thread has seen `resets` since its start; `servo_is_live` tells whether servo data come now.
    pub fn bus_sees(&mut self, resets: u32, servo_is_live: bool, now: Instant) {
        let is_new = std::mem::replace(&mut self.seen_by_bus, resets) != resets;
        self.at = if is_new { Some(now) } else { self.at };
        let has_stopped = std::mem::replace(&mut self.servo_was_live, servo_is_live) && !servo_is_live;
        self.doubts += u64::from(is_new || has_stopped);
    }

    /// The board has answered, between `asked` and `answered`, that its servo counter is `counter`. Returns whether
    /// that reveals a reset.
    ///
    /// Only a counter that went back, and cannot have gone round, reveals a reset: a false alarm would end a good
    /// sequence. So a reset shows only if the board had run for longer before it than since.
    pub fn counter_is(&mut self, counter: u64, asked: Instant, answered: Instant) -> bool {
        let counter = counter % VALUES;
        let Some(last) = self.last.replace(Reading { counter, asked }) else { return false };
        let elapsed = answered.saturating_duration_since(last.asked).as_nanos();
        let most = u64::try_from(elapsed / SHORTEST_CYCLE.as_nanos()).unwrap_or(VALUES);
        let may_have_gone_round = last.counter.saturating_add(most) >= VALUES;
        let was_reset = counter < last.counter && !may_have_gone_round;
        self.count += u64::from(was_reset);
        was_reset
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Resets that two readings tell of: these counters, `apart`.
    fn counted(first: u64, second: u64, apart: Duration) -> u64 {
        let mut resets = Resets::default();
        let start = Instant::now();
        resets.counter_is(first, start, start);
        resets.counter_is(second, start + apart, start + apart);
        resets.count()
    }

    #[test]
    fn a_servo_counter_that_goes_back_tells_of_a_reset() {
        let second = Duration::from_secs(1);
        // A usual servo, a slow simulator, one that stands still, and one that is faster than believed.
        for advance in [2259, 100, 0, 40_000] {
            for first in [0, 5, 1_000_000, VALUES - 1000, VALUES - 1] {
                assert_eq!(counted(first, (first + advance) % VALUES, second), 0, "{first} and {advance}");
            }
        }
        assert_eq!(counted(1000, 500, second), 1);
        assert_eq!(counted(1_000_000, 2259, second), 1);
        assert_eq!(counted(7, 5, Duration::ZERO), 1);
        assert_eq!(counted(VALUES - 1, 5, second), 0, "it may have gone round");
        assert_eq!(counted(100_000, 5, Duration::from_secs(400)), 0, "it may have gone round");
        let mut resets = Resets::default();
        for (seen, is_live, doubts) in [(0, true, 0), (0, false, 1), (1, true, 2), (1, true, 2)] {
            resets.bus_sees(seen, is_live, Instant::now());
            assert_eq!((resets.doubts(), resets.count()), (doubts, 0));
        }
    }
}
