//! Whether the servo report runs, seen by its timer: a word that changes with every update, and that nobody else writes.

use std::time::{Duration, Instant};

use super::{Done, Step};
use crate::map::Family;

/// Looks at the timer until it has changed, or for so long. A board that is slow with a command may pause its report: only a
/// timer that stands still all the time is one of a report that does not run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ReportWatch {
    until: Instant,
    first: Option<u16>,
}

/// What the looks so far say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Seen {
    /// Nothing yet.
    Nothing,
    /// The report runs.
    Runs,
    /// It does not.
    Stands,
}

impl ReportWatch {
    /// How often to look.
    pub(super) const LOOK: Duration = Duration::from_millis(5);

    /// Looks until then.
    pub(super) const fn new(until: Instant) -> Self {
        Self { until, first: None }
    }

    /// The step that looks once.
    pub(super) fn look(family: &Family, timeout: Duration) -> Step {
        Step::Read { first: family.servo.timer.low, count: 1, timeout }
    }

    /// Takes what a look has found.
    pub(super) fn see(&mut self, done: &Done, now: Instant) -> Seen {
        let found = done.words.first().copied();
        let moved = found.is_some_and(|word| *self.first.get_or_insert(word) != word);
        match moved {
            true => Seen::Runs,
            false if now >= self.until => Seen::Stands,
            false => Seen::Nothing,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::shared::queue::Outcome;

    #[test]
    fn b1_4_a_report_that_pauses_runs() {
        let began = Instant::now();
        let look = |watch: &mut ReportWatch, ms, word| {
            let done = Done {
                outcome: Outcome::Done,
                result: Ok(Vec::new()),
                resets: 0,
                doubts: 0,
                rotary: None,
                words: vec![word],
                gathers: None,
                programs_run: None,
                ended_by: None,
            };
            watch.see(&done, began + Duration::from_millis(ms))
        };
        let mut watch = ReportWatch::new(began + Duration::from_secs(1));
        assert_eq!(look(&mut watch, 0, 7), Seen::Nothing);
        assert_eq!(look(&mut watch, 250, 7), Seen::Nothing, "the pause of a slow board");
        assert_eq!(look(&mut watch, 255, 600), Seen::Runs);
        let mut watch = ReportWatch::new(began + Duration::from_secs(1));
        assert_eq!([look(&mut watch, 0, 7), look(&mut watch, 1000, 7)], [Seen::Nothing, Seen::Stands]);
    }
}
