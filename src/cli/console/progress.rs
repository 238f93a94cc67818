//! How many of a sequence's lines are done, on a terminal.

use std::io::{self, IsTerminal, Write};
use std::time::{Duration, Instant};

/// The line on stderr: stdout is for the result. Elsewhere than on a terminal there is none.
pub struct LineProgress {
    total: usize,
    shown: bool,
    last: Instant,
}

impl LineProgress {
    /// Often enough to be seen moving.
    const EVERY: Duration = Duration::from_millis(100);

    pub fn new(total: usize) -> Self {
        Self { total, shown: false, last: Instant::now() }
    }

    pub fn show(&mut self, done: u64) {
        if self.last.elapsed() >= Self::EVERY && io::stderr().is_terminal() {
            self.last = Instant::now();
            self.shown = true;
            // If stderr is closed, the progress is lost.
            let _ = write!(io::stderr(), "\r{done} of {} lines\x1b[K", self.total);
        }
    }

    pub fn clear(&mut self) {
        if std::mem::take(&mut self.shown) {
            let _ = write!(io::stderr(), "\r\x1b[K");
        }
    }
}
