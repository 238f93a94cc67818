//! The gather region: the board's gathered samples, unchanged and in order (DPRAM manual p. 25-26). `docs/segment.md`
//! has the table of its payload.

use crate::format::{join32, split32};

/// 16-bit words before the samples.
const HEADER_WORDS: usize = 16;

/// 16-bit words of a payload with `longs` longs.
#[must_use]
pub const fn payload_words(longs: usize) -> usize {
    HEADER_WORDS + 2 * longs
}

/// The state of a gather.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum GatherPhase {
    /// More samples follow.
    Running = 0,
    /// The gather has ended.
    Ended = 1,
    /// Another client redefined the buffer, or the board was reset.
    Redefined = 2,
    /// The gather paused; the number of lost samples is unknown.
    Interrupted = 3,
}

/// Consecutive samples; `Longs` is a `Vec` for reading and a slice for writing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GatherChunk<Longs = Vec<u32>> {
    /// Number of the gather; changes with each new one.
    pub gather: u32,
    /// Its state.
    pub phase: GatherPhase,
    /// The number of the first sample; in a payload without samples, the next sample's number.
    pub first: u64,
    /// Samples that the daemon has lost since the gather began.
    pub lost: u64,
    /// Longs of a sample, at least 1.
    pub sample_longs: usize,
    /// The longs of the samples.
    pub longs: Longs,
}

impl<Longs: AsRef<[u32]>> GatherChunk<Longs> {
    /// Writes the payload to `payload` and returns its length in words; 0 when it does not fit. Allocates nothing.
    pub fn encode(&self, payload: &mut [u16]) -> usize {
        let longs = self.longs.as_ref();
        let words = payload_words(longs.len());
        let Some((header, rest)) =
            payload.get_mut(..words).and_then(|payload| payload.split_first_chunk_mut::<HEADER_WORDS>())
        else {
            return 0;
        };
        let fields = [
            self.gather,
            self.phase as u32,
            self.sample_longs as u32,
            (longs.len() / self.sample_longs.max(1)) as u32,
            self.first as u32,
            (self.first >> 32) as u32,
            self.lost as u32,
            (self.lost >> 32) as u32,
        ];
        let pairs = header.as_chunks_mut::<2>().0.iter_mut().chain(rest.as_chunks_mut::<2>().0);
        for (words, long) in pairs.zip(fields.iter().chain(longs)) {
            *words = split32(*long);
        }
        words
    }
}

impl GatherChunk {
    /// Reads a payload; `None` if it contradicts itself.
    #[must_use]
    pub fn decode(words: &[u16]) -> Option<Self> {
        let (header, rest) = words.split_at_checked(HEADER_WORDS)?;
        let long = |at: usize| join32(header[at], header[at + 1]);
        let wide = |at: usize| u64::from(long(at)) | u64::from(long(at + 2)) << 32;
        let longs: Vec<u32> = rest.as_chunks::<2>().0.iter().map(|&[low, high]| join32(low, high)).collect();
        let (sample_longs, count) = (long(4) as usize, long(6) as usize);
        if sample_longs == 0 || longs.len() != count.checked_mul(sample_longs)? {
            return None;
        }
        let phase = match long(2) {
            0 => GatherPhase::Running,
            1 => GatherPhase::Ended,
            2 => GatherPhase::Redefined,
            _ => GatherPhase::Interrupted,
        };
        Some(Self { gather: long(0), phase, first: wide(8), lost: wide(12), sample_longs, longs })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_payload_is_read_as_its_page_says() {
        let mut words = vec![3, 0, 0, 0, 2, 0, 2, 0, 7, 0, 1, 0, 9, 0, 0, 0];
        words.extend([1, 0, 2, 0, 0xFFFF, 0xFFFF, 4, 1]);
        let chunk = GatherChunk::decode(&words).unwrap();
        assert_eq!((chunk.gather, chunk.phase, chunk.sample_longs), (3, GatherPhase::Running, 2));
        assert_eq!((chunk.first, chunk.lost), (1 << 32 | 7, 9));
        assert_eq!(chunk.longs, [1, 2, u32::MAX, 1 << 16 | 4]);
        assert_eq!(GatherChunk::decode(&words[..22]), None);
        assert_eq!(GatherChunk::decode(&words[..15]), None);
        let mut payload = [0xFFFF; payload_words(5)];
        assert_eq!(chunk.encode(&mut payload), words.len());
        assert_eq!(payload[..words.len()], words);
        assert_eq!(chunk.encode(&mut payload[..words.len() - 1]), 0, "no room");
    }

    #[test]
    fn every_phase_comes_back() {
        for phase in
            [GatherPhase::Running, GatherPhase::Ended, GatherPhase::Redefined, GatherPhase::Interrupted]
        {
            let end = GatherChunk { gather: 1, phase, first: 7, lost: 0, sample_longs: 1, longs: [0; 0] };
            let mut payload = [0; payload_words(0)];
            assert_eq!(end.encode(&mut payload), payload.len());
            let read = GatherChunk::decode(&payload).unwrap();
            assert_eq!((read.phase, read.first, read.longs), (phase, 7, vec![]));
        }
    }
}
