//! The slot ring: one writer, any number of readers, no waiting on either side.
//!
//! Generic over the memory, so that the protocol also runs under a model checker (`tests/it/segment_loom.rs`). There it
//! copies a slot word by word; shared memory on x86-64 copies vectors (`segment/wide_copy.rs` explains why that is
//! equivalent). The order of the accesses is that of [`super::layout`], "Head and slots".
//!
//! Why a reader's copy is whole: suppose a word of it belongs to a later sample in the same slot. The acquire fence
//! after the copy pairs with the writer's release fence before that word, so the load of the sequence after the copy
//! sees the later sample's odd number. Why the copy is not too old: the head's release store follows the slot's last
//! word, and the fence after the head's load pairs with it. So the reader need not load the sequence before the copy,
//! too.

/// Memory as a reader sees it: an array of 64-bit words that another process writes.
pub trait Words {
    /// Relaxed load of the word at `index`.
    fn load(&self, index: usize) -> u64;

    /// An acquire fence.
    fn fence_acquire(&self);

    /// Relaxed loads from `index` on, until `copy` is full.
    #[inline]
    fn load_all(&self, index: usize, copy: &mut [u64]) {
        for (offset, word) in copy.iter_mut().enumerate() {
            *word = self.load(index + offset);
        }
    }
}

/// Memory as its only writer sees it.
pub trait WordsMut: Words {
    /// Relaxed store of the word at `index`.
    fn store(&self, index: usize, value: u64);

    /// Release store of the word at `index`.
    fn store_release(&self, index: usize, value: u64);

    /// A release fence.
    fn fence_release(&self);

    /// Relaxed stores of `values` from `index` on.
    #[inline]
    fn store_all(&self, index: usize, values: &[u64]) {
        for (offset, value) in values.iter().enumerate() {
            self.store(index + offset, *value);
        }
    }
}

/// Where a ring lies in its memory. All positions and lengths are in words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ring {
    /// Index of the head word.
    pub head: usize,
    /// Index of the first slot.
    pub slots: usize,
    /// Number of slots, a power of two and at least 2.
    pub count: usize,
    /// Words from slot to slot, more than `body`.
    pub stride: usize,
    /// Words of a slot that follow its sequence: stamp and payload.
    pub body: usize,
}

/// The result of an attempt to read one sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Attempt {
    /// The copy is whole.
    Whole,
    /// The sample is not published yet.
    NotYet,
    /// The sample was overwritten; the copy is worthless.
    Lost,
}

/// The result of reading the latest sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Latest {
    /// Nothing is published yet.
    Empty,
    /// The copy is whole.
    Whole {
        /// The sample's number.
        sequence: u64,
        /// Failed attempts before this one, each overtaken by the writer.
        retries: u32,
    },
    /// The writer overtook every attempt.
    Overrun,
}

impl Ring {
    /// Writes sample `sequence` (from 1 on, ascending without gaps) and makes it the latest. Ignores words of `body`
    /// beyond the slot's end.
    #[inline]
    pub fn write<M: WordsMut>(&self, memory: &M, sequence: u64, body: &[u64]) {
        let slot = self.slot(sequence);
        let mark = sequence.wrapping_mul(2);
        memory.store(slot, mark.wrapping_sub(1));
        memory.fence_release();
        memory.store_all(slot + 1, &body[..body.len().min(self.body)]);
        memory.store_release(slot, mark);
        memory.store_release(self.head, sequence);
    }

    /// Brings `to`, which has this ring's earlier samples and no reader yet, up to `from`. Only this thread may write
    /// `from`. If another thread writes `from`, that thread must call this again: the second call copies torn slots
    /// anew.
    pub fn carry_over<F: Words, T: WordsMut>(&self, from: &F, to: &T) {
        let (has, head) = (to.load(self.head), self.published(from));
        for sequence in self.oldest(head).max(has + 1)..=head {
            let slot = self.slot(sequence);
            (slot..slot + self.stride).for_each(|index| to.store(index, from.load(index)));
        }
        to.store(self.head, head);
    }

    /// Number of samples published, which is also the number of the latest. After this load the reader may read them.
    #[inline]
    pub fn published<M: Words>(&self, memory: &M) -> u64 {
        let head = memory.load(self.head);
        memory.fence_acquire();
        head
    }

    /// Copies the slot of sample `sequence`, its sequence number first, to `slot`, until `slot` is full or the slot
    /// ends.
    #[inline]
    pub fn read<M: Words>(&self, memory: &M, sequence: u64, slot: &mut [u64]) -> Attempt {
        let head = self.published(memory);
        if sequence > head {
            return Attempt::NotYet;
        }
        self.read_published(memory, sequence, head, slot)
    }

    /// As [`Ring::read`], for a sample published according to an earlier [`Ring::published`], `head`: a reader that
    /// reads many samples need not load the head for each.
    #[inline]
    pub fn read_published<M: Words>(
        &self,
        memory: &M,
        sequence: u64,
        head: u64,
        slot: &mut [u64],
    ) -> Attempt {
        if sequence >= self.oldest(head) && self.copy(memory, sequence, slot) {
            Attempt::Whole
        } else {
            Attempt::Lost
        }
    }

    /// Copies the latest sample's slot to `slot`, with at most `attempts` attempts (at least one) when the writer
    /// overwrites it during the copy.
    #[inline]
    pub fn latest<M: Words>(&self, memory: &M, slot: &mut [u64], attempts: u32) -> Latest {
        let mut retries = 0;
        loop {
            match self.latest_at_once(memory, slot) {
                Latest::Overrun if retries + 1 < attempts => retries += 1,
                Latest::Whole { sequence, .. } => return Latest::Whole { sequence, retries },
                other => return other,
            }
        }
    }

    /// As [`Ring::latest`] with one attempt, which is nearly always enough.
    #[inline(always)]
    pub fn latest_at_once<M: Words>(&self, memory: &M, slot: &mut [u64]) -> Latest {
        match self.published(memory) {
            0 => Latest::Empty,
            sequence if self.copy(memory, sequence, slot) => Latest::Whole { sequence, retries: 0 },
            _ => Latest::Overrun,
        }
    }

    /// The oldest sample the ring can hold when `head` is the latest.
    #[inline]
    #[must_use]
    pub fn oldest(&self, head: u64) -> u64 {
        head.saturating_sub(self.count as u64 - 1).max(1)
    }

    /// Where an overrun reader continues: half a ring behind, so that the writer does not overtake it again at once.
    #[inline]
    #[must_use]
    pub fn resume(&self, head: u64) -> u64 {
        head.saturating_sub(self.count as u64 / 2).max(1)
    }

    /// Copies the unused sequence number, too, so that the copy consists of whole, aligned cache lines.
    #[inline(always)]
    fn copy<M: Words>(&self, memory: &M, sequence: u64, slot: &mut [u64]) -> bool {
        let from = self.slot(sequence);
        let length = slot.len().min(self.stride);
        memory.load_all(from, &mut slot[..length]);
        memory.fence_acquire();
        memory.load(from) == sequence.wrapping_mul(2)
    }

    #[inline]
    fn slot(&self, sequence: u64) -> usize {
        self.slots + (sequence.wrapping_sub(1) as usize & (self.count - 1)) * self.stride
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU64, Ordering, fence};

    use super::*;

    const RING: Ring = Ring { head: 0, slots: 1, count: 4, stride: 3, body: 2 };

    struct Memory(Vec<AtomicU64>);

    impl Words for Memory {
        fn load(&self, index: usize) -> u64 {
            self.0[index].load(Ordering::Relaxed)
        }

        fn fence_acquire(&self) {
            fence(Ordering::Acquire);
        }
    }

    impl WordsMut for Memory {
        fn store(&self, index: usize, value: u64) {
            self.0[index].store(value, Ordering::Relaxed);
        }

        fn store_release(&self, index: usize, value: u64) {
            self.0[index].store(value, Ordering::Release);
        }

        fn fence_release(&self) {
            fence(Ordering::Release);
        }
    }

    fn memory() -> Memory {
        Memory((0..13).map(|_| AtomicU64::new(0)).collect())
    }

    /// After whichever store the writer dies: the ring holds the last sample that the writer finished, and not the
    /// unfinished one; the sample that the writer was overwriting is gone at once.
    #[test]
    fn a_writer_that_dies_in_mid_write_leaves_the_last_sample() {
        let (memory, mut copy) = (memory(), [0; 3]);
        for sequence in 1..=6 {
            RING.write(&memory, sequence, &[sequence, sequence]);
        }
        let slot = 1 + 2 * 3;
        for (index, value) in [(slot, 13), (slot + 1, 7), (slot + 2, 7), (slot, 14)] {
            memory.store(index, value);
            assert_eq!(RING.latest(&memory, &mut copy, 1), Latest::Whole { sequence: 6, retries: 0 });
            assert_eq!(copy[1..], [6, 6]);
            assert_eq!(RING.read(&memory, 7, &mut copy), Attempt::NotYet);
            assert_eq!(RING.read(&memory, 3, &mut copy), Attempt::Lost);
            assert_eq!(RING.read(&memory, 4, &mut copy), Attempt::Whole);
            assert_eq!(copy[1..], [4, 4]);
        }
    }

    #[test]
    fn numbers_begin_at_one_and_the_ring_holds_as_many_as_it_has_slots() {
        let (memory, mut copy) = (memory(), [0; 3]);
        assert_eq!(RING.latest(&memory, &mut copy, 3), Latest::Empty);
        assert_eq!(RING.read(&memory, 1, &mut copy), Attempt::NotYet);
        assert_eq!(RING.read(&memory, 0, &mut copy), Attempt::Lost);
        for sequence in 1..=9 {
            RING.write(&memory, sequence, &[sequence, 0]);
            for wanted in 1..=sequence {
                let expected = if wanted + 4 > sequence { Attempt::Whole } else { Attempt::Lost };
                assert_eq!(RING.read(&memory, wanted, &mut copy), expected, "{wanted} of {sequence}");
            }
        }
        assert_eq!((RING.oldest(9), RING.oldest(2), RING.resume(9), RING.resume(0)), (6, 1, 7, 1));
    }

    #[test]
    fn a_reader_the_writer_always_overtakes_gives_up() {
        let (memory, mut copy) = (memory(), [0; 3]);
        RING.write(&memory, 1, &[1, 1]);
        memory.store(1, 9);
        assert_eq!(RING.latest(&memory, &mut copy, 5), Latest::Overrun);
    }
}
