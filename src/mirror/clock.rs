//! When the next servo update is due: a phase-locked estimate from the updates seen so far.
//!
//! Polling costs a bus access, and on real hardware bus accesses are the cost. A poll that comes a little early costs
//! one access; one that comes late delays the data, and one that comes a whole period late loses an update. So the
//! clock aims just before the predicted update, polls again shortly after as long as nothing has come, and learns
//! phase and period from when it came.

/// Nanoseconds.
type Ns = u64;

const MICROSECOND: Ns = 1_000;
const MILLISECOND: Ns = 1_000_000;

/// How far a phase error moves the next prediction, and how far the spacing of two updates moves the period.
const PHASE_GAIN: f64 = 0.25;
const PERIOD_GAIN: f64 = 0.02;
/// Every update found at the first poll moves the aim earlier by this part of a period, by at most so many ns. Without
/// it the polls could come later and later, and nothing would show it.
const NUDGE: f64 = 1.0 / 64.0;
const NUDGE_NS: f64 = 20_000.0;
/// This many updates in a row that came much too early mean that the period is wrong. Only a period longer than twice
/// [`RARE_POLL`] is judged so: shorter ones are learnt fast enough, and a simulated board that catches up makes updates in
/// quick succession although its period has not changed.
const HURRIED: u8 = 3;
/// Without an update for this many periods (and at least [`SILENCE`]) there is no phase to hold.
const LOCK_PERIODS: f64 = 20.0;
const SILENCE: Ns = 50 * MILLISECOND;
/// After so long the board is no longer expected to go on any moment.
const LONG_SILENCE: Ns = 1_000 * MILLISECOND;
/// How good the prediction is, as a part of a period: an empty poll that near to it was early.
const AIM: f64 = 1.0 / 8.0;
/// The time between polls while an update is due: a sixteenth of a period, within these limits.
const POLL_AGAIN: std::ops::RangeInclusive<Ns> = 10 * MICROSECOND..=30 * MICROSECOND;
/// An update found after at least `LATE_POLLS` empty polls and more than `LATE` of a period late is an outlier: the board,
/// or a machine that simulates it, was held up. Its phase error counts as `LATE`, unless `LATE_IN_A_ROW` outliers follow each
/// other. Otherwise a late update now and then would keep the phase late for good, because only nudges move it earlier.
/// One empty poll is normal: the clock aims to come just in time.
const LATE_POLLS: u8 = 2;
const LATE: f64 = 1.0 / 16.0;
const LATE_IN_A_ROW: u8 = 3;
/// The longest time between polls, whatever the prediction says, so that a period that became much shorter is noticed.
/// One access a millisecond costs nothing. Where updates are rarer, one poll halfway is enough, but no rarer than
/// [`RARE_POLL`]: a configured period may be wrong.
const IDLE_POLL: Ns = MILLISECOND;
const RARE_POLL: Ns = 10 * MILLISECOND;

/// Predicts updates that come at a nearly constant period.
#[derive(Debug, Clone, Default)]
pub struct UpdateClock {
    /// The time between updates; 0 while unknown.
    period_ns: f64,
    /// The predicted time of the next update, while locked.
    predicted_ns: Option<f64>,
    /// The last update seen.
    last_update_ns: Option<Ns>,
    /// So many updates in a row came less than half a period after the one before.
    hurried: u8,
    /// So many updates in a row came much too late.
    late: u8,
    /// Empty polls since the next update was due.
    late_polls: u8,
    /// The last poll that found nothing since the last update.
    last_early_ns: Option<Ns>,
    due_ns: Ns,
}

impl UpdateClock {
    /// Takes a period from elsewhere (I10 and I19), if none has been learnt or it differs by more than a tenth.
    pub fn expect_period(&mut self, period_ns: Ns) {
        let period = period_ns as f64;
        if self.period_ns == 0.0 || (self.period_ns / period - 1.0).abs() > 0.1 {
            self.period_ns = period;
            self.predicted_ns = None;
        }
    }

    /// When to poll next, CLOCK_MONOTONIC.
    #[must_use]
    pub fn due_ns(&self) -> Ns {
        self.due_ns
    }

    /// The time between updates as far as known.
    #[must_use]
    pub fn period_ns(&self) -> Option<Ns> {
        (self.period_ns > 0.0).then_some(self.period_ns as Ns)
    }

    /// When the last update seen was made: what the phase says, whenever it was found. None without a phase.
    #[must_use]
    pub fn update_ns(&self) -> Option<Ns> {
        self.predicted_ns.map(|predicted| (predicted - self.period_ns).max(0.0) as Ns)
    }

    /// A poll at `now` found nothing new.
    pub fn poll_empty(&mut self, now: Ns) {
        self.last_early_ns = Some(now);
        if self.predicted_ns.is_some_and(|predicted| now as f64 >= predicted) {
            self.late_polls = self.late_polls.saturating_add(1);
        }
        let silent = self.last_update_ns.map_or(Ns::MAX, |last| now.saturating_sub(last));
        if silent > SILENCE.max((LOCK_PERIODS * self.period_ns) as Ns) {
            self.predicted_ns = None;
        }
        let again = match self.predicted_ns {
            Some(predicted) => self.wait_for(predicted, now),
            None if self.period_ns > 0.0 && silent <= LONG_SILENCE => (self.period_ns / 4.0) as Ns,
            None => IDLE_POLL,
        };
        self.due_ns = now + again.clamp(*POLL_AGAIN.start(), self.longest_wait());
    }

    /// From an empty poll to the next: soon while the update may come any moment, and the later the longer it has failed to
    /// come, but at the times when the ones after it would come. A board that leaves updates out is not asked for each as
    /// if it were late; and a simulated one that shares the processor gets it.
    fn wait_for(&self, predicted: f64, now: Ns) -> Ns {
        let soon = ((self.period_ns / 16.0) as Ns).clamp(*POLL_AGAIN.start(), *POLL_AGAIN.end());
        let late = now as f64 - predicted;
        if late < 0.0 {
            return soon.max(-late as Ns);
        }
        let since_due = late % self.period_ns;
        let patience = (since_due / 2.0).max((late - self.period_ns) / 8.0).min(self.period_ns / 2.0);
        soon.max(patience as Ns).min((self.period_ns - since_due) as Ns)
    }

    /// A poll at `now` found an update, the `updates`-th after the last one seen (1: none was missed).
    pub fn on_update(&mut self, now: Ns, updates: u64) {
        let updates = updates.max(1) as f64;
        let at = now as f64;
        let elapsed = self.last_update_ns.map(|last| at - last as f64);
        let is_long = self.period_ns > 2.0 * RARE_POLL as f64;
        let is_hurried = is_long && elapsed.is_some_and(|elapsed| elapsed < updates * self.period_ns / 2.0);
        self.hurried = if is_hurried { self.hurried + 1 } else { 0 };
        if self.hurried == HURRIED {
            self.hurried = 0;
            self.period_ns = 0.0;
            self.predicted_ns = None;
        }
        match (self.predicted_ns, elapsed) {
            (Some(predicted), Some(elapsed)) if updates < LOCK_PERIODS => {
                // The prediction was for the update nearest to this poll, also if one came before it unseen.
                let behind = ((at - predicted) / self.period_ns).floor().max(0.0);
                let predicted = predicted + behind * self.period_ns;
                let early = self.last_early_ns.map(|early| early as f64);
                let error = match early.filter(|early| *early > predicted - AIM * self.period_ns) {
                    // It came between two polls; take the middle.
                    Some(early) => (at + early) / 2.0 - predicted,
                    None => -(NUDGE * self.period_ns).min(NUDGE_NS),
                };
                let much = LATE * self.period_ns;
                let is_late = error > much && self.late_polls >= LATE_POLLS;
                self.late = if is_late { self.late.saturating_add(1) } else { 0 };
                let most = if (1..LATE_IN_A_ROW).contains(&self.late) { much } else { self.period_ns };
                let error = error.clamp(-self.period_ns, most);
                // Polls come late by a bounded time, so the spacing of updates is right in the long run, whatever
                // the phase; a period learnt from the phase error could settle on a wrong one.
                self.period_ns += PERIOD_GAIN * (elapsed - updates * self.period_ns);
                self.predicted_ns = Some(predicted + PHASE_GAIN * error + self.period_ns);
            }
            (_, Some(elapsed)) => {
                let period = elapsed / updates;
                if self.period_ns == 0.0 {
                    self.period_ns = period;
                }
                self.predicted_ns = Some(at + self.period_ns);
            }
            (_, None) => self.predicted_ns = (self.period_ns > 0.0).then_some(at + self.period_ns),
        }
        // Whole periods behind (the machine stood still): the phase is still good, the next update is ahead.
        if let Some(predicted) = &mut self.predicted_ns
            && self.period_ns > 0.0
            && *predicted < at
        {
            *predicted += ((at - *predicted) / self.period_ns).ceil() * self.period_ns;
        }
        self.last_update_ns = Some(now);
        self.last_early_ns = None;
        self.late_polls = 0;
        self.due_ns = match self.predicted_ns {
            Some(predicted) => (predicted as Ns).clamp(now, now + self.longest_wait()),
            None => now + IDLE_POLL,
        };
    }

    /// From one poll to the next at most.
    fn longest_wait(&self) -> Ns {
        let half = if self.predicted_ns.is_some() { self.period_ns / 2.0 } else { 0.0 };
        (half as Ns).clamp(IDLE_POLL, RARE_POLL)
    }
}

#[cfg(test)]
#[path = "clock_tests.rs"]
mod tests;
