//! Follows every servo update, and says what is missing between two.

use crate::client::{Board, ClientError, Staleness, View, identity};
use crate::decode::ServoData;
use crate::segment::RegionId;

/// The most updates to take at once: a fraction of what the segment keeps.
const BATCH: usize = 512;

/// What comes next.
#[derive(Debug, Clone, PartialEq)]
pub enum Step {
    /// An update.
    Update(View<ServoData>),
    /// Before the next one, something is missing.
    Gap(Gap),
}

/// Updates that are missing between two. Where both numbers are 0, board or daemon paused, or was started again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Gap {
    /// Updates that the daemon did not read in time.
    pub missed: u64,
    /// Updates that this program did not take, or could not write, in time.
    pub lost: u64,
}

/// What is kept of the update before.
#[derive(Debug, Clone, Copy)]
struct Last {
    sequence: u64,
    servo_timer: u64,
    time_ns: u64,
}

/// What is needed to know how many updates lie between two.
#[derive(Debug, Clone, Copy, Default)]
struct Pace {
    /// Servo cycles from update to update; `None` where there is no period.
    cycles: Option<u64>,
    /// A longer silence is a pause of the board: what it did meanwhile is no update that could have been missed.
    pause_ns: u64,
}

/// A reader of every servo update.
pub struct Follower {
    generation: u64,
    next: u64,
    last: Option<Last>,
}

impl Follower {
    /// Begins with the next update of `board`.
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn new(board: &mut Board) -> Result<Self, ClientError> {
        board.refresh()?;
        let next = board.servo_sequence()? + 1;
        Ok(Self { generation: board.subscriber().generation(), next, last: None })
    }

    /// Hands the updates that have come to `take`, and returns why there is nothing live after them.
    ///
    /// # Errors
    /// [`ClientError`], or what `take` returns.
    pub fn advance<E: From<ClientError>>(
        &mut self,
        board: &mut Board,
        mut take: impl FnMut(Step) -> Result<(), E>,
    ) -> Result<Option<Staleness>, E> {
        loop {
            board.refresh()?;
            let generation = board.subscriber().generation();
            let restarted = generation != self.generation;
            if restarted {
                (self.generation, self.next) = (generation, 1);
            }
            let pace = pace(board)?;
            let history = board.history(self.next, BATCH)?;
            if history.samples.is_empty() {
                return Ok(board.snapshot()?.servo.and_then(|servo| servo.stale));
            }
            let was_last = if restarted { None } else { self.last };
            if restarted && self.last.is_some() {
                take(Step::Gap(Gap::default()))?;
            }
            self.last = was_last;
            for view in history.samples {
                if let Some(gap) = self.last.and_then(|last| gap(last, &view, pace)) {
                    take(Step::Gap(gap))?;
                }
                let View { sequence, servo_timer, time_ns, .. } = view;
                self.last = Some(Last { sequence, servo_timer, time_ns });
                take(Step::Update(view))?;
            }
            self.next = history.next;
        }
    }
}

fn pace(board: &mut Board) -> Result<Pace, ClientError> {
    let identity = board.identity()?;
    let region = board.subscriber().region(RegionId::Servo)?;
    let cycle_ns = identity::scales(&identity).servo_period_ns();
    let cycles = cycle_ns.map(|cycle_ns| (region.period_ns as f64 / cycle_ns).round() as u64);
    Ok(Pace { cycles: cycles.filter(|cycles| *cycles > 0), pause_ns: region.stale_after_ns })
}

/// What is missing between the update `last` and `view`.
fn gap(last: Last, view: &View<ServoData>, pace: Pace) -> Option<Gap> {
    between(last, (view.sequence, view.servo_timer, view.time_ns), pace)
}

fn between(last: Last, (sequence, servo_timer, time_ns): (u64, u64, u64), pace: Pace) -> Option<Gap> {
    let lost = sequence.saturating_sub(last.sequence).saturating_sub(1);
    let silence_ns = time_ns.saturating_sub(last.time_ns);
    let is_pause = servo_timer <= last.servo_timer || (lost == 0 && silence_ns >= pace.pause_ns);
    let passed = servo_timer.saturating_sub(last.servo_timer);
    let made = pace.cycles.filter(|cycles| !is_pause && passed.is_multiple_of(*cycles)).map(|c| passed / c);
    let missed = made.map_or(0, |made| made.saturating_sub(1 + lost));
    (is_pause || lost > 0 || missed > 0).then_some(Gap { missed, lost })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_missing_between_two_updates_is_counted() {
        let last = Last { sequence: 7, servo_timer: 1000, time_ns: 0 };
        let pace = Pace { cycles: Some(2), pause_ns: 100_000 };
        let gap = |at| between(last, at, pace).map(|gap| (gap.missed, gap.lost));
        assert_eq!(gap((8, 1002, 900)), None);
        assert_eq!(gap((8, 1010, 4500)), Some((4, 0)), "the daemon did not see four");
        assert_eq!(gap((11, 1010, 4500)), Some((1, 3)), "three of four were seen by the daemon");
        assert_eq!(gap((12, 1010, 4500)), Some((0, 4)));
        assert_eq!(gap((8, 9000, 200_000)), Some((0, 0)), "the board made no report");
        assert_eq!(gap((8, 4, 900)), Some((0, 0)), "the board was reset");
        assert_eq!(gap((5000, 11_000, 200_000)), Some((7, 4992)), "this program was stopped");
        assert_eq!(
            between(last, (8, 1013, 900), Pace { cycles: None, ..pace }),
            None,
            "a report without a period"
        );
    }
}
