//! Notices a reset of the board between lines that belong together: the reset erases the settings of the earlier lines.

use crate::client::Connection;
use crate::language::Meaning;

/// After so many lines the client asks the board again.
const LINES_BETWEEN: u64 = 64;

/// The daemon's count of resets, and the lines since.
pub struct ResetWatch {
    /// `None` while the board cannot be asked, as during an open program buffer.
    resets: Option<u64>,
    lines: u64,
    asked_at: u64,
}

impl ResetWatch {
    /// Begins before the first line.
    pub fn begin(connection: &mut Connection) -> Self {
        Self { resets: connection.check_reset().ok(), lines: 0, asked_at: 0 }
    }

    /// The client has sent `line`. Returns the warning if the board was reset.
    pub fn line_sent(&mut self, line: &str, connection: &mut Connection) -> Option<String> {
        self.lines += 1;
        if Meaning::of(line).resets {
            // The user wanted this reset.
            self.resets = connection.check_reset().ok();
            return None;
        }
        if self.lines >= self.asked_at + LINES_BETWEEN { self.look(connection) } else { None }
    }

    /// The warning if the board was reset since the last look.
    pub fn look(&mut self, connection: &mut Connection) -> Option<String> {
        let first = std::mem::replace(&mut self.asked_at, self.lines) + 1;
        let now = connection.check_reset().ok()?;
        let before = self.resets.replace(now)?;
        (now != before).then(|| {
            format!(
                "the board was reset between line {first} and line {}: what lines up to there have set is gone unless it was \
                 saved",
                self.lines
            )
        })
    }
}
