//! Where the board's own programs keep data in the DPRAM: every M-variable that points into it.
//!
//! Sites keep data of their own there, also in the words of automatic functions (pgpmac does on a Turbo board). So the
//! daemon asks the board for the definitions of all M-variables, a few at a time, when no client has a line to send: at
//! the start, after a reset, and after a line that defines an M-variable. The daemon does not notice definitions by
//! another host meanwhile.
//!
//! Any M-variable may point anywhere, so the daemon has to read the last definition before it knows all. It first reads
//! the M-variables that are likely to point into the DPRAM, and tells at once which functions these keep from use.

use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::daemon::bus::timing::{
    DEFINITIONS_AFTER_LINE, DEFINITIONS_AGAIN, DEFINITIONS_AGAIN_AT_LAST, DEFINITIONS_ANSWER,
    DEFINITIONS_NOT_TOLD, DEFINITIONS_PUT_OFF_AT_MOST,
};
use crate::daemon::shared::definition_blocks::{BLOCK, DefinitionBlocks};
use crate::format::Text;
use crate::language::{LINE_MAX, Meaning};
use crate::map::word_use::{Definition, definition, m_variables};
use crate::map::{Family, HostOffset};
use crate::protocol::program_words::DefinitionsRead;

/// Definitions in one question: a longer reply would hold up other clients' lines, and a shorter one would cost a slow
/// board more questions.
const A_QUESTION: u16 = 50;
/// The fewest definitions in one question, after the board has not answered longer ones in time.
const LEAST: u16 = 6;
/// Longer than the longest definition.
const DEFINITION_MAX: usize = 40;

/// The outcome of the questions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// The board has told of more M-variables that point into the DPRAM. The questions go on.
    More,
    /// The board has told all its definitions: [`MemoryScan::words`] has them.
    Known,
    /// The board does not tell all its definitions.
    Unknown,
    /// The board has answered for all M-variables, but some answers are no definitions.
    Unclear(Unclear),
}

/// The board's answer for an M-variable that is no definition.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unclear {
    /// The M-variable.
    pub variable: u16,
    /// The board's line.
    pub text: Text<DEFINITION_MAX>,
}

/// Asks for the definitions, and keeps the words that they point to.
pub struct MemoryScan {
    family: &'static Family,
    /// All M-variables, in the order of the questions.
    spans: Box<[Range<u16>]>,
    /// The span under question; past the last span once the daemon has asked all.
    span: usize,
    /// The M-variable to ask for next.
    next: u16,
    /// How many definitions the daemon has read.
    read: u16,
    /// The blocks with a definition that points into the DPRAM, for the next start; bit 0 is the first block.
    found: u64,
    blocks: Arc<DefinitionBlocks>,
    /// How many definitions one question asks for.
    size: u16,
    /// For each word of the DPRAM: the number of the first M-variable that points to it, plus 1; 0 if none does.
    pointers: Box<[u16]>,
    /// The board has told of more pointers since the last outcome.
    has_more: bool,
    /// The first answer that is no definition.
    unclear: Option<Unclear>,
    /// Definitions of the present reply so far.
    lines: u16,
    under_way: bool,
    /// Whether to begin again when the reply has come.
    again: bool,
    not_before: Instant,
    /// When the daemon sent the first question.
    begun: Option<Instant>,
    /// How long the definitions read so far took.
    took: Duration,
    /// When the daemon sent the last question, or could have sent the first.
    sent: Instant,
    /// When the board last answered a question of the daemon's, or the daemon could ask the first; later by the time
    /// that others held the port.
    progress: Instant,
    /// Until when `progress` counts the others' time.
    seen: Instant,
    /// The board refused the last question, did not answer in time, or answered something else.
    has_failed: bool,
    /// The outcome of the questions, until the loop takes it.
    outcome: Option<Outcome>,
    /// The scan has yet to tell whether the daemon knows all definitions.
    is_awaited: bool,
    wanted: bool,
}

impl MemoryScan {
    /// Asks the board, of `family`, from `now` on, if `wanted`: first for the `blocks` in which the daemon found
    /// definitions last time.
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
            outcome: None,
            is_awaited: true,
            wanted,
        }
    }

    /// Whether the daemon asks the board at all.
    #[must_use]
    pub const fn is_wanted(&self) -> bool {
        self.wanted
    }

    /// How long until the next question is due.
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
        self.due_in(now).is_zero() && now >= self.not_before.max(self.sent) + DEFINITIONS_PUT_OFF_AT_MOST
    }

    /// The progress of the questions.
    #[must_use]
    pub fn progress(&self) -> DefinitionsRead {
        let (read, of) = (u32::from(self.read), u32::from(m_variables(self.family)));
        let left = (read > 0).then(|| self.took.as_secs_f64() * f64::from(of - read) / f64::from(read));
        DefinitionsRead { read, of, seconds_left: left.map(|seconds| seconds.ceil() as u32) }
    }

    fn is_over(&self) -> bool {
        self.span >= self.spans.len()
    }

    /// The line to send now, if any, and how long to wait for its reply. The line asks for at most `most_lines`
    /// definitions, but at least six. The caller reports the sent line by [`Self::sent`].
    pub fn next_line(&mut self, most_lines: u16, now: Instant) -> Option<(Text<LINE_MAX>, Duration)> {
        if !self.due_in(now).is_zero() {
            return None;
        }
        self.lines = 0;
        self.size = self.size.min(most_lines.max(LEAST));
        Some((Text::of(&format_args!("M{}..{}->", self.next, self.last())), DEFINITIONS_ANSWER))
    }

    /// The last M-variable of the present question.
    fn last(&self) -> u16 {
        let end = self.spans.get(self.span).map_or(self.next, |span| span.end);
        (self.next + self.size).min(end).saturating_sub(1)
    }

    /// The daemon has sent the line.
    pub fn sent(&mut self, now: Instant) {
        self.under_way = true;
        self.begun.get_or_insert(now);
        self.sent = now;
    }

    /// The daemon did not send the line after all, and asks again.
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
        if now < self.sent + DEFINITIONS_ANSWER / 2 {
            self.size = (2 * self.size).min(A_QUESTION);
        }
        if self.is_over() {
            self.blocks.set(self.found);
            self.tell(self.unclear.map_or(Outcome::Known, Outcome::Unclear));
        } else {
            self.tell_more();
        }
    }

    /// The board did not answer, or answered something else. Its earlier answers stand, and the daemon asks again, for
    /// fewer definitions.
    pub fn failed(&mut self, now: Instant) {
        self.under_way = false;
        if self.again {
            return self.restart();
        }
        self.has_failed = true;
        self.tell_more();
        self.size = (self.size / 2).max(LEAST);
        self.not_before = now + if self.is_awaited { DEFINITIONS_AGAIN } else { DEFINITIONS_AGAIN_AT_LAST };
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

    /// A client's line goes to the board. A line that defines an M-variable begins the questions anew.
    pub fn line_goes(&mut self, line: &Meaning, now: Instant) {
        if line.defines_m {
            self.begin_anew(now + DEFINITIONS_AFTER_LINE);
        }
    }

    /// The board may have other definitions: the daemon asks for them again, from `not_before` on.
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

    /// The board answers the daemon's other questions: it will come to the scan's, unless the scan's last question
    /// failed.
    pub const fn is_answering(&mut self, now: Instant) {
        if !self.has_failed {
            self.progress = now;
        }
    }

    /// Counts the time until `now`. The time since the last call does not count against the board if `others_hold` the
    /// port.
    pub fn pass(&mut self, others_hold: bool, now: Instant) {
        if others_hold {
            self.progress += now.saturating_duration_since(self.seen);
        }
        self.seen = now;
    }

    /// The outcome since the last call. `now` decides, too: callers that wait for the definitions need not wait for a
    /// board that does not tell them.
    pub fn take_outcome(&mut self, now: Instant) -> Option<Outcome> {
        if self.wanted && self.is_awaited && now >= self.progress + DEFINITIONS_NOT_TOLD {
            self.tell(Outcome::Unknown);
        }
        self.outcome.take()
    }

    /// The words that M-variables point to, ascending, each with the first M-variable that points to it.
    pub fn words(&self) -> impl Iterator<Item = (HostOffset, u16)> {
        let words = self.pointers.iter().enumerate().filter(|(_, number)| **number != 0);
        words.map(|(word, number)| (HostOffset::new(0).plus_words(word), number - 1))
    }
}

#[cfg(test)]
#[path = "memory_scan_tests.rs"]
mod tests;
