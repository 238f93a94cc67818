//! Gathered samples, as the daemon publishes them while it follows a gather: the segment's gather region
//! ([`crate::segment::payload::gather`]).

use super::board::{Board, ClientError};
use super::command::{CommandError, Connection, DAEMON_TIMEOUT, MARGIN};
use crate::gather::{GatherMode, GatherPlan};
use crate::map::Layout;
use crate::protocol::board::Done;
use crate::protocol::calls;
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
    /// [`ClientError::Segment`], also when the daemon was started anew.
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
        let parameters = calls::GatherBegin {
            buffer: calls::Offset(place.buffer),
            size_word: calls::Offset(place.size),
            index_word: calls::Offset(place.index),
            size_longs: plan.buffer_longs,
            sample_longs: plan.sample_longs,
            period: plan.period,
            wrap: Some(plan.mode == GatherMode::Wrap),
            servo_period_ns,
        };
        let Done {} = self.call("GatherBegin", &parameters, DAEMON_TIMEOUT + MARGIN)?;
        Ok(())
    }

    /// Tells the daemon that the board gathers no more.
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn gather_end(&mut self) -> Result<(), CommandError> {
        let Done {} = self.call("GatherEnd", &calls::NoParameters {}, DAEMON_TIMEOUT + MARGIN)?;
        Ok(())
    }
}
