//! Follows every servo update, and counts the missing updates between two.

use std::time::Duration;

use super::{Board, ClientError, Staleness, View, identity};
use crate::decode::ServoData;
use crate::segment::RegionId;

/// The most updates of one step: a fraction of the segment's ring.
const BATCH: usize = 512;

/// By so many servo cycles an update may seem early: the daemon was held up between clock and board.
const SLACK: f64 = 64.0;

/// The next event.
#[derive(Debug, Clone, PartialEq)]
pub enum Step {
    /// An update.
    Update(View<ServoData>),
    /// Before the next update, updates are missing.
    Gap(Gap),
}

/// The gap between two updates: updates are missing, or, if both numbers are 0, board or daemon paused or restarted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Gap {
    /// Updates that the daemon did not read in time.
    pub missed: u64,
    /// Updates that this program was too slow to take or write.
    pub lost: u64,
    /// How long board or daemon paused here. Nothing counts the board's updates in that time: they are not in `missed`.
    pub pause: Option<Duration>,
}

/// The facts about the last update that the next one needs.
#[derive(Debug, Clone, Copy)]
struct Last {
    servo_timer: u64,
    time_ns: u64,
}

/// The pace by which missing updates are counted.
#[derive(Debug, Clone, Copy, Default)]
struct Pace {
    /// Servo cycles from update to update; `None` without a period.
    cycles: Option<u64>,
    /// The length of a servo cycle; `None` while unknown.
    cycle_ns: Option<f64>,
    /// A longer silence is a pause of the board, with no updates to miss.
    pause_ns: u64,
}

/// Reads every servo update of the present daemon and of its successors.
#[derive(Debug)]
pub struct Follower {
    generation: u64,
    next: u64,
    last: Option<Last>,
    /// When the previous daemon's last update came; `None` after the present daemon's first update.
    restarted: Option<u64>,
    /// The last known length of a servo cycle: at a reset the daemon forgets it until the board answers again.
    cycle_ns: Option<f64>,
}

impl Follower {
    /// Begins with the next update of `board`.
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn new(board: &mut Board) -> Result<Self, ClientError> {
        board.refresh()?;
        let next = board.servo_sequence()? + 1;
        Ok(Self {
            generation: board.subscriber().generation(),
            next,
            last: None,
            restarted: None,
            cycle_ns: None,
        })
    }

    /// The number of the next update.
    #[must_use]
    pub fn next(&self) -> u64 {
        self.next
    }

    /// Hands new updates to `take`, and returns why the last data are not live.
    ///
    /// # Errors
    /// [`ClientError`], or the error of `take`.
    pub fn advance<E: From<ClientError>>(
        &mut self,
        board: &mut Board,
        mut take: impl FnMut(Step) -> Result<(), E>,
    ) -> Result<Option<Staleness>, E> {
        while self.advance_some(board, &mut take)? {}
        Ok(board.snapshot()?.servo.and_then(|servo| servo.stale))
    }

    /// Hands some new updates to `take`, each after its gap. Returns whether there were any.
    ///
    /// # Errors
    /// As [`Follower::advance`].
    pub fn advance_some<E: From<ClientError>>(
        &mut self,
        board: &mut Board,
        mut take: impl FnMut(Step) -> Result<(), E>,
    ) -> Result<bool, E> {
        board.refresh()?;
        let generation = board.subscriber().generation();
        if generation != self.generation {
            (self.generation, self.next) = (generation, 1);
            self.restarted = self.last.take().map(|last| last.time_ns).or(self.restarted);
        }
        let pace = self.pace(board)?;
        let history = board.history(self.next, BATCH)?;
        let came = !history.samples.is_empty();
        for view in history.samples {
            let View { sequence, servo_timer, time_ns, .. } = view;
            let lost = sequence.saturating_sub(self.next);
            let gap = match self.last {
                Some(last) => between(last, (servo_timer, time_ns), lost, pace),
                None => {
                    let pause = self.restarted.take().map(|last_ns| pause(last_ns, time_ns));
                    (pause.is_some() || lost > 0).then_some(Gap { missed: 0, lost, pause })
                }
            };
            self.last = Some(Last { servo_timer, time_ns });
            self.next = sequence + 1;
            if let Some(gap) = gap {
                take(Step::Gap(gap))?;
            }
            take(Step::Update(view))?;
        }
        Ok(came)
    }

    fn pace(&mut self, board: &mut Board) -> Result<Pace, ClientError> {
        let identity = board.identity()?;
        let region = board.subscriber().region(RegionId::Servo)?;
        self.cycle_ns = identity::scales(&identity).servo_period_ns().or(self.cycle_ns);
        let cycles = cycles(identity.servo_report_cycles, self.cycle_ns, region.period_ns);
        Ok(Pace { cycles, cycle_ns: self.cycle_ns, pause_ns: region.stale_after_ns })
    }
}

/// Servo cycles from update to update, by the board's answer; without an answer, by the period that `pmacd` measures,
/// which grows when many updates are missed.
fn cycles(told: Option<u32>, cycle_ns: Option<f64>, period_ns: u64) -> Option<u64> {
    let measured = || cycle_ns.map(|cycle_ns| (period_ns as f64 / cycle_ns).round() as u64);
    told.map(u64::from).or_else(measured).filter(|cycles| *cycles > 0)
}

/// The gap between `last` and the next update that this program takes, if `lost` numbers are missing.
fn between(last: Last, (servo_timer, time_ns): (u64, u64), lost: u64, pace: Pace) -> Option<Gap> {
    let silence_ns = time_ns.saturating_sub(last.time_ns);
    let passed = servo_timer.saturating_sub(last.servo_timer);
    let is_pause = passed == 0
        || lost == 0 && silence_ns >= pace.pause_ns
        || pace.cycle_ns.is_some_and(|cycle_ns| passed as f64 > fitting(silence_ns, cycle_ns));
    let made = pace.cycles.filter(|cycles| !is_pause && passed.is_multiple_of(*cycles)).map(|c| passed / c);
    let missed = made.map_or(0, |made| made.saturating_sub(1 + lost));
    let pause = is_pause.then(|| pause(last.time_ns, time_ns));
    (is_pause || lost > 0 || missed > 0).then_some(Gap { missed, lost, pause })
}

/// How long the pause between two updates was.
fn pause(last_ns: u64, next_ns: u64) -> Duration {
    Duration::from_nanos(next_ns.saturating_sub(last_ns))
}

/// The most servo cycles that can pass in a time. A timer that shows more has restarted, at a reset.
fn fitting(time_ns: u64, cycle_ns: f64) -> f64 {
    1.25 * time_ns as f64 / cycle_ns + SLACK
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_between_two_updates_is_counted() {
        let last = Last { servo_timer: 1000, time_ns: 0 };
        let pace = Pace { cycles: Some(2), cycle_ns: Some(450.0), pause_ns: 100_000 };
        let gap = |lost, at| between(last, at, lost, pace).map(|gap| (gap.missed, gap.lost));
        assert_eq!(gap(0, (1002, 900)), None);
        assert_eq!(gap(0, (1010, 4500)), Some((4, 0)), "the daemon did not see four");
        assert_eq!(gap(3, (1010, 4500)), Some((1, 3)), "three of four were seen by the daemon");
        assert_eq!(gap(4, (1010, 4500)), Some((0, 4)));
        assert_eq!(gap(0, (9000, 200_000)), Some((0, 0)), "the board made no report");
        assert_eq!(gap(0, (4, 900)), Some((0, 0)), "the board was reset");
        assert_eq!(gap(0, (21_000, 900)), Some((0, 0)), "the same, and its timer was carried on");
        assert_eq!(gap(4992, (11_000, 4_500_000)), Some((7, 4992)), "this program was stopped");
        let pause = |lost, at| between(last, at, lost, pace).unwrap().pause;
        assert_eq!(
            pause(0, (9000, 200_000)),
            Some(Duration::from_micros(200)),
            "its updates are in no number"
        );
        assert_eq!((pause(0, (1010, 4500)), pause(4, (1010, 4500))), (None, None));
        assert_eq!(
            between(last, (1013, 900), 0, Pace { cycles: None, ..pace }),
            None,
            "a report without a period"
        );
    }

    #[test]
    fn what_the_board_told_counts_and_not_how_often_updates_came() {
        let (cycle_ns, every_second_missed) = (Some(442_708.0), 885_416);
        assert_eq!(cycles(Some(1), cycle_ns, every_second_missed), Some(1));
        assert_eq!(cycles(None, cycle_ns, every_second_missed), Some(2));
        assert_eq!(cycles(Some(0), cycle_ns, every_second_missed), None, "a report without a period");
        assert_eq!(cycles(None, None, every_second_missed), None);
    }
}
