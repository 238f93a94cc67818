//! When the next servo update is due, from the updates seen so far.
//!
//! Each poll costs a bus access, and on real hardware accesses are the cost. A poll that is a little early costs one
//! access. A poll that is late delays the data, and one that is a whole period late loses an update. The machine can
//! hold up any poll by any time, so lateness only ever adds. The clock keeps two things apart:
//!
//! - The grid is when the board makes its updates. It comes from the earliest finds (`window`).
//! - The aim is when to poll. An update found at the first poll moves it a little earlier, an empty poll moves it
//!   further back. So one first poll in six is empty until the aim is found, then one in fourteen, however late this
//!   machine wakes up; a poll that is milliseconds late counts no more than any other. An empty poll costs a wake-up.
//!   An update that the board makes late, as a simulated board may, does not move the aim, and costs several empty
//!   polls.

mod window;

use window::{FoundUpdate, Window};

/// Nanoseconds.
type Ns = u64;

const MICROSECOND: Ns = 1_000;
const MILLISECOND: Ns = 1_000_000;

/// A step of the aim is this part of a period, and at most this time.
const STEP: f64 = 1.0 / 128.0;
const STEP_NS: f64 = 2_000.0;
/// While the clock looks for the aim, and once the aim is found.
const FINDING: Pace = Pace { earlier: 1.0, haste: 8 };
const HOLDING: Pace = Pace { earlier: 0.25, haste: 16 };
/// Later by so many steps after an empty first poll.
const LATER: f64 = 6.0;
/// No step is longer than this part of a period.
const LONGEST_STEP: f64 = 1.0 / 8.0;
/// After so many whole windows the aim counts as found. After so many updates in a row at the first poll the clock
/// looks for the aim again, in haste.
const SETTLED: u32 = 4;
const UNSETTLED: u32 = 48;
/// The board made an update late if the update was not there so long after it was due: this part of a period, and at
/// most this time.
const LATE: f64 = 1.0 / 4.0;
const LATE_NS: f64 = 100_000.0;
/// The aim stays this near to the grid, as a part of a period. A machine that always wakes later than that finds each
/// update at the first poll, and no empty poll bounds the finds.
const AIM: f64 = 3.0 / 8.0;
/// If a window changes the period by more than this part, the board has changed its period, and the phase is lost. Without
/// empty polls in both halves the finds may only have followed our own aim and grid. Then the change must be larger, or
/// the finds must come earlier by more than aim and grid can move.
const CHANGED: f64 = 1.0 / 16.0;
const CHANGED_UNBOUNDED: f64 = 1.0 / 4.0;
/// The clock takes this part of the estimate for a period that is hardly known. Polls then come too early, which shows;
/// polls that come too late do not show.
const SHORTER: f64 = 31.0 / 32.0;
const SHORTER_UNBOUNDED: f64 = 7.0 / 8.0;
/// Without an update for this many periods (and at least [`SILENCE`]) the phase is lost.
const LOCK_PERIODS: f64 = 20.0;
const SILENCE: Ns = 50 * MILLISECOND;
/// After this silence the clock no longer expects the board to go on any moment.
const LONG_SILENCE: Ns = 1_000 * MILLISECOND;
/// The time between polls while an update is due: a part of a period, within these limits.
const POLL_AGAIN_SHARE: f64 = 1.0 / 32.0;
const POLL_AGAIN: std::ops::RangeInclusive<Ns> = 10 * MICROSECOND..=30 * MICROSECOND;
/// The longest time between polls without a phase, where one access a millisecond costs nothing, and with one. The
/// clock notices a wrongly configured period, or one that has become much shorter, after this time.
const IDLE_POLL: Ns = MILLISECOND;
const RARE_POLL: Ns = 10 * MILLISECOND;

/// How the aim moves, in steps.
struct Pace {
    /// Earlier by so many after an update found at the first poll.
    earlier: f64,
    /// Many finds at the first poll in a row show that the aim is far too late: after each run of them, `earlier`
    /// doubles. The first empty poll undoes the last doubling.
    haste: u32,
}

/// Predicts updates that come at a nearly constant period.
#[derive(Debug, Clone, Default)]
pub struct UpdateClock {
    /// The time between updates; 0 while unknown.
    period_ns: f64,
    /// When the last seen update was due, while locked.
    grid_ns: Option<f64>,
    /// When to poll for an update, relative to the grid.
    aim_ns: f64,
    window: Window,
    /// The time of the last find.
    last_update_ns: Option<Ns>,
    /// When the last empty poll since that find began.
    last_empty_ns: Option<Ns>,
    /// How many updates in a row were found at the first poll; late updates do not count. An empty first poll halves
    /// the count.
    at_once: u32,
    /// Whole windows since the clock took the phase, or lost the aim.
    windows: u32,
    due_ns: Ns,
}

impl UpdateClock {
    /// Takes the period of the board's settings (I10 and I19), if the clock has learnt none or one that differs by more
    /// than a tenth.
    pub fn expect_period(&mut self, period_ns: Ns) {
        let period = period_ns as f64;
        if self.period_ns == 0.0 || (self.period_ns / period - 1.0).abs() > 0.1 {
            self.period_ns = period;
            self.grid_ns = None;
        }
    }

    /// When to poll next, in CLOCK_MONOTONIC time.
    #[must_use]
    pub fn due_ns(&self) -> Ns {
        self.due_ns
    }

    /// The time between updates, if known.
    #[must_use]
    pub fn period_ns(&self) -> Option<Ns> {
        (self.period_ns > 0.0).then_some(self.period_ns as Ns)
    }

    /// When the board made the last seen update, however late the poll found it. `None` without a phase.
    #[must_use]
    pub fn update_ns(&self) -> Option<Ns> {
        self.grid_ns.map(|grid| grid.max(0.0) as Ns)
    }

    /// When to make the first poll for the next update, while locked.
    fn aimed_at(&self) -> Option<f64> {
        self.grid_ns.map(|grid| grid + self.period_ns + self.aim_ns)
    }

    /// A poll from `began` to `now` found nothing new. Any update came after it began.
    pub fn poll_empty(&mut self, began: Ns, now: Ns) {
        self.last_empty_ns = Some(began);
        let silent = self.last_update_ns.map_or(Ns::MAX, |last| now.saturating_sub(last));
        if silent > self.longest_silence() {
            self.grid_ns = None;
        }
        let again = match self.aimed_at() {
            Some(aim) => self.wait_for(aim, now),
            None if self.period_ns > 0.0 && silent <= LONG_SILENCE => (self.period_ns / 4.0) as Ns,
            None => IDLE_POLL,
        };
        self.due_ns = now + again.clamp(*POLL_AGAIN.start(), self.longest_wait());
    }

    /// The time from an empty poll to the next: short while the update may come any moment, and longer the longer it
    /// fails to come. The clock still polls at each later update's due time, but not as often as for a late update: a
    /// board may leave updates out, and a simulated board needs the processor.
    fn wait_for(&self, aim: f64, now: Ns) -> Ns {
        let soon = ((POLL_AGAIN_SHARE * self.period_ns) as Ns).clamp(*POLL_AGAIN.start(), *POLL_AGAIN.end());
        let late = now as f64 - aim;
        if late < 0.0 {
            return soon.max(-late as Ns);
        }
        let since_due = late % self.period_ns;
        let patience =
            ((since_due + self.aim_ns) / 2.0).max((late - self.period_ns) / 8.0).min(self.period_ns / 2.0);
        soon.max(patience as Ns).min((self.period_ns - since_due) as Ns)
    }

    /// A poll at `now` found an update, the `updates`-th after the last one seen (1: none was missed).
    pub fn on_update(&mut self, now: Ns, updates: u64) {
        let (at, updates) = (now as f64, updates.max(1) as f64);
        let elapsed = self.last_update_ns.map(|last| now.saturating_sub(last));
        match (self.grid_ns, elapsed) {
            (Some(grid), Some(elapsed)) if elapsed <= self.longest_silence() => self.track(grid, at, updates),
            (_, elapsed) => {
                let is_new = self.period_ns == 0.0;
                if let (true, Some(elapsed)) = (is_new, elapsed) {
                    self.period_ns = SHORTER_UNBOUNDED * elapsed as f64 / updates;
                }
                self.lock(at, if is_new { Window::short(at) } else { Window::long(at) });
            }
        }
        self.last_update_ns = Some(now);
        self.last_empty_ns = None;
        self.due_ns = match self.aimed_at() {
            Some(aim) => (aim as Ns).clamp(now, now + self.longest_wait()),
            None => now + IDLE_POLL,
        };
    }

    /// Takes the phase from one find.
    fn lock(&mut self, at: f64, window: Window) {
        self.grid_ns = (self.period_ns > 0.0).then_some(at);
        self.window = window;
        self.windows = 0;
        self.move_aim(0.0);
    }

    /// Follows the phase. The time tells which update of the grid the poll found, because the count may be wrong while
    /// the board's I19 is unknown.
    fn track(&mut self, grid: f64, at: f64, updates: f64) {
        let period = self.period_ns;
        let due = grid + ((at - grid) / period).floor().max(1.0) * period;
        let empty = self.last_empty_ns.map(|empty| empty as f64);
        let step = (STEP * period).min(STEP_NS);
        let was_early = empty.is_some_and(|empty| empty > due + self.aim_ns - step);
        // After a gap, a find just before the grid looks like a late find of the update before.
        let is_next = due < grid + 1.5 * period;
        let is_late = is_next && empty.is_some_and(|empty| empty > due + (LATE * period).min(LATE_NS));
        if !is_late {
            self.follow_aim(was_early, step);
        }
        let found = FoundUpdate { find_ns: at, updates, due_ns: due, empty_ns: empty, was_early };
        self.window.add(found, period);
        // A poll finds an update after the board made it, so the grid cannot be later.
        self.set_grid(due, (at - due).min(0.0));
        if !self.window.is_full() {
            return;
        }
        let change = self.window.period_change_ns();
        let is_sure = self.window.is_bounded() || self.window.is_earlier_by((1.0 + AIM) * period);
        let (most, shorter) =
            if is_sure { (CHANGED, SHORTER) } else { (CHANGED_UNBOUNDED, SHORTER_UNBOUNDED) };
        if change.abs() > most * period {
            self.period_ns = (shorter * (period + change)).max(0.0);
            self.lock(at, Window::short(at));
            return;
        }
        if is_sure {
            self.period_ns += self.window.gain() * change;
        }
        self.set_grid(self.grid_ns.unwrap_or(due), self.window.shift_ns());
        self.window = self.window.next(at);
        self.windows = self.windows.saturating_add(1);
    }

    /// Moves the aim by one or more times `step`, after an update whose first poll `was_early`.
    fn follow_aim(&mut self, was_early: bool, step: f64) {
        if self.at_once >= UNSETTLED {
            self.windows = 0;
        }
        let Pace { earlier, haste } = if self.windows < SETTLED { FINDING } else { HOLDING };
        let hasty = earlier * step * f64::from(1 << (self.at_once / haste).min(16));
        let hasty = hasty.min(LONGEST_STEP * self.period_ns);
        self.move_aim(if was_early { hasty.max(LATER * step) } else { -hasty });
        self.at_once = if was_early { self.at_once / 2 } else { self.at_once.saturating_add(1) };
    }

    /// Sets the grid to `grid`, corrected `by` a time. The correction leaves the aim in place.
    fn set_grid(&mut self, grid: f64, by: f64) {
        self.grid_ns = Some(grid + by);
        self.move_aim(-by);
    }

    fn move_aim(&mut self, by: f64) {
        let most = AIM * self.period_ns;
        self.aim_ns = (self.aim_ns + by).clamp(-most, most);
    }

    /// Longer silences lose the phase.
    fn longest_silence(&self) -> Ns {
        SILENCE.max((LOCK_PERIODS * self.period_ns) as Ns)
    }

    /// The longest time from one poll to the next.
    fn longest_wait(&self) -> Ns {
        if self.grid_ns.is_some() { RARE_POLL } else { IDLE_POLL }
    }
}

#[cfg(test)]
#[path = "clock_tests.rs"]
mod tests;
