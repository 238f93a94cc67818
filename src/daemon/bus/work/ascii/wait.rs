//! How long a caller waits for a command, and until when the daemon may begin it.

use std::time::Instant;

use crate::daemon::bus::timing::LEFT_TO_ANSWER;

/// A caller's wait for a command.
#[derive(Clone, Copy)]
pub(super) struct Wait {
    pub since: Instant,
    /// From then on the daemon no longer begins the command.
    pub begin_by: Instant,
    pub deadline: Instant,
}

impl Wait {
    /// For an answer. A command begun just before its deadline would be abandoned just after, and an abandoned command
    /// holds the port for everybody.
    pub fn for_answer(since: Instant, deadline: Instant) -> Self {
        let whole = deadline.saturating_duration_since(since);
        let begin_by = deadline.checked_sub((whole / 4).min(LEFT_TO_ANSWER)).unwrap_or(deadline);
        Self { since, begin_by, deadline }
    }

    /// For a stop, or the end of a sequence: the daemon tries it until its deadline.
    pub const fn to_the_last(since: Instant, deadline: Instant) -> Self {
        Self { since, begin_by: deadline, deadline }
    }
}
