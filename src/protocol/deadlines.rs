//! How long the board may take for a command line.
//!
//! No manual gives times. [`SLOW`] says for each kind of line that takes long what the board does meanwhile, and where that is
//! written; the limits are ours, several times what such work takes. A limit that is too long costs only the wait for a board
//! that does not answer at all. After one that is too short the line is told as uncertain, and the port is held until it is done.

use std::time::Duration;

use super::line;

/// For a line that is in no row of [`SLOW`], when its sender does not say.
pub const PLAIN: Duration = Duration::from_secs(5);
/// The longest limit of all.
pub const LONGEST: Duration = Duration::from_secs(60);
/// For a line that resets the board: "reply not guaranteed" (GRAMMAR 2.9, `$$$`), so that it is not waited for any longer.
pub const RESETTING: Duration = Duration::from_secs(3);
/// For each value that a range asks for or sets, on top of the rest: each is a line of the reply (GRAMMAR 2.5; FACTS 13).
const A_VALUE: Duration = Duration::from_millis(20);
/// More values than any board has of a kind.
const VALUES_MAX: u32 = 8192;

/// A kind of line that takes its time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Slow {
    /// The word that makes it one, as the board also takes it without blanks around it, and its short form.
    pub words: [&'static str; 2],
    /// How long it may take.
    pub limit: Duration,
    /// What the board does, and where that is written.
    pub source: &'static str,
}

const fn slow(words: [&'static str; 2], seconds: u64, source: &'static str) -> Slow {
    Slow { words, limit: Duration::from_secs(seconds), source }
}

/// Every kind of line that takes its time, but for resets and ranges.
pub static SLOW: [Slow; 5] = [
    slow(["SAVE", ""], 60, "acknowledged when the flash memory is written, seconds later (GRAMMAR 2.9)"),
    slow(["LIST", ""], 60, "a response for each program line (GRAMMAR 2.7)"),
    slow(["DEFINE", "DEF"], 20, "reserves memory of the board's buffers (GRAMMAR 2.7)"),
    slow(["DELETE", "DEL"], 20, "frees memory of the board's buffers (GRAMMAR 2.7)"),
    slow(["PASSWORD", ""], 20, "locks or unlocks the board's programs (GRAMMAR 2.7)"),
];

/// How long the board may take for `line`, where a plain one may take `plain`.
#[must_use]
pub fn of_line(line: &str, plain: Duration) -> Duration {
    let upper = line.to_ascii_uppercase();
    let parts = || line::commands(&upper);
    let is_slow = |row: &&Slow| parts().any(|part| row.is_in(part));
    let slow = SLOW.iter().filter(is_slow).map(|row| row.limit).max();
    match slow {
        None if line::resets(line.as_bytes()) => RESETTING,
        slow => {
            let values = parts().map(values).fold(0, u32::saturating_add).min(VALUES_MAX);
            let limit = slow.unwrap_or(Duration::ZERO).max(plain) + A_VALUE * values;
            limit.min(LONGEST.max(plain))
        }
    }
}

impl Slow {
    fn is_in(&self, part: &str) -> bool {
        let [long, short] = self.words;
        let mut words = part.split(|character: char| !character.is_ascii_alphabetic());
        words.any(|word| word.contains(long) || !word.is_empty() && word == short)
    }
}

/// How many values the ranges `A..B` in `part` name.
fn values(part: &str) -> u32 {
    let ranges = part.match_indices("..").filter_map(|(at, dots)| {
        let is_no_digit = |character: char| !character.is_ascii_digit();
        let (before, behind) = (&part[..at], &part[at + dots.len()..]);
        let first: u32 = before.rsplit(is_no_digit).next()?.parse().ok()?;
        let last: u32 = behind.split(is_no_digit).next()?.parse().ok()?;
        Some(last.saturating_sub(first).saturating_add(1))
    });
    ranges.fold(0, u32::saturating_add)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn b2_2_slow_lines_have_longer_limits_from_one_table() {
        for row in &SLOW {
            for word in row.words.iter().filter(|word| !word.is_empty()) {
                assert_eq!(of_line(&word.to_ascii_lowercase(), PLAIN), row.limit, "{word}: {}", row.source);
            }
            assert!(row.limit <= LONGEST);
        }
        for (line, seconds) in [
            ("P1", 5),
            ("#1J+", 5),
            ("SEND\"SAVE\"", 5),
            ("DELAY100", 5),
            ("$", 5),
            ("&1 DEFINE ROT 200", 20),
            ("DEL GAT", 20),
            ("DELETEGATHER", 20),
            ("$$$***", 3),
            (" $$$ ", 3),
            ("SAVE $$$", 60),
            ("I0..999", 25),
            ("P1..0", 5),
            ("P0..99999999999", 5),
            ("P0..4294967295", 60),
        ] {
            assert_eq!(of_line(line, PLAIN).as_secs(), seconds, "{line}");
        }
        let patient = Duration::from_secs(300);
        assert_eq!((of_line("LIST", patient), of_line("P0..9", patient)), (patient, patient));
    }
}
