//! The progress of a rotary stream: a bar on a terminal, else a plain line now and then.

use std::io::{self, IsTerminal, Write};
use std::os::fd::AsFd;
use std::time::{Duration, Instant};

use nix::poll::{PollFd, PollFlags, PollTimeout, poll};

use crate::cli::console::note;

/// The width of the bar.
const CELLS: usize = 30;
const EVERY_ON_TERMINAL: Duration = Duration::from_millis(100);
const EVERY_PLAIN: Duration = Duration::from_secs(1);

/// The progress, on stderr: stdout is for the result.
#[derive(Debug)]
pub struct Progress {
    total: usize,
    began: Instant,
    last: Instant,
    terminal: bool,
    quiet: bool,
    /// Whether the terminal's line shows a bar.
    shown: bool,
}

impl Progress {
    pub fn new(total: usize, quiet: bool) -> Self {
        let now = Instant::now();
        Self { total, began: now, last: now, terminal: io::stderr().is_terminal(), quiet, shown: false }
    }

    /// When the stream started.
    pub fn elapsed(&self) -> Duration {
        self.began.elapsed()
    }

    /// Whether the next display is due.
    pub fn due(&self) -> bool {
        let every = if self.terminal { EVERY_ON_TERMINAL } else { EVERY_PLAIN };
        !self.quiet && self.last.elapsed() >= every
    }

    /// Shows `sent` lines in the buffer, `ahead` of them not taken by the board yet.
    pub fn show(&mut self, sent: usize, ahead: u64) {
        if !self.due() {
            return;
        }
        self.last = Instant::now();
        if !takes_more(&io::stderr()) {
            return;
        }
        let seconds = self.elapsed().as_secs_f64();
        // If stderr is closed, the progress is lost.
        let _ = if self.terminal {
            self.shown = true;
            write!(io::stderr(), "\r{}\x1b[K", bar(sent, self.total, ahead, seconds))
        } else {
            writeln!(io::stderr(), "sent={sent} of={} ahead={ahead} seconds={seconds:.1}", self.total)
        };
    }

    /// Prints a line of text between two displays.
    pub fn say(&mut self, text: &str) {
        self.clear();
        note(text);
    }

    pub fn clear(&mut self) {
        if std::mem::take(&mut self.shown) {
            let _ = write!(io::stderr(), "\r\x1b[K");
        }
    }
}

/// Whether stderr takes a line without blocking. A stopped terminal or a full pipe must not stop the machine's program.
fn takes_more(output: &impl AsFd) -> bool {
    let mut watched = [PollFd::new(output.as_fd(), PollFlags::POLLOUT)];
    poll(&mut watched, PollTimeout::ZERO) != Ok(0)
}

fn bar(sent: usize, total: usize, ahead: u64, seconds: f64) -> String {
    let full = (sent * CELLS).checked_div(total).unwrap_or(CELLS).min(CELLS);
    let (done, left) = ("#".repeat(full), "-".repeat(CELLS - full));
    format!("[{done}{left}] {sent} of {total} lines, {ahead} ahead, {seconds:.1} s")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pipe_that_nobody_empties_is_left_alone() {
        let (read, write) = io::pipe().unwrap();
        let mut lines = 0;
        while takes_more(&write) {
            writeln!(&write, "{lines:80}").unwrap();
            lines += 1;
            assert!(lines < 100_000, "it is never full");
        }
        assert!(lines > 10);
        drop(read);
        assert!(takes_more(&write), "what is closed need not be waited for");
    }

    #[test]
    fn the_bar_fills() {
        assert_eq!(bar(0, 10, 0, 0.0), format!("[{}] 0 of 10 lines, 0 ahead, 0.0 s", "-".repeat(30)));
        assert!(
            bar(5, 10, 3, 1.25).starts_with("[###############---------------] 5 of 10 lines, 3 ahead, 1.2")
        );
        assert!(bar(10, 10, 0, 2.0).starts_with(&format!("[{}]", "#".repeat(30))));
        assert!(bar(0, 0, 0, 0.0).starts_with("[##"));
    }
}
