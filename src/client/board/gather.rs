//! Gathered samples, as the daemon publishes them while it follows a gather: the segment's gather region
//! ([`crate::segment::payload::gather`]).

use super::{Board, ClientError};
pub use crate::segment::payload::gather::{GatherChunk, GatherPhase};
use crate::segment::{Cursor, RegionId, Sample, SegmentError};

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
    /// [`ClientError::Segment`], also when the daemon was restarted.
    pub fn next(&mut self, board: &Board) -> Result<Option<GatherChunk>, ClientError> {
        if !board.subscriber().next(&mut self.cursor, &mut self.sample)? {
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
