//! The judge: records what a host does against the handshakes.
//!
//! A word that only PMAC writes is compared with what PMAC wrote last; the host's command text is compared between the
//! pass that saw its flag and the pass that takes it. A finding is recorded once, with the number of the servo cycle.

use std::collections::BTreeMap;

use crate::sim::board::dpram::Dpram;
use crate::sim::board::offsets;

/// The most findings kept; more are only counted.
const KEPT: usize = 100;
/// Words of PMAC's half looked at in one background pass.
const WORDS_PER_PASS: u16 = 64;

/// Byte ranges that only PMAC writes: servo report, background report, response. First and one past the last.
const PMACS: [(u16, u16); 3] = [
    (offsets::SERVO_PMAC_STATUS, offsets::BACKGROUND_READY),
    (offsets::BACKGROUND_TIMER, offsets::ASCII_OUT_CONTROL),
    (offsets::ASCII_IN_COUNT, offsets::VARIABLE_WRITE_COUNT),
];

/// What the judge has found.
#[derive(Debug, Clone, Default)]
pub struct Judge {
    violations: Vec<String>,
    total: u64,
    /// Where the walk through PMAC's half goes on: range and offset.
    range: usize,
    next: u16,
    /// States that are wrong at present, by what they concern.
    present: BTreeMap<&'static str, String>,
}

impl Judge {
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

    /// Records the wrong state `what` of `subject` when it begins, and forgets it with `None`: a state that lasts is one
    /// finding.
    pub fn state(&mut self, cycle: u64, subject: &'static str, what: Option<String>) {
        let Some(what) = what else {
            self.present.remove(subject);
            return;
        };
        if self.present.get(subject) != Some(&what) {
            self.record(cycle, &what);
            self.present.insert(subject, what);
        }
    }

    /// One background pass: the words whose change hurts most, and a stretch of the others.
    pub fn poll(&mut self, cycle: u64, dpram: &mut Dpram) {
        self.pmacs_word(offsets::SERVO_PMAC_STATUS, cycle, dpram);
        self.pmacs_word(offsets::ASCII_IN_COUNT, cycle, dpram);
        for _ in 0..WORDS_PER_PASS {
            let (first, end) = PMACS[self.range];
            let offset = self.next.max(first);
            self.pmacs_word(offset, cycle, dpram);
            if offset + 2 < end {
                self.next = offset + 2;
            } else {
                self.range = (self.range + 1) % PMACS.len();
                self.next = 0;
            }
        }
        self.may_only_clear(offsets::ASCII_IN_CONTROL, "the host writes only 0 there", cycle, dpram);
        self.may_only_clear(offsets::BACKGROUND_READY, "the host only clears Data-Ready", cycle, dpram);
        let flag = dpram.read16(offsets::ASCII_OUT_CONTROL);
        if flag > 1 && flag != dpram.shadow(offsets::ASCII_OUT_CONTROL) {
            let word = offsets::ASCII_OUT_CONTROL;
            self.record(cycle, &format!("0x{word:04X} = 0x{flag:04X}: bits 1-15 are reserved"));
            dpram.adopt(offsets::ASCII_OUT_CONTROL, flag);
        }
    }

    /// Compares a word that only PMAC writes with what PMAC wrote last.
    pub fn pmacs_word(&mut self, offset: u16, cycle: u64, dpram: &mut Dpram) {
        let (found, own) = (dpram.read16(offset), dpram.shadow(offset));
        if found != own {
            self.record(
                cycle,
                &format!("the host wrote 0x{found:04X} to 0x{offset:04X}, which is PMAC's (was 0x{own:04X})"),
            );
            dpram.adopt(offset, found);
        }
    }

    /// As [`Judge::pmacs_word`], for a word that the host may set to 0 and nothing else.
    pub fn may_only_clear(&mut self, offset: u16, rule: &str, cycle: u64, dpram: &mut Dpram) {
        let found = dpram.read16(offset);
        if found != dpram.shadow(offset) {
            if found != 0 {
                self.record(cycle, &format!("the host wrote 0x{found:04X} to 0x{offset:04X}: {rule}"));
            }
            dpram.adopt(offset, found);
        }
    }
}
