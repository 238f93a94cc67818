//! How many updates lie between two that were read: the servo timer tells, exactly.

/// Deltas looked at before a period that nobody told is taken as learnt.
const LEARN: u32 = 32;

/// Turns servo cycles passed into updates made.
#[derive(Debug, Clone, Default)]
pub struct UpdateCounter {
    /// Servo cycles from update to update (I19); 0 while unknown.
    cycles: u32,
    smallest: u32,
    seen: u32,
}

impl UpdateCounter {
    /// Takes the period in servo cycles (I19) as told by the board; 0 forgets it.
    pub fn expect_cycles(&mut self, cycles: u32) {
        *self = Self { cycles, ..Self::default() };
    }

    /// Servo cycles from update to update, as far as known.
    #[must_use]
    pub fn cycles(&self) -> Option<u32> {
        (self.cycles > 0).then_some(self.cycles)
    }

    /// How many updates the board made in `passed` servo cycles, at least the one that was read.
    pub fn updates(&mut self, passed: u64) -> u64 {
        let passed = passed.max(1);
        if self.cycles > 0 && passed.is_multiple_of(u64::from(self.cycles)) {
            return passed / u64::from(self.cycles);
        }
        // Unknown, or I19 was changed: the smallest step seen in a while is the period. Until then nothing can be
        // said about gaps, and nothing is.
        self.cycles = 0;
        let step = u32::try_from(passed).unwrap_or(u32::MAX);
        self.smallest = if self.seen == 0 { step } else { self.smallest.min(step) };
        self.seen += 1;
        if self.seen >= LEARN {
            self.cycles = self.smallest;
            self.seen = 0;
        }
        1
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
    fn an_unknown_period_is_learnt_and_a_changed_one_learnt_anew() {
        let mut counter = UpdateCounter::default();
        for k in 0..LEARN {
            assert_eq!(counter.updates(if k == 5 { 2 } else { 4 }), 1);
        }
        assert_eq!(counter.cycles(), Some(2));
        assert_eq!(counter.updates(4), 2);
        for _ in 0..LEARN {
            assert_eq!(counter.updates(5), 1);
        }
        assert_eq!(counter.updates(15), 3);
    }
}
