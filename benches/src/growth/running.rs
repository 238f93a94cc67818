//! Loads at work, as processes of their own: told when measuring begins, ended, counted.

use std::sync::atomic::Ordering;

use crate::clock::{Figures, Series};
use crate::process::{Child, Shared};

/// Durations that are kept of one process; later ones overwrite earlier ones.
const KEPT: usize = 1 << 13;
/// Words of a process: done, lost, durations told of, and the durations in ns.
const DONE: usize = 0;
const LOST: usize = 1;
const TIMED: usize = 2;
const DURATIONS: usize = 8;
const WORDS: usize = DURATIONS + KEPT;

/// What a load did while it was measured.
pub struct Outcome {
    pub done: u64,
    pub lost: u64,
    pub took: Figures,
}

/// A load at work.
pub struct Running {
    /// 0: warming up, 1: measured, 2: to end.
    phase: Shared,
    notes: Shared,
    processes: usize,
    children: Vec<Child>,
}

impl Running {
    /// Room for the notes of `processes` processes, none of which runs yet.
    pub fn new(processes: usize) -> Self {
        Self {
            phase: Shared::cells(1),
            notes: Shared::words(processes.max(1) * WORDS),
            processes,
            children: Vec::new(),
        }
    }

    /// Starts the next process.
    pub fn spawn(&mut self, work: impl FnOnce(&Notes<'_>)) {
        let number = self.children.len();
        assert!(number < self.processes);
        let notes = Notes { running: self, first: number * WORDS };
        let child = Child::run(|| work(&notes));
        self.children.push(child);
    }

    pub fn begin(&self) {
        self.phase.set(0, 1);
    }

    pub fn end(self) -> Outcome {
        self.phase.set(0, 2);
        self.children.into_iter().for_each(Child::join);
        let word =
            |process: usize, word: usize| self.notes.word(process * WORDS + word).load(Ordering::Relaxed);
        let sum = |index: usize| (0..self.processes).map(|process| word(process, index)).sum();
        let took = (0..self.processes).flat_map(|process| {
            let kept = (word(process, TIMED) as usize).min(KEPT);
            (0..kept).map(move |index| word(process, DURATIONS + index) as f64)
        });
        Outcome { done: sum(DONE), lost: sum(LOST), took: Series::from_ns(took).figures() }
    }
}

/// Where a process of a load says what it did.
pub struct Notes<'a> {
    running: &'a Running,
    first: usize,
}

impl Notes<'_> {
    /// Whether to go on.
    pub fn goes_on(&self) -> bool {
        self.running.phase.value(0) < 2
    }

    /// One more was done; counts while it is measured. May be called by several threads.
    pub fn did(&self) {
        self.add(DONE, 1);
    }

    /// As many were lost.
    pub fn lost(&self, count: u64) {
        self.add(LOST, count);
    }

    /// One more was done, and took so long. By one thread only.
    pub fn took(&self, ns: u64) {
        self.did();
        let timed = self.running.notes.word(self.first + TIMED).load(Ordering::Relaxed) as usize;
        let place = self.first + DURATIONS + timed % KEPT;
        self.running.notes.word(place).store(ns, Ordering::Relaxed);
        self.add(TIMED, 1);
    }

    fn add(&self, word: usize, amount: u64) {
        if self.running.phase.value(0) == 1 {
            self.running.notes.word(self.first + word).fetch_add(amount, Ordering::Relaxed);
        }
    }
}
