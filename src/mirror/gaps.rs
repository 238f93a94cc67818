//! How many updates the board made between two reads; the servo timer tells exactly.

/// After so many steps the mirror counts a period as learnt, if the board has not told it.
const LEARN: u64 = 32;
/// A step that came less often among them is no period.
const RARE: u64 = LEARN / 4;
/// After so many updates without a period from the board the mirror forgets the steps, and their gaps stay uncounted.
const REMEMBERED: u64 = 1 << 16;

/// The known facts about the servo cycles from update to update.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Period {
    #[default]
    Unknown,
    /// No period: the board makes an update on request, or in its background cycle.
    Absent,
    Cycles(u32),
}

/// Turns elapsed servo cycles into numbers of updates.
#[derive(Debug, Clone, Default)]
pub struct UpdateCounter {
    period: Period,
    /// The board's last answer; 0 for no period.
    told: u32,
    /// While the period is unknown: the smallest step and its count, the common divisor of all steps, their number, and
    /// their sum.
    smallest: u64,
    smallest_seen: u64,
    divisor: u64,
    seen: u64,
    passed: u64,
    /// Learn the period only after the board has told one.
    must_be_told: bool,
}

impl UpdateCounter {
    /// The counter for a board that may make each update when the host has taken the last one: the steps are then those
    /// of the host's own polls, and tell no period.
    #[must_use]
    pub fn told() -> Self {
        Self { must_be_told: true, ..Self::default() }
    }

    /// Whether any servo cycle may bring an update.
    #[must_use]
    pub fn is_untold(&self) -> bool {
        self.must_be_told && self.period == Period::Unknown
    }

    /// Takes the period in servo cycles (I19, on a Turbo I47) from the board. The next update also counts the gaps of
    /// the time while the period was unknown. 0 is no period: every read update counts as 1.
    pub fn expect_cycles(&mut self, cycles: u32) {
        self.period = if cycles == 0 { Period::Absent } else { Period::Cycles(cycles) };
        self.told = cycles;
        self.must_be_told &= cycles == 0;
    }

    /// Servo cycles from update to update, if known.
    #[must_use]
    pub fn cycles(&self) -> Option<u32> {
        match self.period {
            Period::Cycles(cycles) => Some(cycles),
            Period::Unknown | Period::Absent => None,
        }
    }

    /// The number of updates that the board made in `passed` servo cycles, the read one included. While the period is
    /// unknown, gaps stay uncounted; the first known period makes up for them.
    pub fn updates(&mut self, passed: u64) -> u64 {
        let passed = passed.max(1);
        match self.period {
            Period::Absent => {
                self.forget();
                return 1;
            }
            Period::Cycles(cycles) if passed.is_multiple_of(cycles.into()) => {
                return passed / u64::from(cycles) + self.catch_up(cycles);
            }
            // Unknown, or changed since: learn the period anew.
            Period::Cycles(_) | Period::Unknown => self.period = Period::Unknown,
        }
        if self.seen == 0 || passed < self.smallest {
            (self.smallest, self.smallest_seen) = (passed, 0);
        }
        self.smallest_seen += u64::from(passed == self.smallest);
        self.divisor = if self.seen == 0 { passed } else { greatest_divisor(self.divisor, passed) };
        self.seen += 1;
        self.passed += passed;
        if self.must_be_told {
            if self.seen >= REMEMBERED {
                self.forget();
            }
            return 1;
        }
        if self.seen < LEARN {
            return 1;
        }
        let is_rare = self.smallest_seen < RARE && self.smallest != u64::from(self.told);
        if self.divisor != self.smallest || is_rare {
            // Steps that are no multiples of the smallest have no period, like those of a report by background cycles.
            // A step that came only a few times is no period: it may be a single update out of turn, unless the board
            // told it.
            self.forget();
            return 1;
        }
        let cycles = u32::try_from(self.smallest).unwrap_or(u32::MAX);
        self.period = Period::Cycles(cycles);
        1 + self.catch_up(cycles)
    }

    /// The updates that the mirror missed while the period was unknown; counted once.
    fn catch_up(&mut self, cycles: u32) -> u64 {
        let owed = (self.passed / u64::from(cycles)).saturating_sub(self.seen);
        self.forget();
        owed
    }

    fn forget(&mut self) {
        (self.seen, self.passed) = (0, 0);
    }
}

/// The greatest number that divides both, neither of them 0.
const fn greatest_divisor(mut a: u64, mut b: u64) -> u64 {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
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
    fn one_update_out_of_turn_is_no_period() {
        let mut counter = UpdateCounter::default();
        counter.expect_cycles(10);
        let steps = |counter: &mut UpdateCounter, first: u64| {
            (0..LEARN).map(|k| counter.updates(if k == 0 { first } else { 10 })).sum::<u64>()
        };
        assert_eq!((steps(&mut counter, 1), counter.cycles()), (LEARN, None));
        assert_eq!((steps(&mut counter, 10), counter.cycles()), (LEARN, Some(10)));
        assert_eq!(counter.updates(20), 2);
    }

    #[test]
    fn a_period_told_in_between_settles_what_passed_before() {
        let mut counter = UpdateCounter::default();
        assert_eq!(counter.updates(1) + counter.updates(1000), 2);
        counter.expect_cycles(1);
        assert_eq!(counter.updates(1), 1 + 999);
        assert_eq!(counter.updates(1), 1);
    }

    #[test]
    fn steps_without_a_period_are_one_update_each() {
        // Turbo User Manual p. 403: in the background "when more than I50 servo cycles have passed", at some pass.
        let steps = [11, 12, 11, 14, 23, 11, 13];
        let irregular = |counter: &mut UpdateCounter, count: usize| {
            steps.iter().cycle().take(count).map(|step| counter.updates(*step)).sum::<u64>()
        };
        let mut counter = UpdateCounter::default();
        assert_eq!((irregular(&mut counter, 1000), counter.cycles()), (1000, None), "learnt");
        counter.expect_cycles(0);
        assert_eq!((irregular(&mut counter, 1000), counter.cycles()), (1000, None), "told");
        assert_eq!((0..LEARN).map(|k| counter.updates(10 + 10 * (k % 2))).sum::<u64>(), LEARN, "by chance");
        counter.expect_cycles(10);
        assert_eq!((counter.updates(30), counter.cycles()), (3, Some(10)), "and nothing is made up for");
    }
}
