//! One sample of a region, in private memory.

use super::layout::{FLAG_VALID, STAMP_WORDS};
use super::memory::{self, Lines};

/// When and under what conditions a sample was taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stamp {
    /// When the first device read that went into the sample was made, in ns of the segment's clock.
    pub time_ns: u64,
    /// The board's servo timer (15 to 24 bits of its own), extended to 64 bit; counts servo cycles.
    pub servo_timer: u64,
    /// The sample is what the board held, read whole.
    pub valid: bool,
}

/// A sample copied out of the segment. Keep one and read into it again and again: it allocates only the first time.
///
/// Holds a verbatim copy of the slot; the accessors read their fields from it when they are called.
#[derive(Clone, Debug, Default)]
pub struct Sample {
    retries: u32,
    /// Twice the number, stamp, payload; a number of 0 and no bytes when there is no sample in it.
    slot: Lines,
}

impl Sample {
    /// An empty sample.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// The sample's number in its region, from 1 on; 0 before the first read, and after one that brought none.
    #[must_use]
    #[inline]
    pub fn sequence(&self) -> u64 {
        self.slot.words().first().map_or(0, |mark| mark / 2)
    }

    /// When it was taken.
    #[must_use]
    #[inline]
    pub fn stamp(&self) -> Stamp {
        match self.slot.words() {
            [_, time_ns, servo_timer, flags_length, ..] => {
                Stamp { time_ns: *time_ns, servo_timer: *servo_timer, valid: flags_length & FLAG_VALID != 0 }
            }
            _ => Stamp::default(),
        }
    }

    /// Attempts the writer overtook before this copy was whole.
    #[must_use]
    #[inline]
    pub fn retries(&self) -> u32 {
        self.retries
    }

    /// The payload as the board's 16-bit words, ascending by host offset.
    #[must_use]
    pub fn words(&self) -> &[u16] {
        memory::halves(self.payload()).get(..self.length() / 2).unwrap_or(&[])
    }

    /// The payload as bytes.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        memory::bytes(self.payload()).get(..self.length()).unwrap_or(&[])
    }

    fn payload(&self) -> &[u64] {
        self.slot.words().get(1 + STAMP_WORDS..).unwrap_or(&[])
    }

    /// Bytes of payload, as the slot has it.
    #[inline(always)]
    fn length(&self) -> usize {
        self.slot.words().get(STAMP_WORDS).map_or(0, |flags_length| (flags_length >> 32) as usize)
    }

    /// As [`Sample::room`], but `None` when it would have to allocate.
    #[inline(always)]
    pub(super) fn has_room(&mut self, lines: usize) -> Option<&mut [u64]> {
        self.slot.has_room(lines)
    }

    /// Room for a slot of so many cache lines, for a ring to fill. Until [`Sample::accept`] it holds no sample.
    #[inline(always)]
    pub(super) fn room(&mut self, lines: usize) -> &mut [u64] {
        self.slot.room(lines)
    }

    /// Takes what was filled in as sample `sequence`; `false` when its number is another, or its length impossible.
    #[inline(always)]
    pub(super) fn accept(&mut self, sequence: u64, retries: u32, payload_bytes: usize) -> bool {
        self.retries = retries;
        self.sequence() == sequence && self.length() <= payload_bytes
    }

    /// Makes it an empty sample.
    pub(super) fn clear(&mut self) {
        self.retries = 0;
        // Number, stamp and length are all in it.
        self.slot.clear_first();
    }
}

impl Stamp {
    /// The three words of a slot between its sequence and its payload.
    pub(super) fn words(self, length: usize) -> [u64; STAMP_WORDS] {
        let flags = if self.valid { FLAG_VALID } else { 0 };
        [self.time_ns, self.servo_timer, (length as u64) << 32 | flags]
    }
}
