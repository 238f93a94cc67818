//! The earliest finds in a window of updates, and what they tell of the board's period and phase.
//!
//! A poll finds an update late by any amount, and never early. So the earliest finds count, as the lower hull of
//! one-way delays gives the skew of two clocks. An empty poll bounds an update from below.

/// The finds of the shortest window, and of the longest. Each window is twice as long as the one before.
const SHORTEST_FIND_WINDOW: u32 = 8;
const LONGEST_FIND_WINDOW: u32 = 64;

/// A find: the number of updates since the window's start, and how late it is if the assumed period is right.
#[derive(Debug, Clone, Copy)]
struct Find {
    updates: f64,
    late_ns: f64,
}

/// An update that a poll has found.
#[derive(Debug, Clone, Copy)]
pub(super) struct FoundUpdate {
    pub find_ns: f64,
    /// How many updates after the last find.
    pub updates: f64,
    pub due_ns: f64,
    /// The last empty poll before the find.
    pub empty_ns: Option<f64>,
    /// The first poll for the update came before it was due.
    pub was_early: bool,
}

/// A window of updates.
#[derive(Debug, Clone, Default)]
pub(super) struct Window {
    length: u32,
    finds: u32,
    /// The time of the update before the first.
    start_ns: f64,
    /// Updates since then.
    updates: f64,
    /// The earliest find in the first quarter of the window, and in the last.
    first: Option<Find>,
    last: Option<Find>,
    /// Whether an empty first poll came before a find in the first half of the window, and in the last.
    first_bounded: bool,
    last_bounded: bool,
    /// The earliest find after the grid.
    find_ns: f64,
    /// The latest empty poll after the grid.
    empty_ns: f64,
}

impl Window {
    /// A window after an update at `at_ns`, while the period is hardly known.
    pub fn short(at_ns: f64) -> Self {
        Self::of(SHORTEST_FIND_WINDOW, at_ns)
    }

    /// A window after an update at `at_ns`, while the period is known.
    pub fn long(at_ns: f64) -> Self {
        Self::of(LONGEST_FIND_WINDOW, at_ns)
    }

    /// The window after this one.
    pub fn next(&self, at_ns: f64) -> Self {
        Self::of((2 * self.length).min(LONGEST_FIND_WINDOW), at_ns)
    }

    fn of(length: u32, start_ns: f64) -> Self {
        Self { length, start_ns, find_ns: f64::INFINITY, empty_ns: f64::NEG_INFINITY, ..Self::default() }
    }

    /// Takes the find of an update; `period_ns` is the assumed period.
    pub fn add(&mut self, found: FoundUpdate, period_ns: f64) {
        let FoundUpdate { find_ns, updates, due_ns, empty_ns, was_early } = found;
        self.updates += updates;
        let late_ns = find_ns - self.start_ns - self.updates * period_ns;
        let find = Find { updates: self.updates, late_ns };
        let earlier = |of: Option<Find>| of.filter(|of| of.late_ns <= late_ns).or(Some(find));
        if self.finds < self.length / 4 {
            self.first = earlier(self.first);
        } else if self.finds >= self.length - self.length / 4 {
            self.last = earlier(self.last);
        }
        // Halves, because empty first polls may come a window apart, and at regular times: perhaps never in the first
        // quarter.
        let bounded =
            if self.finds < self.length / 2 { &mut self.first_bounded } else { &mut self.last_bounded };
        *bounded |= was_early;
        self.finds += 1;
        self.find_ns = self.find_ns.min(find_ns - due_ns);
        self.empty_ns = empty_ns.map_or(self.empty_ns, |empty| self.empty_ns.max(empty - due_ns));
    }

    /// Whether the window is complete.
    pub fn is_full(&self) -> bool {
        self.finds >= self.length
    }

    /// Whether the finds have come earlier by more than `ns` from the first quarter to the last. Hold-ups only make
    /// finds late, never early.
    pub fn is_earlier_by(&self, ns: f64) -> bool {
        self.first.zip(self.last).is_some_and(|(first, last)| first.late_ns - last.late_ns > ns)
    }

    /// How much of a change of the period to take: all of it after a short window, half after the longest.
    pub fn gain(&self) -> f64 {
        if self.length < LONGEST_FIND_WINDOW { 1.0 } else { 0.5 }
    }

    /// Whether empty polls bound the finds from below in both halves.
    pub fn is_bounded(&self) -> bool {
        self.first_bounded && self.last_bounded
    }

    /// How much longer the board's period is than the assumed one.
    pub fn period_change_ns(&self) -> f64 {
        match (self.first, self.last) {
            (Some(first), Some(last)) => (last.late_ns - first.late_ns) / (last.updates - first.updates),
            _ => 0.0,
        }
    }

    /// The grid is too early by at least this: a poll after it was empty. An update that the board made late looks the
    /// same, so the earliest find limits the shift.
    pub fn shift_ns(&self) -> f64 {
        self.empty_ns.min(self.find_ns).max(0.0)
    }
}
