//! A command's progress, on stderr: stdout is for the result.

use std::io::{self, IsTerminal, Write};
use std::os::fd::AsFd;
use std::time::{Duration, Instant};

use nix::poll::{PollFd, PollFlags, PollTimeout, poll};

use super::note;

/// How often the terminal's line is rewritten: often enough that the user sees it move.
const EVERY_ON_TERMINAL: Duration = Duration::from_millis(100);
/// How often a line appears elsewhere.
const EVERY_ELSEWHERE: Duration = Duration::from_secs(1);

/// A line that is rewritten in place on a terminal. Elsewhere, no line, or a new line now and then.
#[derive(Debug)]
pub struct Progress {
    on_terminal: bool,
    /// The time between two displays; `None`: no display.
    every: Option<Duration>,
    last: Instant,
    /// Whether the terminal's line shows the progress.
    shown: bool,
}

impl Progress {
    /// Shows progress on a terminal only.
    pub fn on_terminal() -> Self {
        let on_terminal = io::stderr().is_terminal();
        Self {
            on_terminal,
            every: on_terminal.then_some(EVERY_ON_TERMINAL),
            last: Instant::now(),
            shown: false,
        }
    }

    /// Shows progress elsewhere, too, as a line now and then; nowhere if `quiet`.
    pub fn everywhere(quiet: bool) -> Self {
        let progress = Self::on_terminal();
        let every = progress.every.or(Some(EVERY_ELSEWHERE)).filter(|_| !quiet);
        Self { every, ..progress }
    }

    /// Whether the next display is due.
    pub fn is_due(&self) -> bool {
        self.every.is_some_and(|every| self.last.elapsed() >= every)
    }

    /// Shows `text` if the next display is due. The argument of `text`: whether the output is a terminal.
    pub fn show(&mut self, text: impl FnOnce(bool) -> String) {
        if !self.is_due() {
            return;
        }
        self.last = Instant::now();
        if !takes_more(&io::stderr()) {
            return;
        }
        self.shown = self.on_terminal;
        let text = text(self.on_terminal);
        // If stderr is closed, the progress is lost.
        let _ = if self.on_terminal {
            write!(io::stderr(), "\r{text}\x1b[K")
        } else {
            writeln!(io::stderr(), "{text}")
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
}
