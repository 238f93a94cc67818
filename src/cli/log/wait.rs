//! The waits of a log, and its messages meanwhile.

use std::time::{Duration, Instant};

use crate::cli::console::note;
use crate::cli::show::motors::reason;
use crate::client::{Board, Staleness};

/// After this time the log says that it waits.
pub const SAY_AFTER: Duration = Duration::from_secs(2);

/// A wait that the log mentions once if it takes long.
#[derive(Default)]
pub struct LongWait {
    since: Option<Instant>,
    said: bool,
}

impl LongWait {
    /// The wait goes on: says `text` after the time `silent`. Returns the time waited.
    pub fn go_on(&mut self, silent: Duration, text: impl FnOnce() -> String) -> Duration {
        let waited = self.since.get_or_insert_with(Instant::now).elapsed();
        if waited >= silent && !std::mem::replace(&mut self.said, true) {
            note(text());
        }
        waited
    }

    /// Whether the log has waited.
    pub fn has_begun(&self) -> bool {
        self.since.is_some()
    }
}

/// Says once that no update comes, and why, and that updates come again.
#[derive(Default)]
pub struct Silence {
    wait: LongWait,
}

impl Silence {
    pub fn note(&mut self, came: bool, stale: Option<Staleness>, board: &mut Board) {
        if !came {
            self.wait.go_on(SAY_AFTER, || {
                let why = stale.map_or_else(|| "none yet".to_owned(), |stale| reason(board, stale));
                format!("{}: no updates ({why}); waiting for some", board.name())
            });
        } else if std::mem::take(&mut self.wait).said {
            note(format_args!("{}: updates come again", board.name()));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_takes_long_is_said_once() {
        let mut wait = LongWait::default();
        let mut said = 0;
        let mut go_on = |wait: &mut LongWait, silent| {
            wait.go_on(silent, || {
                said += 1;
                "still there is none".to_owned()
            })
        };
        assert!(!wait.has_begun());
        go_on(&mut wait, Duration::from_secs(1000));
        assert!(wait.has_begun());
        let waited = [(); 3].map(|()| go_on(&mut wait, Duration::ZERO));
        assert!(waited.is_sorted() && waited[0] < Duration::from_secs(1000));
        assert_eq!(said, 1);
    }
}
