//! Where the board's own programs keep data in the DPRAM: every M-variable that points into it.
//!
//! Sites keep data of their own there, also where automatic functions have their words (FACTS-TURBO 19.2). So the board is
//! asked for the definitions of all its M-variables, a few at a time, when nobody else has a line to send: at the start,
//! after a reset, and after a line that defines one. What another host defines meanwhile is not noticed.
//!
//! Any of them may point anywhere, so nothing is known before the last is read. Those come first that are likely to point into
//! the DPRAM: what they keep from use is told at once.

use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::daemon::shared::definition_blocks::{BLOCK, DefinitionBlocks};
use crate::format::Text;
use crate::map::word_use::{Definition, definition, m_variables};
use crate::map::{Family, HostOffset};
use crate::protocol::LINE_MAX;
use crate::protocol::program_words::DefinitionsRead;

/// Definitions asked for by one line: a longer reply would hold up other callers' lines, and a shorter one cost a slow board a
/// question more.
const A_QUESTION: u16 = 50;
/// So many at least, where the board has not answered a longer question in time.
const LEAST: u16 = 6;
/// How long the board may take for one question.
const PATIENCE: Duration = Duration::from_secs(5);
/// How long to wait before a question is asked again that was not answered, or otherwise.
const AGAIN: Duration = Duration::from_secs(1);
/// The same of a board that does not tell.
const LATER: Duration = Duration::from_secs(30);
/// How long to wait after a line that defines one: more may follow.
const SETTLE: Duration = Duration::from_secs(1);
/// How long no question need be answered until the board counts as one that does not tell.
const NO_PROGRESS: Duration = Duration::from_secs(10);
/// How long lines that always wait can put a question off.
const LONGEST: Duration = Duration::from_secs(2);
/// More than the longest definition.
const DEFINITION_MAX: usize = 40;

/// What the questions have come to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// The board has told of more that point into the DPRAM. The questions go on.
    More,
    /// The board has told all its definitions: [`MemoryScan::words`] has them.
    Known,
    /// The board does not tell them all.
    Unknown,
    /// The board has told them all, but what it says of some is no definition.
    Unclear(Unclear),
}

/// What the board says of an M-variable, where that is no definition.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unclear {
    /// The M-variable.
    pub variable: u16,
    /// The board's line.
    pub text: Text<DEFINITION_MAX>,
}

/// Asks for the definitions, and keeps which words they point to.
pub struct MemoryScan {
    family: &'static Family,
    /// All M-variables, in the order in which they are asked for.
    spans: Box<[Range<u16>]>,
    /// The span that is asked for; all are when it is past the last.
    span: usize,
    /// The M-variable to ask for next.
    next: u16,
    /// How many have been read.
    read: u16,
    /// Where a definition was found in the DPRAM, for the next start; bit 0 is the first block.
    found: u64,
    blocks: Arc<DefinitionBlocks>,
    /// Definitions that one question asks for.
    size: u16,
    /// Of each word of the DPRAM: the first M-variable that points to it, and 1; 0 where none does.
    pointers: Box<[u16]>,
    /// Some were added since the last outcome.
    has_more: bool,
    /// The first answer that is no definition.
    unclear: Option<Unclear>,
    /// Definitions of the present reply so far.
    lines: u16,
    under_way: bool,
    /// Whether to begin again when the reply has come.
    again: bool,
    not_before: Instant,
    /// When the first question was sent.
    begun: Option<Instant>,
    /// How long what has been read took.
    took: Duration,
    /// When a question was sent last, or the first could be.
    sent: Instant,
    /// When the board answered a question of ours last, or the first could be asked; later, by the time that others held the
    /// port.
    progress: Instant,
    /// Until then that is counted.
    seen: Instant,
    /// The last question was refused, or not answered in time, or otherwise.
    has_failed: bool,
    /// The present question was acknowledged without an answer before.
    is_repeated: bool,
    /// What came of the questions, until it is taken.
    outcome: Option<Outcome>,
    /// Whether all are known, or not, is still to be told.
    is_awaited: bool,
    wanted: bool,
}

impl MemoryScan {
    /// Asks the board, of `family`, from `now` on, if that is `wanted`: first for the `blocks` in which a definition was found last
    /// time.
    #[must_use]
    pub fn new(family: &'static Family, wanted: bool, blocks: Arc<DefinitionBlocks>, now: Instant) -> Self {
        let spans = blocks.order(m_variables(family));
        Self {
            family,
            span: 0,
            next: spans.first().map_or(0, |span| span.start),
            spans,
            read: 0,
            found: 0,
            blocks,
            size: A_QUESTION,
            pointers: vec![0; if wanted { family.length as usize / 2 } else { 0 }].into(),
            has_more: false,
            unclear: None,
            lines: 0,
            under_way: false,
            again: false,
            not_before: now,
            begun: None,
            took: Duration::ZERO,
            sent: now,
            progress: now,
            seen: now,
            has_failed: false,
            is_repeated: false,
            outcome: None,
            is_awaited: true,
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

    /// Whether a question has waited so long that other lines wait for it now.
    #[must_use]
    pub fn is_overdue(&self, now: Instant) -> bool {
        self.due_in(now).is_zero() && now >= self.not_before.max(self.sent) + LONGEST
    }

    /// How far the questions are.
    #[must_use]
    pub fn progress(&self) -> DefinitionsRead {
        let (read, of) = (u32::from(self.read), u32::from(m_variables(self.family)));
        let left = (read > 0).then(|| self.took.as_secs_f64() * f64::from(of - read) / f64::from(read));
        DefinitionsRead { read, of, seconds_left: left.map(|seconds| seconds.ceil() as u32) }
    }

    fn is_over(&self) -> bool {
        self.span >= self.spans.len()
    }

    /// The line to send now, if any, and how long to wait for its reply. It asks for at most `most_lines` definitions, but at least
    /// six. Tell with [`Self::sent`] if it was sent.
    pub fn next_line(&mut self, most_lines: u16, now: Instant) -> Option<(Text<LINE_MAX>, Duration)> {
        if !self.due_in(now).is_zero() {
            return None;
        }
        self.lines = 0;
        self.size = self.size.min(most_lines.max(LEAST));
        Some((Text::of(&format_args!("M{}..{}->", self.next, self.last())), PATIENCE))
    }

    /// The last M-variable of the present question.
    fn last(&self) -> u16 {
        let end = self.spans.get(self.span).map_or(self.next, |span| span.end);
        (self.next + self.size).min(end).saturating_sub(1)
    }

    /// The line was sent.
    pub fn sent(&mut self, now: Instant) {
        self.under_way = true;
        self.begun.get_or_insert(now);
        self.sent = now;
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
        if number > self.last() {
            return;
        }
        let text = std::str::from_utf8(line).ok();
        match text.and_then(|text| definition(text, number, self.family)) {
            Some(Definition::Elsewhere) => {}
            Some(Definition::Dpram(place)) => {
                self.found |= 1 << (number / BLOCK);
                let words = self.pointers.iter_mut().skip(place.offset.word()).take(place.space.words());
                for word in words.filter(|word| **word == 0) {
                    *word = number + 1;
                    self.has_more = true;
                }
            }
            None => {
                let unclear = || Unclear { variable: number, text: Text::from_bytes(line.trim_ascii()) };
                self.unclear.get_or_insert_with(unclear);
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
        let is_whole = !is_refused && self.lines == self.last() - self.next + 1;
        if self.again || !is_whole {
            return self.failed(now);
        }
        (self.under_way, self.has_failed) = (false, false);
        self.progress = now;
        self.took = self.begun.map_or(Duration::ZERO, |begun| now.saturating_duration_since(begun));
        let end = self.last() + 1;
        self.read += end - self.next;
        self.next = end;
        if self.spans.get(self.span).is_none_or(|span| span.end == end) {
            self.span += 1;
            self.next = self.spans.get(self.span).map_or(end, |span| span.start);
        }
        if now < self.sent + PATIENCE / 2 {
            self.size = (2 * self.size).min(A_QUESTION);
        }
        if self.is_over() {
            self.blocks.set(self.found);
            self.tell(self.unclear.map_or(Outcome::Known, Outcome::Unclear));
        } else {
            self.tell_more();
        }
    }

    /// The board did not answer, or not so. What it has told stands, and it is asked again, for fewer.
    pub fn failed(&mut self, now: Instant) {
        self.under_way = false;
        if self.again {
            return self.restart();
        }
        self.has_failed = true;
        self.tell_more();
        self.size = (self.size / 2).max(LEAST);
        self.not_before = now + if self.is_awaited { AGAIN } else { LATER };
    }

    fn tell_more(&mut self) {
        if std::mem::take(&mut self.has_more) {
            self.outcome = Some(Outcome::More);
        }
    }

    fn tell(&mut self, outcome: Outcome) {
        self.outcome = Some(outcome);
        self.is_awaited = false;
        self.has_more = false;
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
        self.is_awaited = true;
        self.has_failed = false;
        (self.not_before, self.progress) = (not_before, not_before);
        self.restart();
    }

    fn restart(&mut self) {
        if self.again && !self.under_way {
            self.again = false;
            self.span = 0;
            self.next = self.spans.first().map_or(0, |span| span.start);
            (self.read, self.found) = (0, 0);
            self.begun = None;
            self.pointers.fill(0);
            self.has_more = false;
            self.unclear = None;
        }
    }

    /// The board answers other questions of ours: it will come to these, if it has not refused one.
    pub const fn is_answering(&mut self, now: Instant) {
        if !self.has_failed {
            self.progress = now;
        }
    }

    /// It is `now`. The time since the last call does not count against the board if `others_hold` the port.
    pub fn pass(&mut self, others_hold: bool, now: Instant) {
        if others_hold {
            self.progress += now.saturating_duration_since(self.seen);
        }
        self.seen = now;
    }

    /// What has come out since the last call. Here `now` decides, too: who waits for the definitions need not wait for a
    /// board that does not tell them.
    pub fn take_outcome(&mut self, now: Instant) -> Option<Outcome> {
        if self.wanted && self.is_awaited && now >= self.progress + NO_PROGRESS {
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

    fn scan_of(family: &'static Family, wanted: bool, now: Instant) -> MemoryScan {
        MemoryScan::new(family, wanted, Arc::default(), now)
    }

    #[test]
    fn where_a_definition_was_found_last_time_is_asked_for_first_and_told_at_once() {
        let now = Instant::now();
        let blocks = Arc::new(DefinitionBlocks::new(0));
        let mut scan = MemoryScan::new(&TURBO2, true, Arc::clone(&blocks), now);
        answer(&mut scan, &[(2050, "DP:$60080"), (7, "X:$C000,8")], now);
        let found = blocks.take_changed().unwrap();
        assert_eq!((found, blocks.take_changed()), (1 << 16, None));
        let mut scan = MemoryScan::new(&TURBO2, true, Arc::new(DefinitionBlocks::new(found)), now);
        let (line, _) = scan.next_line(u16::MAX, now).unwrap();
        assert_eq!(line.as_bytes(), b"M2048..2097->");
        scan.sent(now);
        (2048..2098).for_each(|number| scan.line(if number == 2050 { b"DP:$60080" } else { b"*" }));
        scan.done(false, now);
        assert_eq!(scan.take_outcome(now), Some(Outcome::More), "it is told before the others are read");
        assert_eq!(scan.progress().read, 50);
    }

    /// Answers every question with `*`, but for these definitions. How many were asked.
    fn answer(scan: &mut MemoryScan, definitions: &[(u16, &str)], now: Instant) -> usize {
        let mut asked = 0;
        while let Some((line, _)) = scan.next_line(u16::MAX, now) {
            let line = std::str::from_utf8(line.as_bytes()).unwrap();
            let range = line.strip_prefix('M').and_then(|line| line.strip_suffix("->")).unwrap();
            let (first, last) = range.split_once("..").unwrap();
            let (first, last): (u16, u16) = (first.parse().unwrap(), last.parse().unwrap());
            assert!(last - first < 50, "{line}: at most 50 lines");
            scan.sent(now);
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
        for (family, asked) in [(&PMAC, 21), (&TURBO2, 165)] {
            let base = family.base;
            let definitions = [
                (211, format!("DP:${:X}", base + 0x80)),
                (212, format!("DP:${:X}", base + 0x80)),
                (m_variables(family) - 1, format!("X:${:X},0,16,S", base + 5)),
                (3, "X:$C000,8".to_owned()),
            ];
            let definitions: Vec<_> =
                definitions.iter().map(|(number, text)| (*number, text.as_str())).collect();
            let mut scan = scan_of(family, true, now);
            assert_eq!(scan.take_outcome(now), None);
            assert_eq!(answer(&mut scan, &definitions, now), asked);
            assert_eq!(scan.take_outcome(now), Some(Outcome::Known));
            assert_eq!(scan.take_outcome(now), None, "told once");
            let found: Vec<_> = scan.words().map(|(at, number)| (at.bytes(), number)).collect();
            assert_eq!(found, [(0x16, m_variables(family) - 1), (0x200, 211), (0x202, 211)]);
            // One is taken away by a line.
            scan.line_goes(b"M211->*", now);
            assert_eq!(scan.next_line(u16::MAX, now), None, "more may follow");
            assert_eq!(answer(&mut scan, &definitions[1..], now + SETTLE), asked);
            assert_eq!(scan.words().nth(1).unwrap().1, 212);
        }
    }

    #[test]
    fn c3_a_board_that_cannot_be_asked_keeps_nobody_waiting() {
        let now = Instant::now();
        let begun = || scan_of(&PMAC, true, now);
        // It refuses, does not answer, answers something else, or is never free.
        // After an answer it is asked for fewer at first: 6, 12, 24, 50 …
        type Answering = fn(&mut MemoryScan, Instant);
        let answers: [(Answering, usize); 4] = [
            (|scan, now| scan.done(true, now), 23),
            (MemoryScan::failed, 23),
            (
                |scan, now| {
                    scan.line(b"*");
                    scan.done(false, now);
                },
                23,
            ),
            (|_, _| {}, 21),
        ];
        for (otherwise, questions) in answers {
            let mut scan = begun();
            let mut time = now;
            while time < now + NO_PROGRESS {
                assert_eq!(scan.take_outcome(time), None, "silent now is not silent for ten seconds");
                if scan.next_line(u16::MAX, time).is_some() {
                    scan.sent(time);
                    otherwise(&mut scan, time);
                }
                time += AGAIN;
            }
            assert_eq!(scan.take_outcome(time), Some(Outcome::Unknown));
            assert_eq!(scan.take_outcome(time + LATER), None, "told once");
            assert_eq!(answer(&mut scan, &[], time + LATER), questions, "it is asked again");
            assert_eq!(scan.take_outcome(time + LATER), Some(Outcome::Known));
        }
        let mut scan = scan_of(&PMAC, false, now);
        assert_eq!((scan.due_in(now), scan.take_outcome(now + AGAIN)), (Duration::MAX, None));
    }

    #[test]
    fn a_board_that_refuses_to_tell_is_waited_for_no_longer_because_it_answers_other_questions() {
        let now = Instant::now();
        let mut scan = scan_of(&PMAC, true, now);
        let mut time = now;
        // It is asked who it is first.
        while time < now + 2 * NO_PROGRESS {
            time += AGAIN;
            scan.is_answering(time);
            assert_eq!(scan.take_outcome(time), None);
        }
        let begun = time;
        while scan.take_outcome(time).is_none() {
            assert!(time <= begun + NO_PROGRESS, "{:?}", time - begun);
            if scan.next_line(u16::MAX, time).is_some() {
                scan.sent(time);
                scan.done(true, time);
            }
            scan.is_answering(time);
            time += AGAIN;
        }
    }

    #[test]
    fn c3_what_was_told_stands_whatever_becomes_of_the_other_questions() {
        let now = Instant::now();
        let mut scan = scan_of(&PMAC, true, now);
        for question in 0..3_u16 {
            assert!(scan.next_line(u16::MAX, now).is_some());
            scan.sent(now);
            for number in 0..A_QUESTION {
                scan.line(if (question, number) == (1, 5) { b"DP:$D012" } else { b"*" });
            }
            scan.done(false, now);
            assert_eq!(scan.take_outcome(now), (question == 1).then_some(Outcome::More));
        }
        // The fourth is answered short, with one more, and then not at all.
        let (mut time, mut told) = (now, Vec::new());
        for answer in 0..8 {
            let (line, _) = scan.next_line(u16::MAX, time).unwrap();
            let lines: [&[u8]; 4] = [b"M150..199->", b"M150..174->", b"M150..161->", b"M150..155->"];
            assert_eq!(line.as_bytes(), lines[answer.min(3)], "they are asked again, fewer");
            scan.sent(time);
            if answer == 0 {
                scan.line(b"Y:$D000");
                scan.done(false, time);
            } else {
                scan.failed(time);
            }
            time += AGAIN;
            told.extend(scan.take_outcome(time));
        }
        assert_eq!(told, [Outcome::More]);
        assert_eq!(scan.take_outcome(now + NO_PROGRESS), Some(Outcome::Unknown));
        let numbers: Vec<_> = scan.words().map(|(_, number)| number).collect();
        assert_eq!(numbers, [150, 55, 55]);
        assert_eq!(answer(&mut scan, &[], now + NO_PROGRESS + LATER), 20, "the others are not asked again");
    }

    /// A question costs a slow board 0.4 s, or each definition 0.15 s: all of them are read, and it is told how long that takes.
    #[test]
    fn c3_a_slow_board_is_read_to_its_end_and_how_far_that_is_is_known() {
        for (a_question, a_line, most) in [(400, 0, 67), (0, 150, 1500)] {
            let began = Instant::now();
            let mut scan = scan_of(&TURBO2, true, began);
            assert_eq!(scan.progress(), DefinitionsRead { read: 0, of: 8192, seconds_left: None });
            let (mut now, mut half) = (began, None);
            while !scan.is_over() {
                now += scan.due_in(now);
                let (_, patience) = scan.next_line(u16::MAX, now).unwrap();
                scan.sent(now);
                let lines = scan.last() - scan.next + 1;
                let takes = Duration::from_millis(a_question + a_line * u64::from(lines));
                now += takes.min(patience);
                if takes > patience {
                    scan.failed(now);
                } else {
                    (0..lines).for_each(|_| scan.line(b"*"));
                    scan.done(false, now);
                }
                assert_ne!(scan.take_outcome(now), Some(Outcome::Unknown));
                if scan.read >= 4096 {
                    half.get_or_insert((now, scan.progress().seconds_left.unwrap()));
                }
            }
            let ((half, told), all) = (half.unwrap(), now.duration_since(began));
            assert!(all < Duration::from_secs(most), "{all:?}");
            let left = now.duration_since(half).as_secs_f64();
            assert!((f64::from(told) - left).abs() < 0.1 * left, "{told} s were told, {left} s were left");
        }
    }

    #[test]
    fn c3_a_slow_board_is_asked_for_as_many_as_it_tells_in_time() {
        let now = Instant::now();
        let asked = |most_lines| {
            let line = scan_of(&TURBO2, true, now).next_line(most_lines, now).unwrap().0;
            String::from_utf8(line.as_bytes().to_vec()).unwrap()
        };
        assert_eq!([20, 2].map(asked), ["M0..19->", "M0..5->"]);
    }

    #[test]
    fn c3_time_in_which_others_hold_the_port_does_not_count() {
        let now = Instant::now();
        let mut scan = scan_of(&PMAC, true, now);
        for second in 0..60 {
            let time = now + Duration::from_secs(second);
            scan.pass(second > 2, time);
            assert_eq!(scan.take_outcome(time), None, "{second}");
        }
        let freed = now + Duration::from_secs(59);
        assert!(scan.is_overdue(freed), "lines that always wait do not put it off for ever");
        scan.pass(false, freed + Duration::from_secs(7));
        assert_eq!(scan.take_outcome(freed + Duration::from_secs(7)), None);
        assert_eq!(scan.take_outcome(freed + NO_PROGRESS), Some(Outcome::Unknown));
    }

    #[test]
    fn c3_an_answer_that_is_no_definition_does_not_say_that_none_points() {
        let now = Instant::now();
        let mut scan = scan_of(&PMAC, true, now);
        assert_eq!(answer(&mut scan, &[(7, "M8->DP:$D012"), (9, "?")], now), 21);
        let unclear = Unclear { variable: 7, text: Text::from_bytes(b"M8->DP:$D012") };
        assert_eq!(scan.take_outcome(now), Some(Outcome::Unclear(unclear)));
        scan.begin_anew(now);
        assert_eq!(answer(&mut scan, &[(8, "M8->DP:$D012")], now), 21);
        assert_eq!(scan.take_outcome(now), Some(Outcome::Known));
        assert_eq!(scan.words().count(), 2);
    }

    #[test]
    fn c3_what_is_defined_during_a_pass_begins_another() {
        let now = Instant::now();
        let mut scan = scan_of(&PMAC, true, now);
        assert!(scan.next_line(u16::MAX, now).is_some());
        scan.sent(now);
        scan.line_goes(b"M5->Y:$D000", now);
        (0..A_QUESTION).for_each(|_| scan.line(b"*"));
        scan.done(false, now);
        assert_eq!(answer(&mut scan, &[(5, "Y:$D000,0,16")], now + SETTLE), 21);
        assert_eq!(scan.take_outcome(now), Some(Outcome::Known));
        assert_eq!(scan.words().count(), 1);
    }
}
