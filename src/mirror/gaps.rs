//! How many updates lie between two that were read: the servo timer tells, exactly.

/// Deltas looked at before a period that nobody told is taken as learnt.
const LEARN: u64 = 32;

/// Turns servo cycles passed into updates made.
#[derive(Debug, Clone, Default)]
pub struct UpdateCounter {
    /// Servo cycles from update to update (I19); 0 while unknown.
    cycles: u32,
    /// While unknown: the smallest step, how many there were, and all of them together.
    smallest: u64,
    seen: u64,
    passed: u64,
}

impl UpdateCounter {
    /// Takes the period in servo cycles (I19) as told by the board. What passed while it was unknown is counted with
    /// the next update.
    pub fn expect_cycles(&mut self, cycles: u32) {
        self.cycles = cycles;
    }

    /// Servo cycles from update to update, as far as known.
    #[must_use]
    pub fn cycles(&self) -> Option<u32> {
        (self.cycles > 0).then_some(self.cycles)
    }

    /// How many updates the board made in `passed` servo cycles, at least the one that was read. While the period is
    /// unknown nothing can be said about gaps; they are made up for as soon as it is known.
    pub fn updates(&mut self, passed: u64) -> u64 {
        let passed = passed.max(1);
        if self.cycles > 0 && !passed.is_multiple_of(u64::from(self.cycles)) {
            // I19 was changed: learn it anew.
            self.cycles = 0;
        }
        if self.cycles > 0 {
            return passed / u64::from(self.cycles) + self.catch_up();
        }
        self.smallest = if self.seen == 0 { passed } else { self.smallest.min(passed) };
        self.seen += 1;
        self.passed += passed;
        if self.seen < LEARN {
            return 1;
        }
        self.cycles = u32::try_from(self.smallest).unwrap_or(u32::MAX);
        1 + self.catch_up()
    }

    /// The updates not read while the period was unknown, once.
    fn catch_up(&mut self) -> u64 {
        let made = self.passed / u64::from(self.cycles.max(1));
        let owed = made.saturating_sub(self.seen);
        (self.seen, self.passed) = (0, 0);
        owed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_told_period_counts_exactly() {
        let mut counter = UpdateCounter::default();
        counter.expect_cycles(3);
        assert_eq!(counter.updates(3), 1);
        assert_eq!(counter.updates(12), 4);
        assert_eq!(counter.updates(3 * 40_000), 40_000);
    }

    #[test]
    fn an_unknown_period_is_learnt_and_the_gaps_of_that_time_are_made_up_for() {
        let mut counter = UpdateCounter::default();
        let counted: u64 = (0..LEARN).map(|k| counter.updates(if k == 5 { 20 } else { 2 })).sum();
        assert_eq!((counter.cycles(), counted), (Some(2), LEARN + 9));
        assert_eq!(counter.updates(4), 2);
        let counted: u64 = (0..LEARN).map(|_| counter.updates(5)).sum();
        assert_eq!((counter.cycles(), counted), (Some(5), LEARN));
        assert_eq!(counter.updates(15), 3);
    }

    #[test]
    fn a_period_told_in_between_settles_what_passed_before() {
        let mut counter = UpdateCounter::default();
        assert_eq!(counter.updates(1) + counter.updates(1000), 2);
        counter.expect_cycles(1);
        assert_eq!(counter.updates(1), 1 + 999);
        assert_eq!(counter.updates(1), 1);
    }
}
