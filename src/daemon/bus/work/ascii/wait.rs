//! How long somebody waits for a command, and until when it may be begun.

use std::time::Instant;

use crate::daemon::bus::timing::LEFT_TO_ANSWER;

/// How long somebody waits for a command.
#[derive(Clone, Copy)]
pub(super) struct Wait {
    pub since: Instant,
    /// From then on it is too late to begin.
    pub begin_by: Instant,
    pub deadline: Instant,
}

impl Wait {
    /// For an answer. A command that is begun a moment before its deadline is given up a moment after, and that holds the port for
    /// everybody.
    pub fn for_answer(since: Instant, deadline: Instant) -> Self {
        let whole = deadline.saturating_duration_since(since);
        let begin_by = deadline.checked_sub((whole / 4).min(LEFT_TO_ANSWER)).unwrap_or(deadline);
        Self { since, begin_by, deadline }
    }

    /// For what stops a machine or ends a sequence: it is tried to the last.
    pub const fn to_the_last(since: Instant, deadline: Instant) -> Self {
        Self { since, begin_by: deadline, deadline }
    }
}
