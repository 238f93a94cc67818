//! How fast the board puts out the lines of a reply. A board may take tens of milliseconds for each line, and a long
//! question of the daemon's own would keep callers' lines waiting.

use std::time::{Duration, Instant};

use crate::daemon::bus::timing::OWN_QUESTION;

/// A reply of fewer lines says nothing about the pace.
const PACE_LINES: usize = 4;

/// The shortest time from one line of a reply to the next: this machine may have caused any longer time.
#[derive(Debug)]
pub(super) struct LinePace {
    /// The time in the last reply of enough lines.
    known: Duration,
    /// The time in the present reply.
    shortest: Duration,
    /// When the last line of the present reply came, and how many lines have come.
    last: Option<Instant>,
    lines: usize,
}

impl LinePace {
    /// The pace of a board that has not answered yet.
    pub(super) const fn new() -> Self {
        Self { known: Duration::ZERO, shortest: Duration::MAX, last: None, lines: 0 }
    }

    /// The daemon sends a line to the board.
    pub(super) const fn begin(&mut self) {
        if self.lines >= PACE_LINES {
            self.known = self.shortest;
        }
        (self.shortest, self.last, self.lines) = (Duration::MAX, None, 0);
    }

    /// A line of the reply came.
    pub(super) fn line(&mut self, now: Instant) {
        self.lines += 1;
        if let Some(last) = self.last.replace(now) {
            self.shortest = self.shortest.min(now.saturating_duration_since(last));
        }
    }

    /// The most lines that the reply to a question of the daemon's own may have.
    pub(super) fn most_lines(&self) -> u16 {
        let most = OWN_QUESTION.as_nanos() / self.known.as_nanos().max(1);
        u16::try_from(most).unwrap_or(u16::MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// After replies whose lines come so many milliseconds after each other.
    fn most_lines(gaps: &[&[u64]]) -> u16 {
        let (mut pace, mut now) = (LinePace::new(), Instant::now());
        for gaps in gaps {
            pace.begin();
            for gap in *gaps {
                now += Duration::from_millis(*gap);
                pace.line(now);
            }
        }
        pace.begin();
        pace.most_lines()
    }

    #[test]
    fn a_slow_board_is_asked_for_as_many_lines_as_it_puts_out_in_time() {
        let slow: &[u64] = &[1000, 60, 61, 60];
        assert_eq!(most_lines(&[]), u16::MAX);
        assert_eq!(most_lines(&[&[5, 1, 1, 1]]), 400);
        assert_eq!(most_lines(&[slow]), 6);
        assert_eq!(most_lines(&[slow, &[500, 500]]), 6, "a short reply says nothing");
        assert_eq!(most_lines(&[slow, &[5, 1, 1, 1]]), 400, "it is slow no more");
        assert_eq!(most_lines(&[&[5, 300, 1, 300, 300]]), 400, "this machine was held up");
    }
}
