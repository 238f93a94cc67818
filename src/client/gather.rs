//! Gathered samples, as the daemon publishes them while it follows a gather: the segment's gather region.
//!
//! The payload is described in `crate::mirror::gather`. Numbers of samples make every loss exact: what is missing
//! between two payloads was overwritten by the board before the daemon read it, or in the segment before this reader did.

use serde_json::{Value, json};

use super::board::{Board, ClientError};
use super::command::{CommandError, Connection, DAEMON_TIMEOUT, MARGIN};
use crate::format::join32;
use crate::gather::{GatherMode, GatherPlan};
use crate::map::Layout;
use crate::segment::{Cursor, RegionId, Sample, SegmentError};

/// 16-bit words before the samples.
const HEADER_WORDS: usize = 16;

/// How a gather goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GatherPhase {
    /// More follows.
    GoesOn,
    /// It has ended; nothing follows.
    Ended,
    /// Somebody defined the buffer anew, or the board was reset.
    Redefined,
    /// It paused, for how many samples cannot be known.
    Interrupted,
}

/// Some samples in a row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GatherChunk {
    /// Another number when it is another gather.
    pub gather: u32,
    /// How it goes on.
    pub phase: GatherPhase,
    /// The number of the first sample, or, when there is none, of the one that would come next.
    pub first: u64,
    /// Samples that the daemon has lost since the gather began.
    pub lost: u64,
    /// Longs of a sample.
    pub sample_longs: usize,
    /// The longs of the samples.
    pub longs: Vec<u32>,
}

impl GatherChunk {
    /// Reads a payload; `None` when it contradicts itself.
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
            0 => GatherPhase::GoesOn,
            1 => GatherPhase::Ended,
            2 => GatherPhase::Redefined,
            _ => GatherPhase::Interrupted,
        };
        Some(Self { gather: long(0), phase, first: wide(8), lost: wide(12), sample_longs, longs })
    }
}

/// Follows the gather region.
#[derive(Debug)]
pub struct GatherFollower {
    cursor: Cursor,
    sample: Sample,
}

impl GatherFollower {
    /// The next samples, or `None` when there are none yet.
    ///
    /// # Errors
    /// [`ClientError::Segment`], also when the daemon was started anew.
    pub fn next(&mut self, board: &Board) -> Result<Option<GatherChunk>, ClientError> {
        if !self.cursor.next(board.subscriber(), &mut self.sample)? {
            return Ok(None);
        }
        let corrupt = SegmentError::Corrupt { region: RegionId::Gather, sequence: self.sample.sequence() };
        GatherChunk::decode(self.sample.words()).map(Some).ok_or(corrupt.into())
    }
}

impl Board {
    /// A follower of what the daemon publishes of gathers from now on.
    ///
    /// # Errors
    /// [`ClientError::Segment`] when this daemon publishes none.
    pub fn follow_gather(&self) -> Result<GatherFollower, ClientError> {
        let next = self.subscriber().published(RegionId::Gather)?.saturating_add(1);
        let cursor = self.subscriber().cursor(RegionId::Gather, next)?;
        Ok(GatherFollower { cursor, sample: Sample::new() })
    }
}

impl Connection {
    /// Has the daemon follow the buffer that `plan` has defined on a board with `layout`. Between `DEFINE GATHER` and
    /// `GATHER`. With the servo period, the host's clock counts the board's turns in its buffer; without, the servo report.
    ///
    /// # Errors
    /// [`CommandError`]; refused when the buffer is another one, or overlaps the daemon's other buffers.
    pub fn gather_begin(
        &mut self,
        plan: &GatherPlan,
        layout: &Layout,
        servo_period_ns: Option<u64>,
    ) -> Result<(), CommandError> {
        let place = layout.gather();
        let parameters = json!({
            "buffer": place.buffer.bytes(),
            "size_word": place.size.bytes(),
            "index_word": place.index.bytes(),
            "size_longs": plan.buffer_longs,
            "sample_longs": plan.sample_longs,
            "period": plan.period,
            "wrap": plan.mode == GatherMode::Wrap,
            "servo_period_ns": servo_period_ns,
        });
        self.call::<Value>("GatherBegin", parameters, DAEMON_TIMEOUT + MARGIN).map(|_| ())
    }

    /// Tells the daemon that the board gathers no more.
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn gather_end(&mut self) -> Result<(), CommandError> {
        self.call::<Value>("GatherEnd", Value::Null, DAEMON_TIMEOUT + MARGIN).map(|_| ())
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
        assert_eq!((chunk.gather, chunk.phase, chunk.sample_longs), (3, GatherPhase::GoesOn, 2));
        assert_eq!((chunk.first, chunk.lost), (1 << 32 | 7, 9));
        assert_eq!(chunk.longs, [1, 2, u32::MAX, 1 << 16 | 4]);
        assert_eq!(GatherChunk::decode(&words[..22]), None);
        assert_eq!(GatherChunk::decode(&words[..15]), None);
    }
}
