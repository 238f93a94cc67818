//! One sample of a region, in private memory.

use super::layout::{FLAG_VALID, STAMP_WORDS, WORD};
use super::memory::{self, Lines};

/// When and under what conditions a sample was taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stamp {
    /// CLOCK_MONOTONIC in ns of the first device read that went into the sample.
    pub time_ns: u64,
    /// The board's servo timer (15 bit at host offset 0x0026), extended to 64 bit; counts servo cycles.
    pub servo_timer: u64,
    /// The sample is what the board held, read whole.
    pub valid: bool,
}

/// A sample copied out of the segment. Keep one and read into it again and again: it allocates only the first time.
#[derive(Clone, Debug, Default)]
pub struct Sample {
    /// The sample's number in its region, from 1 on; 0 before the first read.
    pub sequence: u64,
    /// When it was taken.
    pub stamp: Stamp,
    /// Attempts the writer overtook before this copy was whole.
    pub retries: u32,
    length: usize,
    /// The slot as it was: sequence, stamp, payload.
    slot: Lines,
}

impl Sample {
    /// An empty sample.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// The payload as the board's 16-bit words, ascending by host offset.
    #[must_use]
    pub fn words(&self) -> &[u16] {
        &memory::halves(self.payload())[..self.length / 2]
    }

    /// The payload as bytes.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &memory::bytes(self.payload())[..self.length]
    }

    fn payload(&self) -> &[u64] {
        self.slot.words().get(1 + STAMP_WORDS..).unwrap_or(&[])
    }

    /// Room for a slot of `words` words, to be filled by a ring.
    #[inline(always)]
    pub(super) fn room(&mut self, words: usize) -> &mut [u64] {
        // Until `accept`, what is in here is nobody's sample.
        self.sequence = 0;
        self.length = 0;
        self.slot.room(words)
    }

    /// Makes what was filled in sample `sequence`; `false` if its length cannot be.
    #[inline(always)]
    pub(super) fn accept(&mut self, sequence: u64, retries: u32, payload_bytes: usize) -> bool {
        let [_, time_ns, servo_timer, flags_length, payload @ ..] = self.slot.words() else { return false };
        let length = (flags_length >> 32) as usize;
        if length > payload_bytes.min(payload.len() * WORD) {
            return false;
        }
        self.stamp =
            Stamp { time_ns: *time_ns, servo_timer: *servo_timer, valid: flags_length & FLAG_VALID != 0 };
        self.sequence = sequence;
        self.retries = retries;
        self.length = length;
        true
    }
}

impl Stamp {
    /// The three words of a slot between its sequence and its payload.
    pub(super) fn words(self, length: usize) -> [u64; STAMP_WORDS] {
        let flags = if self.valid { FLAG_VALID } else { 0 };
        [self.time_ns, self.servo_timer, (length as u64) << 32 | flags]
    }
}
