//! Gathered samples, which the daemon publishes while it follows a gather: the segment's gather region
//! ([`crate::segment::payload::gather`]).

use super::{Board, ClientError};
use crate::gather::{Column, column};
pub use crate::segment::payload::gather::{GatherChunk, GatherPhase};
use crate::segment::{Cursor, RegionId, Sample, SegmentError};

/// Follows the gather region.
#[derive(Debug)]
pub struct GatherFollower {
    cursor: Cursor,
    sample: Sample,
}

impl GatherFollower {
    /// The next samples; `None` if there are none yet.
    ///
    /// # Errors
    /// [`ClientError::Segment`], also after a restart of the daemon.
    pub fn next(&mut self, board: &mut Board) -> Result<Option<GatherChunk>, ClientError> {
        board.refresh()?;
        if !board.subscriber().next(&mut self.cursor, &mut self.sample)? {
            return Ok(None);
        }
        let corrupt = SegmentError::Corrupt { region: RegionId::Gather, sequence: self.sample.sequence() };
        GatherChunk::decode(self.sample.words()).map(Some).ok_or(corrupt.into())
    }
}

/// The result of [`GatherRun::take`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Taken {
    /// Nothing yet.
    Nothing,
    /// Samples, or the end.
    Some,
    /// The samples belong to another gather, begun meanwhile.
    Another,
}

/// The samples of one gather in turn, decoded.
#[derive(Debug)]
pub struct GatherRun {
    follower: GatherFollower,
    columns: Vec<Column>,
    /// The daemon's number of this gather.
    gather: Option<u32>,
    next: u64,
    ended: Option<GatherPhase>,
}

impl GatherRun {
    /// The next gather that `follower` meets, with `columns` in each sample. Call this before the gather begins.
    #[must_use]
    pub const fn new(follower: GatherFollower, columns: Vec<Column>) -> Self {
        Self { follower, columns, gather: None, next: 0, ended: None }
    }

    /// The number of the next sample, from 0. The run has taken or lost all earlier samples.
    #[must_use]
    pub const fn next(&self) -> u64 {
        self.next
    }

    /// How the gather has ended, if it has.
    #[must_use]
    pub const fn ended(&self) -> Option<GatherPhase> {
        self.ended
    }

    /// Takes the next samples before number `wanted`; `row` gets each with its number.
    ///
    /// # Errors
    /// [`ClientError`] of the segment, or the error of `row`.
    pub fn take<E: From<ClientError>>(
        &mut self,
        board: &mut Board,
        wanted: Option<u64>,
        mut row: impl FnMut(u64, &[f64]) -> Result<(), E>,
    ) -> Result<Taken, E> {
        let Some(chunk) = self.follower.next(board)? else { return Ok(Taken::Nothing) };
        if self.gather.is_none() && chunk.phase != GatherPhase::Running && chunk.first > 0 {
            // The end of the previous gather.
            return Ok(Taken::Some);
        }
        if *self.gather.get_or_insert(chunk.gather) != chunk.gather {
            return Ok(Taken::Another);
        }
        let mut values = Vec::with_capacity(self.columns.len());
        let mut number = chunk.first;
        for sample in chunk.longs.chunks_exact(chunk.sample_longs) {
            if wanted.is_none_or(|wanted| number < wanted) {
                values.clear();
                column::decode(&self.columns, sample, &mut values);
                row(number, &values)?;
            }
            number += 1;
        }
        self.next = wanted.map_or(number, |wanted| number.min(wanted)).max(self.next);
        if chunk.phase != GatherPhase::Running {
            self.ended = Some(chunk.phase);
        }
        Ok(Taken::Some)
    }
}

impl Board {
    /// A follower of the gathers that the daemon publishes from now on.
    ///
    /// # Errors
    /// [`ClientError::Segment`] if this daemon publishes no gathers.
    pub fn follow_gather(&mut self) -> Result<GatherFollower, ClientError> {
        self.refresh()?;
        let next = self.subscriber().published(RegionId::Gather)?.saturating_add(1);
        let cursor = self.subscriber().cursor(RegionId::Gather, next)?;
        Ok(GatherFollower { cursor, sample: Sample::new() })
    }
}
