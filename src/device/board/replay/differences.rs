//! Where the driver asks a replay for something else than was recorded. Each is told once, with how often it was.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use super::timeline::ascii_words;
use crate::map::{Family, HostOffset, Layout};
use crate::recording::{Op, Recording};

/// So many of a kind are told by name.
const NAMED: usize = 12;
/// So many of a kind are told apart.
const MOST: usize = 4096;

/// What was asked otherwise.
pub struct Differences {
    family: &'static Family,
    /// Words that the recording tells of.
    known: Vec<bool>,
    /// Words that the host wrote then, and those of the ASCII port, whose lines are compared.
    written: Vec<bool>,
    reads: BTreeMap<usize, u64>,
    /// With the first value.
    writes: BTreeMap<usize, (u16, u64)>,
    lines: BTreeMap<String, u64>,
}

impl Differences {
    /// None yet, from `recording`, a board of `family`.
    pub fn new(recording: &Recording, family: &'static Family) -> Self {
        let words = family.length as usize / 2;
        let mut known = vec![!recording.images.is_empty(); words];
        let mut written = vec![false; words];
        for access in &recording.accesses {
            let marks = if access.op == Op::Read { &mut known } else { &mut written };
            let all = access.offset.word()..access.offset.word() + usize::from(access.width / 16);
            marks[all].fill(true);
        }
        for words in ascii_words(family) {
            let words = usize::from(words.start)..usize::from(words.end);
            known[words.clone()].fill(true);
            written[words].fill(true);
        }
        Self {
            family,
            known,
            written,
            reads: BTreeMap::new(),
            writes: BTreeMap::new(),
            lines: BTreeMap::new(),
        }
    }

    /// The host has read `word`.
    pub fn read(&mut self, word: usize) {
        if !self.known[word] {
            *self.reads.entry(word).or_default() += 1;
        }
    }

    /// The host has written `value` to `word`, where `found` lay. What changes nothing is no difference.
    pub fn write(&mut self, word: usize, found: u16, value: u16) {
        if !self.written[word] && found != value {
            self.writes.entry(word).or_insert((value, 0)).1 += 1;
        }
        self.known[word] = true;
    }

    /// The host has sent a line to which the recording has no answer.
    pub fn asked(&mut self, line: &str) {
        if let Some(count) = self.lines.get_mut(line) {
            *count += 1;
        } else if self.lines.len() < MOST {
            self.lines.insert(line.to_owned(), 1);
        }
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.reads.len() + self.writes.len() + self.lines.len()
    }

    /// They, a line each; one line where there are none.
    pub fn report(&self) -> Vec<String> {
        if self.count() == 0 {
            return vec!["replay: nothing else was asked than was recorded".to_owned()];
        }
        let layout = Layout::new(self.family, None);
        let name = |word: &usize| {
            let offset = HostOffset::new(2 * *word as u32);
            let entry = layout.entries().find(|entry| entry.contains(offset));
            let register = entry.map_or_else(String::new, |entry| {
                let number = entry.number.map_or_else(String::new, |number| format!(" {number}"));
                format!(" ({} {}{number})", entry.register.function, entry.register.name)
            });
            format!("{offset}{register}")
        };
        let reads = self.reads.iter().map(|(word, count)| format!("{} {count} times", name(word)));
        let writes = self
            .writes
            .iter()
            .map(|(word, (value, count))| format!("{} {count} times, first {value:#06x}", name(word)));
        let lines = self.lines.iter().map(|(line, count)| format!("`{line}` {count} times"));
        [
            listed("lines that the recording has no answer to", lines),
            listed("words read that it holds nothing of", reads),
            listed("words written that it never wrote", writes),
        ]
        .into_iter()
        .flatten()
        .collect()
    }
}

fn listed(what: &str, all: impl ExactSizeIterator<Item = String>) -> Option<String> {
    let more = all.len().saturating_sub(NAMED);
    let mut text = format!("replay: {what}: {}", all.take(NAMED).collect::<Vec<_>>().join("; "));
    if more > 0 {
        let _ = write!(text, "; and {more} more");
    }
    (!text.ends_with(": ")).then_some(text)
}
