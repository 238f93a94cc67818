//! The phases of the bus thread, from its start to its end.

use std::time::Instant;

use crate::daemon::bus::timing::{FIRST_REACH, LAST_STOP};

/// A phase of the bus thread.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LoopPhase {
    /// The bus thread has not touched the board.
    Begin,
    /// The bus thread has written the board's page. The DPRAM must become visible by a time.
    Reaching {
        /// The time limit.
        until: Instant,
        /// When to check again.
        due_ns: u64,
    },
    /// The normal phase.
    Running,
    /// The bus thread stops the held jogs.
    Stopping {
        /// The time limit.
        until: Instant,
        /// When to continue.
        due_ns: u64,
    },
    /// The bus thread no longer touches the board.
    Ended,
}

impl LoopPhase {
    /// The phase after the bus thread has written the board's page `now`.
    #[must_use]
    pub fn reaching(now: Instant) -> Self {
        Self::Reaching { until: now + FIRST_REACH, due_ns: 0 }
    }

    /// The phase after the daemon has asked the loop `now` to end.
    #[must_use]
    pub fn stopping(now: Instant) -> Self {
        Self::Stopping { until: now + LAST_STOP, due_ns: 0 }
    }
}
