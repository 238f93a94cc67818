//! What a segment says of itself, its owner and its regions.

use super::layout::{ClockKind, RegionId, RegionState, State};
use super::payload::blocks::BlockPlace;
use crate::map::Selection;

/// How a segment stands, everything considered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Condition {
    /// The daemon is starting; no data yet.
    Init,
    /// The daemon runs and the board answers.
    Live,
    /// The board does not answer, or the daemon is stopped or hangs: what is there is old.
    Stale,
    /// The daemon stopped in good order: attach again.
    Dead,
    /// The daemon was killed: attach again.
    OwnerGone,
    /// The name leads to a newer segment: attach again.
    Replaced,
}

impl Condition {
    /// Whether only attaching again can bring new data.
    #[must_use]
    pub fn is_over(self) -> bool {
        matches!(self, Self::Dead | Self::OwnerGone | Self::Replaced)
    }
}

/// What a segment says about one of its regions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RegionInfo {
    /// What it mirrors.
    pub id: RegionId,
    /// Number of slots.
    pub slots: u64,
    /// Longest payload in bytes.
    pub payload_bytes: usize,
    /// Host byte offset of the payload's first word in the DPRAM.
    pub first_host_offset: u32,
    /// Whether it is mirrored and its updates come in time.
    pub state: RegionState,
    /// How often to expect a sample, in ns; 0 where there is no period.
    pub period_ns: u64,
    /// How old the latest sample may grow before it counts as stale, in ns; 0: never.
    pub stale_after_ns: u64,
    /// Number of samples published.
    pub published: u64,
    /// Where the blocks of its numbers lie in the payload.
    pub blocks: BlockPlace,
    /// What of each number's block, and which numbers, are read from the board at all.
    pub selection: Selection,
}

/// What a segment says about itself and its owner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HeaderInfo {
    /// Minor version of the layout.
    pub abi_minor: u64,
    /// Size in bytes.
    pub total_length: usize,
    /// The clock of every time in it.
    pub clock: ClockKind,
    /// What the owner says; see [`super::Subscriber::condition`] for whether it can be believed.
    pub state: State,
    /// What tells this segment from its predecessors and successors.
    pub generation: u64,
    /// The owner's process.
    pub owner_pid: u64,
    /// The owner's user.
    pub owner_uid: u64,
    /// When it was made, in ns of its clock.
    pub created_ns: u64,
    /// When the owner last gave a sign of life, in ns of the segment's clock.
    pub heartbeat_ns: u64,
    /// A heartbeat older than this means that the owner is stopped or hangs, in ns; 0: never.
    pub heartbeat_limit_ns: u64,
    /// Number of signs of life.
    pub beats: u64,
    /// CLOCK_REALTIME minus the segment's clock, in ns.
    pub realtime_offset_ns: i64,
    /// When that was measured, in ns of the segment's clock.
    pub realtime_taken_ns: u64,
}
