//! The users' registers that PMAC copies in the background: the segment's variable region
//! ([`crate::segment::payload::variable`]).
//!
//! A program that wants a copy of a register keeps a [`VariableWatch`]. Every reader of the segment sees the values of
//! all watched registers.

use std::time::Duration;

use super::{Board, ClientError};
use crate::client::command::variables::VariableWatch;
use crate::client::command::{CommandError, Connection};
use crate::client::view::View;
use crate::map::VariableName;
pub use crate::segment::payload::variable::{Variable, VariableTable};
use crate::segment::{RegionId, SegmentError, WaitOutcome};

impl Board {
    /// The registers that PMAC copies for all watches, and their values; `None` before the first.
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn variables(&mut self) -> Result<Option<View<VariableTable>>, ClientError> {
        self.latest_view(RegionId::Variable, |region, words| {
            VariableTable::decode(words)
                .ok_or_else(|| SegmentError::Corrupt { region: region.id, sequence: region.published }.into())
        })
    }

    /// Sleeps until the segment has variables newer than number `after`, at most `timeout`; false without newer ones.
    ///
    /// # Errors
    /// [`ClientError::Segment`].
    pub fn wait_variables(&mut self, after: u64, timeout: Duration) -> Result<bool, ClientError> {
        self.refresh()?;
        let outcome = self.subscriber().wait_newer(RegionId::Variable, after, timeout)?;
        Ok(outcome == WaitOutcome::Newer)
    }

    /// Has PMAC copy the registers `names` in the background until the caller drops the returned watch.
    /// [`Board::variables`] has their values. The watch has a connection of its own.
    ///
    /// # Errors
    /// [`CommandError`]; the daemon refuses if none of PMAC's 128 entries is left, or I55 is not 1.
    pub fn watch_variables(&self, names: &[VariableName]) -> Result<VariableWatch, CommandError> {
        Connection::open(self.socket())?.of_board(self.name())?.watch_variables(names)
    }
}
