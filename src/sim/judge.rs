//! The judge: records every breach of the handshakes by a host.
//!
//! The judge compares each word that only PMAC writes with PMAC's last write, and the host's command text between the
//! pass that saw its flag and the pass that takes the text. It records a finding once, with the number of the servo
//! cycle.

use std::collections::BTreeMap;

use crate::map::functions::RESPONSE_BYTES;
use crate::map::{BusyRule, Family, Flag, HostOffset};
use crate::sim::board::dpram::Dpram;

/// The most findings kept; more are only counted.
const KEPT: usize = 100;
/// Words of PMAC's half compared in one background pass.
const WORDS_PER_PASS: usize = 64;

/// The judge and its findings.
#[derive(Debug, Clone)]
pub struct Judge {
    family: &'static Family,
    /// The words that only PMAC writes, outside the reports' headers: the reports' data and the response, except its
    /// first word, which the host may clear. Each stretch: the first word, and the first word after it.
    pmacs: [(HostOffset, HostOffset); 3],
    violations: Vec<String>,
    total: u64,
    /// The next word of the walk through PMAC's half: range and word in the range.
    range: usize,
    next: usize,
    /// States that are wrong at present, by their subject.
    present: BTreeMap<String, String>,
}

impl Judge {
    /// A judge of hosts of boards of `family`.
    #[must_use]
    pub fn new(family: &'static Family) -> Self {
        let Family { servo, background, ascii, .. } = family;
        let pmacs = [
            (servo.global.first, servo.region.end),
            (background.global.first, background.region.end),
            (ascii.response.plus_words(1), ascii.response.plus_words(RESPONSE_BYTES / 2)),
        ];
        let (violations, present) = (Vec::new(), BTreeMap::new());
        Self { family, pmacs, violations, total: 0, range: 0, next: 0, present }
    }

    /// The findings, oldest first, at most 100.
    #[must_use]
    pub fn violations(&self) -> &[String] {
        &self.violations
    }

    /// How many there were in all.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.total
    }

    /// Records a finding.
    pub fn record(&mut self, cycle: u64, what: &str) {
        self.total += 1;
        if self.violations.len() < KEPT {
            self.violations.push(format!("cycle {cycle}: {what}"));
        }
    }

    /// Records the wrong state `what` of `subject` when it begins; `None` ends the state. A state that lasts is one
    /// finding.
    pub fn state(&mut self, cycle: u64, subject: &str, what: Option<String>) {
        let Some(what) = what else {
            self.present.remove(subject);
            return;
        };
        if self.present.get(subject) != Some(&what) {
            self.record(cycle, &what);
            self.present.insert(subject.to_owned(), what);
        }
    }

    /// One background pass: the words whose change does the most harm, and a stretch of the others.
    pub fn poll(&mut self, cycle: u64, dpram: &mut Dpram) {
        let Family { servo, background, ascii, .. } = self.family;
        for word in [servo.timer.low, background.timer.low, ascii.response_count] {
            self.pmacs_word(word, cycle, dpram);
        }
        if servo.busy == BusyRule::ClearWhileWriting {
            self.may_only_take(servo.pmac_status, cycle, dpram);
        } else {
            self.pmacs_word(servo.pmac_status.word, cycle, dpram);
        }
        for _ in 0..WORDS_PER_PASS {
            let (first, end) = self.pmacs[self.range];
            let offset = first.plus_words(self.next);
            self.pmacs_word(offset, cycle, dpram);
            self.next += 1;
            if offset.plus_words(1) >= end {
                self.range = (self.range + 1) % self.pmacs.len();
                self.next = 0;
            }
        }
        for word in [ascii.response_control, ascii.response] {
            self.may_only_clear(word, "the host writes only 0 there", cycle, dpram);
        }
        self.may_only_take(background.ready, cycle, dpram);
        let word = ascii.command_loaded.word;
        let flag = dpram.read16(word);
        if flag & !ascii.command_loaded.mask != 0 && flag != dpram.shadow(word) {
            let reserved = !ascii.command_loaded.mask;
            self.record(cycle, &format!("{word} = 0x{flag:04X}: the bits of 0x{reserved:04X} are reserved"));
            dpram.adopt(word, flag);
        }
    }

    /// Judges a report's ready flag. The host takes the report: it clears the flag, or the whole word with the upper
    /// part of the timer that Turbo keeps there. Public drivers do either (Turbo User Manual p. 403).
    fn may_only_take(&mut self, ready: Flag, cycle: u64, dpram: &mut Dpram) {
        let Flag { word, mask } = ready;
        let (found, own) = (dpram.read16(word), dpram.shadow(word));
        if ![own, own & !mask, 0].contains(&found) {
            self.record(
                cycle,
                &format!("the host wrote 0x{found:04X} to {word}: the host only clears Data-Ready"),
            );
        }
        dpram.adopt(word, found);
    }

    /// Compares a word that only PMAC writes with PMAC's last write.
    pub fn pmacs_word(&mut self, offset: HostOffset, cycle: u64, dpram: &mut Dpram) {
        let (found, own) = (dpram.read16(offset), dpram.shadow(offset));
        if found != own {
            self.record(
                cycle,
                &format!("the host wrote 0x{found:04X} to {offset}, which is PMAC's (was 0x{own:04X})"),
            );
            dpram.adopt(offset, found);
        }
    }

    /// As [`Judge::pmacs_word`], for a word that the host may only set to 0.
    pub fn may_only_clear(&mut self, offset: HostOffset, rule: &str, cycle: u64, dpram: &mut Dpram) {
        let found = dpram.read16(offset);
        if found != dpram.shadow(offset) {
            if found != 0 {
                self.record(cycle, &format!("the host wrote 0x{found:04X} to {offset}: {rule}"));
            }
            dpram.adopt(offset, found);
        }
    }
}
