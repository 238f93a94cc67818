//! One sample of a region, in private memory.

use super::layout::{FLAG_VALID, STAMP_WORDS};
use super::memory::{self, Lines};

/// The time and the conditions of a sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stamp {
    /// Time of the first board read that went into the sample, in ns of the segment's clock.
    pub time_ns: u64,
    /// The board's servo timer (15 to 24 bits), extended to 64 bits; counts servo cycles.
    pub servo_timer: u64,
    /// The sample is a complete copy of the board's words.
    pub valid: bool,
}

/// A sample copied out of the segment. Reuse it for further reads: it allocates only the first time.
///
/// Holds a verbatim copy of the slot; each call of an accessor reads its field from the copy.
#[derive(Clone, Debug, Default)]
pub struct Sample {
    retries: u32,
    /// Twice the number, stamp, payload; all zero or empty when it holds no sample.
    slot: Lines,
}

impl Sample {
    /// An empty sample.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// The sample's number in its region, from 1 on; 0 before the first read and after a failed one.
    #[must_use]
    #[inline]
    pub fn sequence(&self) -> u64 {
        self.slot.words().first().map_or(0, |mark| mark / 2)
    }

    /// The sample's time and conditions.
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

    /// Failed attempts before this copy, each overtaken by the writer.
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

    /// Payload length in bytes, according to the slot.
    #[inline(always)]
    fn length(&self) -> usize {
        self.slot.words().get(STAMP_WORDS).map_or(0, |flags_length| (flags_length >> 32) as usize)
    }

    /// As [`Sample::room`], but `None` when it would have to allocate.
    #[inline(always)]
    pub(super) fn has_room(&mut self, lines: usize) -> Option<&mut [u64]> {
        self.slot.has_room(lines)
    }

    /// Room for a slot of `lines` cache lines, for a ring to fill. Holds no sample until [`Sample::accept`].
    #[inline(always)]
    pub(super) fn room(&mut self, lines: usize) -> &mut [u64] {
        self.slot.room(lines)
    }

    /// Accepts the slot filled in as sample `sequence`; `false` when it has another number or an impossible length.
    #[inline(always)]
    pub(super) fn accept(&mut self, sequence: u64, retries: u32, payload_bytes: usize) -> bool {
        self.retries = retries;
        self.sequence() == sequence && self.length() <= payload_bytes
    }

    /// Empties the sample.
    pub(super) fn clear(&mut self) {
        self.retries = 0;
        // The first line holds number, stamp and length.
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
