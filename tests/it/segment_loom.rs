//! The slot ring under a model checker: every interleaving and every value the memory model allows, for a ring of two slots, a
//! writer that goes one and a half times round, and a reader in its way.
//!
//! What runs here is `segment::ring`: the order of loads, stores and fences, and who believes what. What does not run here is the memory
//! below it. The model's words are loom's atomics, and the words of a slot are copied one by one, ascending or descending.
//! Shared memory uses Rust's atomics instead, and on x86-64 copies the words of a slot by vector moves (`segment/wide_copy.rs`, which has
//! an argument and tests of its own). A cell of the model may stand for a word or for a byte: the ring needs no two of them
//! to be copied together, but for head and sequence, which are single atomic words in both worlds.
//!
//! Each ordering of the protocol is then taken away in turn. Where that makes no difference, it says why.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};

use loom::sync::Arc;
use loom::sync::atomic::{AtomicU64, Ordering, fence};
use pmac_dpram::segment::ring::{Attempt, Latest, Ring, Words, WordsMut};

/// Head, then two slots of a sequence and two words that must always be equal.
const RING: Ring = Ring { head: 0, slots: 1, count: 2, stride: 3, body: 2 };
const WORDS: usize = 7;
const SAMPLES: u64 = 3;

/// What is taken away from the protocol.
#[derive(Clone, Copy, Default)]
struct Weakened {
    writer_fence: bool,
    slot_release: bool,
    head_release: bool,
    /// Of the reader's two fences (after the head, after the copy), which.
    reader_fences: [bool; 2],
    /// The words of a slot are copied from the last to the first. Not weaker: the order must not matter.
    descending: bool,
}

struct Memory {
    words: Vec<AtomicU64>,
}

/// One thread's way of using the memory.
struct View {
    memory: Arc<Memory>,
    weakened: Weakened,
    fences: Cell<usize>,
}

impl View {
    fn new(memory: &Arc<Memory>, weakened: Weakened) -> Self {
        Self { memory: Arc::clone(memory), weakened, fences: Cell::new(0) }
    }

    fn order(&self, words: usize) -> impl Iterator<Item = usize> {
        let descending = self.weakened.descending;
        (0..words).map(move |offset| if descending { words - 1 - offset } else { offset })
    }
}

impl Words for View {
    fn load(&self, index: usize) -> u64 {
        self.memory.words[index].load(Ordering::Relaxed)
    }

    fn fence_acquire(&self) {
        let number = self.fences.replace(self.fences.get() + 1);
        if !self.weakened.reader_fences[number] {
            fence(Ordering::Acquire);
        }
    }

    fn load_all(&self, index: usize, copy: &mut [u64]) {
        for offset in self.order(copy.len()) {
            copy[offset] = self.load(index + offset);
        }
    }
}

impl WordsMut for View {
    fn store(&self, index: usize, value: u64) {
        self.memory.words[index].store(value, Ordering::Relaxed);
    }

    fn store_release(&self, index: usize, value: u64) {
        let weak = if index == RING.head { self.weakened.head_release } else { self.weakened.slot_release };
        self.memory.words[index].store(value, if weak { Ordering::Relaxed } else { Ordering::Release });
    }

    fn fence_release(&self) {
        if !self.weakened.writer_fence {
            fence(Ordering::Release);
        }
    }

    fn store_all(&self, index: usize, values: &[u64]) {
        for offset in self.order(values.len()) {
            self.store(index + offset, values[offset]);
        }
    }
}

fn with_writer(weakened: Weakened, read: impl Fn(&View) + Sync + Send + 'static) {
    loom::model(move || {
        let memory = Arc::new(Memory { words: (0..WORDS).map(|_| AtomicU64::new(0)).collect() });
        let writer = View::new(&memory, weakened);
        let thread = loom::thread::spawn(move || {
            for sequence in 1..=SAMPLES {
                RING.write(&writer, sequence, &[sequence, sequence]);
            }
        });
        read(&View::new(&memory, weakened));
        thread.join().unwrap();
    });
}

/// A sample may only be called lost if the writer did begin a later one in its slot.
fn assert_overwritten(view: &View, sequence: u64) {
    let slot = RING.slots + ((sequence - 1) % 2) as usize * RING.stride;
    let is_so = view.load(slot) > 2 * sequence || view.load(RING.head) >= sequence + 2;
    assert!(is_so, "sample {sequence} was published and is not visible");
}

fn assert_whole(copy: [u64; 3], sequence: u64) {
    assert_eq!(copy, [2 * sequence, sequence, sequence], "the copy of sample {sequence} is mixed");
}

fn latest(weakened: Weakened) {
    with_writer(weakened, |view| {
        let mut copy = [0; 3];
        match RING.latest(view, &mut copy, 1) {
            Latest::Empty => {}
            Latest::Whole { sequence, .. } => assert_whole(copy, sequence),
            Latest::Overrun => {
                // With one attempt, the sample it tried is any of those the ring has gone past: sample 1.
                assert_overwritten(view, 1);
            }
        }
    });
}

fn history(weakened: Weakened) {
    with_writer(weakened, |view| {
        let mut copy = [0; 3];
        match RING.read(view, 1, &mut copy) {
            Attempt::NotYet => {}
            Attempt::Whole => assert_whole(copy, 1),
            Attempt::Lost => assert_overwritten(view, 1),
        }
    });
}

/// What a model finds wrong.
fn fault(model: fn(Weakened), weakened: Weakened) -> String {
    let panic = catch_unwind(AssertUnwindSafe(|| model(weakened))).expect_err("the model must find a fault");
    match panic.downcast::<String>() {
        Ok(message) => *message,
        Err(panic) => panic.downcast::<&str>().map_or_else(|_| String::new(), |text| (*text).to_owned()),
    }
}

/// Both models find one of these faults.
fn assert_found(weakened: Weakened, what: &[&str]) {
    for model in [latest, history] {
        let found = fault(model, weakened);
        let expected = what.iter().any(|what| found.contains(what));
        assert!(expected, "expected a fault of the kind {what:?}, found {found:?}");
    }
}

/// What a copy that is older than the head is found by.
const OLD: &[&str] = &["mixed", "not visible"];

#[test]
fn every_copy_is_whole_and_nothing_published_is_invisible() {
    for descending in [false, true] {
        let order = Weakened { descending, ..Weakened::default() };
        latest(order);
        history(order);
    }
}

#[test]
fn without_the_writers_fence_copies_are_mixed() {
    let weakened = Weakened { writer_fence: true, ..Weakened::default() };
    assert_found(weakened, &["mixed"]);
}

#[test]
fn without_the_readers_fence_after_the_copy_copies_are_mixed() {
    let weakened = Weakened { reader_fences: [false, true], ..Weakened::default() };
    assert_found(weakened, &["mixed"]);
}

#[test]
fn with_a_relaxed_head_a_published_sample_is_not_seen_whole() {
    let weakened = Weakened { head_release: true, ..Weakened::default() };
    assert_found(weakened, OLD);
}

#[test]
fn without_the_readers_fence_after_the_head_a_published_sample_is_not_seen_whole() {
    let weakened = Weakened { reader_fences: [true, false], ..Weakened::default() };
    assert_found(weakened, OLD);
}

/// Behind the head, its release store and the fence after its load already cover the slot. Kept all the same, for readers that
/// look at a slot without coming through the head.
#[test]
fn the_slots_own_release_is_redundant_behind_the_head() {
    let weakened = Weakened { slot_release: true, ..Weakened::default() };
    latest(weakened);
    history(weakened);
}
