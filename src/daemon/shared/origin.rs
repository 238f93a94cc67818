//! Whose a command is, as others are told who have to wait for it.

use std::time::Instant;

use crate::format::Text;
use crate::language::Line;
use crate::language::password::without_password;

/// The longest reason of a refusal.
pub const REASON_MAX: usize = 480;
/// As much of a line as others are told who have to wait for it.
const SHOWN_MAX: usize = 60;

/// Whose line it is, and what others are told of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Origin {
    /// The user.
    pub uid: u32,
    /// The line, or its beginning, without a password.
    pub shown: Text<SHOWN_MAX>,
    /// The line ends a sequence: the daemon sends it even after a stop of all motion.
    pub stays: bool,
    /// The line may move something.
    pub may_move: bool,
}

impl Origin {
    /// Of `line`, which user `uid` sends.
    #[must_use]
    pub fn of(uid: u32, line: &Line, stays: bool) -> Self {
        Self { uid, shown: Text::of(&without_password(line)), stays, may_move: line.meaning.may_move }
    }
}

/// A command that the board works on, or that was given up. Nothing else is sent until the board has shown that it works on it
/// no more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GivenUp {
    /// Whose it was.
    pub by: Origin,
    /// When it was sent.
    pub since: Instant,
}

impl GivenUp {
    /// Why nothing else was sent.
    #[must_use]
    pub fn reason(&self, now: Instant) -> Text<REASON_MAX> {
        let Self { by: Origin { uid, shown, .. }, since } = self;
        let seconds = now.saturating_duration_since(*since).as_secs();
        Text::of(&format_args!(
            "the board still works on \"{}\" of uid {uid}, sent {seconds} s ago, or no longer listens; nothing was sent; \
             ^X by an engineer cancels it",
            &**shown
        ))
    }
}
