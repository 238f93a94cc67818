//! Accesses and lines of the driver that the recording does not have. The log tells each difference once, with its
//! count.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use log::{info, warn};

use super::timeline::ascii_words;
use crate::map::{Family, HostOffset, Layout};
use crate::recording::{Op, Recording};

/// How many of a kind the log names.
const NAMED: usize = 12;
/// How many of a kind the replay keeps apart.
const MOST_DIFFERENCES: usize = 4096;

/// The differences between the driver's accesses and the recording.
pub struct Differences {
    family: &'static Family,
    /// Words that the recording knows.
    known: Vec<bool>,
    /// Words that the host wrote in the recording, and those of the ASCII port, where the replay compares the lines.
    written: Vec<bool>,
    /// How often the host read each word since the log last told it; told words stay, with 0.
    reads: BTreeMap<usize, u64>,
    /// Each with the first value.
    writes: BTreeMap<usize, (u16, u64)>,
    lines: BTreeMap<String, u64>,
    /// Whether the log has told them.
    told: bool,
}

impl Differences {
    /// No differences yet, for `recording`, a board of `family`.
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
            told: false,
        }
    }

    /// The host has read `word`.
    pub fn read(&mut self, word: usize) {
        if !self.known[word] {
            *self.reads.entry(word).or_default() += 1;
        }
    }

    /// The host has written `value` to `word`, which held `found`. An equal value is no difference.
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
        } else if self.lines.len() < MOST_DIFFERENCES {
            self.lines.insert(line.to_owned(), 1);
        }
    }

    /// How many differences the replay has found.
    pub fn count(&self) -> usize {
        self.reads.len() + self.writes.len() + self.lines.len()
    }

    /// Tells the differences in the log, a line for each kind; of those told before only the new ones.
    pub fn tell(&mut self) {
        if self.count() == 0 && !self.told {
            info!("replay: nothing else was asked than was recorded");
        }
        self.report().iter().for_each(|line| warn!("{line}"));
        self.told = true;
        self.reads.values_mut().for_each(|count| *count = 0);
        self.writes.values_mut().for_each(|(_, count)| *count = 0);
        self.lines.values_mut().for_each(|count| *count = 0);
    }

    /// The untold differences, a line for each kind.
    fn report(&self) -> Vec<String> {
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
        let reads = self.reads.iter().filter(|(_, count)| **count > 0);
        let reads = reads.map(|(word, count)| format!("{} {count} times", name(word)));
        let writes = self.writes.iter().filter(|(_, (_, count))| *count > 0);
        let writes =
            writes.map(|(word, (value, count))| format!("{} {count} times, first {value:#06x}", name(word)));
        let lines = self.lines.iter().filter(|(_, count)| **count > 0);
        let lines = lines.map(|(line, count)| format!("`{line}` {count} times"));
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

fn listed(what: &str, all: impl Iterator<Item = String>) -> Option<String> {
    let all: Vec<String> = all.collect();
    let more = all.len().saturating_sub(NAMED);
    let mut text = format!("replay: {what}: {}", all[..all.len() - more].join("; "));
    if more > 0 {
        let _ = write!(text, "; and {more} more");
    }
    (!text.ends_with(": ")).then_some(text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::PMAC;
    use crate::recording::testing::recording;

    #[test]
    fn what_has_been_told_is_told_again_only_where_more_has_come() {
        let mut differences = Differences::new(&recording(), &PMAC);
        differences.asked("I5");
        differences.asked("I5");
        differences.write(5000, 0, 7);
        let report = differences.report();
        assert_eq!(report.len(), 2);
        assert_eq!(report[0], "replay: lines that the recording has no answer to: `I5` 2 times");
        assert!(report[1].ends_with(" 1 times, first 0x0007"), "{report:?}");
        differences.tell();
        assert_eq!((differences.report(), differences.count()), (Vec::new(), 2));
        differences.asked("I5");
        differences.asked("I6");
        assert_eq!(
            differences.report(),
            ["replay: lines that the recording has no answer to: `I5` 1 times; `I6` 1 times"]
        );
        assert_eq!(differences.count(), 3, "each is counted once");
    }
}
