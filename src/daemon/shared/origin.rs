//! The origin of a command, for the texts to the clients that have to wait for it.

use std::time::Instant;

use crate::format::Text;
use crate::language::Line;
use crate::language::password::without_password;

/// The longest reason of a refusal.
pub const REASON_MAX: usize = 480;
/// The most of a line that such a client sees.
const SHOWN_MAX: usize = 60;

/// A line's origin, and the text that other clients see.
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
    /// The origin of `line`, which user `uid` sends.
    #[must_use]
    pub fn of(uid: u32, line: &Line, stays: bool) -> Self {
        Self { uid, shown: Text::of(&without_password(line)), stays, may_move: line.meaning.may_move }
    }
}

/// A command that the board works on, or that the daemon has given up. The daemon sends nothing else until the board
/// has shown that it no longer works on this command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GivenUp {
    /// The command's origin.
    pub by: Origin,
    /// When the daemon sent the command.
    pub since: Instant,
}

impl GivenUp {
    /// Why the daemon sent nothing else.
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
