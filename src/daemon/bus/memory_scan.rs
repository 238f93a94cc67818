//! Where the board's own programs keep data in the DPRAM: every M-variable that points into it.
//!
//! Sites keep data of their own there, also where automatic functions have their words (FACTS-TURBO 19.2). So the board is
//! asked for the definitions of all its M-variables, a few at a time, when nobody else has a line to send: at the start,
//! after a reset, and after a line that defines one. What another host defines meanwhile is not noticed.

use std::time::{Duration, Instant};

use crate::format::Text;
use crate::map::word_use::{defined_place, m_variables};
use crate::map::{Family, HostOffset};
use crate::protocol::LINE_MAX;

/// Definitions asked for by one line: a longer reply would hold up other callers' lines.
const A_QUESTION: u16 = 25;
/// How long the board may take for one question.
const PATIENCE: Duration = Duration::from_secs(5);
/// How long to wait before asking a board again that did not answer.
const AGAIN: Duration = Duration::from_secs(30);
/// How long to wait after a line that defines one: more may follow.
const SETTLE: Duration = Duration::from_secs(1);
/// How long no question need be answered until the board counts as one that cannot be asked.
const NO_PROGRESS: Duration = Duration::from_secs(10);

/// What the questions have come to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// The board has told all its definitions: [`MemoryScan::words`] has them.
    Known,
    /// The board does not tell them.
    Unknown,
}

/// Asks for the definitions, and keeps which words they point to.
pub struct MemoryScan {
    family: &'static Family,
    /// The M-variable to ask for next; all are asked for when it is past the last.
    next: u16,
    /// Of each word of the DPRAM: the first M-variable that points to it, and 1; 0 where none does.
    pointers: Box<[u16]>,
    /// Definitions of the present reply so far.
    lines: u16,
    under_way: bool,
    /// Whether to begin again when the reply has come.
    again: bool,
    not_before: Instant,
    /// When the board answered a question of ours last, or the first could be asked.
    progress: Instant,
    /// The present question was acknowledged without an answer before.
    is_repeated: bool,
    /// What came of the last pass, until it is taken.
    outcome: Option<Outcome>,
    /// An outcome was told since the start.
    is_told: bool,
    wanted: bool,
}

impl MemoryScan {
    /// Asks the board, of `family`, from `now` on, if that is `wanted`.
    #[must_use]
    pub fn new(family: &'static Family, wanted: bool, now: Instant) -> Self {
        Self {
            family,
            next: 0,
            pointers: vec![0; if wanted { family.length as usize / 2 } else { 0 }].into(),
            lines: 0,
            under_way: false,
            again: false,
            not_before: now,
            progress: now,
            is_repeated: false,
            outcome: None,
            is_told: false,
            wanted,
        }
    }

    /// Whether the board is asked at all.
    #[must_use]
    pub const fn is_wanted(&self) -> bool {
        self.wanted
    }

    /// How long nothing needs to be asked.
    #[must_use]
    pub fn due_in(&self, now: Instant) -> Duration {
        if self.wanted && !self.is_over() {
            self.not_before.saturating_duration_since(now)
        } else {
            Duration::MAX
        }
    }

    fn is_over(&self) -> bool {
        self.next >= m_variables(self.family)
    }

    /// The line to send now, if any, and how long to wait for its reply. Tell with [`Self::sent`] if it was.
    pub fn next_line(&mut self, now: Instant) -> Option<(Text<LINE_MAX>, Duration)> {
        if !self.due_in(now).is_zero() {
            return None;
        }
        if self.next == 0 {
            self.pointers.fill(0);
        }
        self.lines = 0;
        Some((Text::of(&format_args!("M{}..{}->", self.next, self.last())), PATIENCE))
    }

    /// The last M-variable of the present question.
    fn last(&self) -> u16 {
        (self.next + A_QUESTION).min(m_variables(self.family)) - 1
    }

    /// The line was sent.
    pub const fn sent(&mut self) {
        self.under_way = true;
    }

    /// The line was not answered because it was not sent after all: it is asked again.
    pub fn not_sent(&mut self) {
        self.under_way = false;
        self.restart();
    }

    /// A line of the reply came.
    pub fn line(&mut self, line: &[u8]) {
        let number = self.next.saturating_add(self.lines);
        self.lines = self.lines.saturating_add(1);
        let text = std::str::from_utf8(line).unwrap_or_default();
        // Most point nowhere.
        let place = Some(text.trim()).filter(|text| *text != "*" && number <= self.last());
        let Some(place) = place.and_then(|text| defined_place(text, self.family)) else { return };
        let first = place.offset.word();
        for word in self.pointers.iter_mut().skip(first).take(place.space.words()) {
            if *word == 0 {
                *word = number + 1;
            }
        }
    }

    /// Whether a question that the board only acknowledged is to be repeated: that may have been another line's acknowledgement.
    pub const fn repeats(&mut self) -> bool {
        self.is_repeated = self.lines == 0 && !self.is_repeated;
        self.is_repeated
    }

    /// The reply is complete, or the board refused the question.
    pub fn done(&mut self, is_refused: bool, now: Instant) {
        self.under_way = false;
        self.progress = now;
        if self.again {
            return self.restart();
        }
        if is_refused || self.lines != self.last() - self.next + 1 {
            return self.failed(now);
        }
        self.next = self.last() + 1;
        if self.is_over() {
            self.tell(Outcome::Known);
        }
    }

    /// The board did not answer, or not so.
    pub fn failed(&mut self, now: Instant) {
        self.under_way = false;
        if self.again {
            return self.restart();
        }
        self.next = 0;
        self.not_before = now + AGAIN;
        self.tell(Outcome::Unknown);
    }

    /// The board answers no line. Nobody waits for its definitions any more.
    pub fn is_silent(&mut self) {
        if self.wanted && !self.is_told {
            self.tell(Outcome::Unknown);
        }
    }

    fn tell(&mut self, outcome: Outcome) {
        self.outcome = Some(outcome);
        self.is_told = true;
    }

    /// A line of somebody's goes to the board. One that defines an M-variable changes what is known.
    pub fn line_goes(&mut self, line: &[u8], now: Instant) {
        if line.windows(2).any(|two| two == b"->") {
            self.begin_anew(now + SETTLE);
        }
    }

    /// The board may have other definitions: they are asked for again, from `not_before` on.
    pub fn begin_anew(&mut self, not_before: Instant) {
        self.again = true;
        self.not_before = not_before;
        self.restart();
    }

    fn restart(&mut self) {
        if self.again && !self.under_way {
            self.again = false;
            self.next = 0;
        }
    }

    /// The board answers other questions of ours: it will come to these.
    pub const fn is_answering(&mut self, now: Instant) {
        self.progress = now;
    }

    /// What has come out since the last call. At the start `now` decides, too: who waits for the definitions need not wait
    /// for a board that is never free to tell them.
    pub fn take_outcome(&mut self, now: Instant) -> Option<Outcome> {
        if self.wanted && !self.is_told && now >= self.progress + NO_PROGRESS {
            self.tell(Outcome::Unknown);
        }
        self.outcome.take()
    }

    /// The words that M-variables point to, ascending, and the first M-variable that does.
    pub fn words(&self) -> impl Iterator<Item = (HostOffset, u16)> {
        let words = self.pointers.iter().enumerate().filter(|(_, number)| **number != 0);
        words.map(|(word, number)| (HostOffset::new(0).plus_words(word), number - 1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::{PMAC, TURBO2};

    /// Answers every question with `*`, but for these definitions. How many were asked.
    fn answer(scan: &mut MemoryScan, definitions: &[(u16, &str)], now: Instant) -> usize {
        let mut asked = 0;
        while let Some((line, _)) = scan.next_line(now) {
            let line = std::str::from_utf8(line.as_bytes()).unwrap();
            let range = line.strip_prefix('M').and_then(|line| line.strip_suffix("->")).unwrap();
            let (first, last) = range.split_once("..").unwrap();
            let (first, last): (u16, u16) = (first.parse().unwrap(), last.parse().unwrap());
            assert!(last - first < 50, "{line}: at most 50 lines");
            scan.sent();
            for number in first..=last {
                let own = definitions.iter().find(|(own, _)| *own == number);
                scan.line(own.map_or("*", |(_, text)| text).as_bytes());
            }
            scan.done(false, now);
            asked += 1;
        }
        asked
    }

    #[test]
    fn c3_every_m_variable_is_asked_for_and_those_in_the_dpram_are_kept() {
        let now = Instant::now();
        for (family, asked) in [(&PMAC, 41), (&TURBO2, 328)] {
            let base = family.base;
            let definitions = [
                (211, format!("DP:${:X}", base + 0x80)),
                (212, format!("DP:${:X}", base + 0x80)),
                (m_variables(family) - 1, format!("X:${:X},0,16,S", base + 5)),
                (3, "X:$C000,8".to_owned()),
            ];
            let definitions: Vec<_> =
                definitions.iter().map(|(number, text)| (*number, text.as_str())).collect();
            let mut scan = MemoryScan::new(family, true, now);
            assert_eq!(scan.take_outcome(now), None);
            assert_eq!(answer(&mut scan, &definitions, now), asked);
            assert_eq!(scan.take_outcome(now), Some(Outcome::Known));
            assert_eq!(scan.take_outcome(now), None, "told once");
            let found: Vec<_> = scan.words().map(|(at, number)| (at.bytes(), number)).collect();
            assert_eq!(found, [(0x16, m_variables(family) - 1), (0x200, 211), (0x202, 211)]);
            // One is taken away by a line.
            scan.line_goes(b"M211->*", now);
            assert_eq!(scan.next_line(now), None, "more may follow");
            assert_eq!(answer(&mut scan, &definitions[1..], now + SETTLE), asked);
            assert_eq!(scan.words().nth(1).unwrap().1, 212);
        }
    }

    #[test]
    fn c3_a_board_that_cannot_be_asked_keeps_nobody_waiting() {
        let now = Instant::now();
        let begun = || MemoryScan::new(&PMAC, true, now);
        // It refuses, does not answer, answers something else, or is never free.
        let mut scan = begun();
        assert!(scan.next_line(now).is_some());
        scan.done(true, now);
        assert_eq!(scan.take_outcome(now), Some(Outcome::Unknown));
        assert_eq!(answer(&mut scan, &[], now + AGAIN), 41, "it is asked again");
        assert_eq!(scan.take_outcome(now), Some(Outcome::Known));
        let mut scan = begun();
        assert!(scan.next_line(now).is_some());
        scan.failed(now);
        assert_eq!(scan.take_outcome(now), Some(Outcome::Unknown));
        let mut scan = begun();
        assert!(scan.next_line(now).is_some());
        scan.line(b"*");
        scan.done(false, now);
        assert_eq!(scan.take_outcome(now), Some(Outcome::Unknown), "one definition for many");
        let mut scan = begun();
        assert_eq!(scan.take_outcome(now + NO_PROGRESS), Some(Outcome::Unknown));
        let mut scan = begun();
        scan.is_silent();
        assert_eq!(scan.take_outcome(now), Some(Outcome::Unknown));
        let mut scan = MemoryScan::new(&PMAC, false, now);
        assert_eq!((scan.due_in(now), scan.take_outcome(now + AGAIN)), (Duration::MAX, None));
    }

    #[test]
    fn c3_what_is_defined_during_a_pass_begins_another() {
        let now = Instant::now();
        let mut scan = MemoryScan::new(&PMAC, true, now);
        assert!(scan.next_line(now).is_some());
        scan.sent();
        scan.line_goes(b"M5->Y:$D000", now);
        (0..A_QUESTION).for_each(|_| scan.line(b"*"));
        scan.done(false, now);
        assert_eq!(answer(&mut scan, &[(5, "Y:$D000,0,16")], now + SETTLE), 41);
        assert_eq!(scan.take_outcome(now), Some(Outcome::Known));
        assert_eq!(scan.words().count(), 1);
    }
}
