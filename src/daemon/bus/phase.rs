//! Between the bus thread's start and its end.

use std::time::{Duration, Instant};

/// How long the board may take, at the start, to bring the DPRAM into reach.
const FIRST_REACH: Duration = Duration::from_millis(200);
/// How long the board may take, at the daemon's end, to stop what was held.
const LAST_STOP: Duration = Duration::from_millis(500);

/// Between start and end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// The board has not been touched.
    Begin,
    /// Its page is written; the DPRAM has to come into reach until a time. Looked at again when due.
    Reaching {
        /// No longer than this.
        until: Instant,
        /// When to look again.
        due_ns: u64,
    },
    /// At work.
    Running,
    /// What is held is being stopped.
    Stopping {
        /// No longer than this.
        until: Instant,
        /// When to go on.
        due_ns: u64,
    },
    /// The board has been left.
    Ended,
}

impl Phase {
    /// The board's page has been written `now`.
    #[must_use]
    pub fn reaching(now: Instant) -> Self {
        Self::Reaching { until: now + FIRST_REACH, due_ns: 0 }
    }

    /// The loop was asked `now` to end.
    #[must_use]
    pub fn stopping(now: Instant) -> Self {
        Self::Stopping { until: now + LAST_STOP, due_ns: 0 }
    }
}
