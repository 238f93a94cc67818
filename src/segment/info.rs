//! A segment's header: the segment, its owner and its regions.

use super::layout::{ClockKind, RegionId, RegionState, State};
use super::payload::blocks::BlockPlace;
use crate::map::Selection;

/// The overall condition of a segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Condition {
    /// The daemon is starting; no data yet.
    Init,
    /// The daemon runs and the board answers.
    Live,
    /// The board does not answer, or the daemon is stopped or hangs: all data are old.
    Stale,
    /// The daemon stopped in good order: attach again.
    Dead,
    /// The daemon was killed: attach again.
    OwnerGone,
    /// The name belongs to a newer segment: attach again.
    Replaced,
}

impl Condition {
    /// Whether the reader must attach again to get new data.
    #[must_use]
    pub fn is_over(self) -> bool {
        matches!(self, Self::Dead | Self::OwnerGone | Self::Replaced)
    }
}

/// One region of a segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RegionInfo {
    /// The region's kind.
    pub id: RegionId,
    /// Number of slots.
    pub slots: u64,
    /// Longest payload in bytes.
    pub payload_bytes: usize,
    /// Host byte offset of the payload's first word in the DPRAM.
    pub first_host_offset: u32,
    /// Whether it is mirrored and its updates arrive in time.
    pub state: RegionState,
    /// Expected time between samples, in ns; 0 without a period.
    pub period_ns: u64,
    /// The age at which the latest sample becomes stale, in ns; 0: never.
    pub stale_after_ns: u64,
    /// Number of samples published.
    pub published: u64,
    /// Where the payload holds the block of each motor or coordinate system.
    pub blocks: BlockPlace,
    /// The blocks and their words that the daemon reads from the board.
    pub selection: Selection,
}

impl RegionInfo {
    /// The region's state in a segment of `condition`: a dead daemon can no longer update it.
    #[must_use]
    pub fn state_at(&self, condition: Condition) -> RegionState {
        match self.state {
            RegionState::Live if condition != Condition::Live => RegionState::Stale,
            state => state,
        }
    }
}

/// A segment's header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HeaderInfo {
    /// Minor version of the layout.
    pub abi_minor: u64,
    /// Size in bytes.
    pub total_length: usize,
    /// The clock of every time in it.
    pub clock: ClockKind,
    /// The state that the owner wrote; [`super::Subscriber::condition`] says whether it still holds.
    pub state: State,
    /// Distinguishes this segment from earlier and later ones of the same name.
    pub generation: u64,
    /// The owner's process.
    pub owner_pid: u64,
    /// The owner's user id.
    pub owner_uid: u64,
    /// When the segment was created, in ns of its clock.
    pub created_ns: u64,
    /// The owner's last heartbeat, in ns of the segment's clock.
    pub heartbeat_ns: u64,
    /// The age of the heartbeat at which the owner counts as stopped or hanging, in ns; 0: never.
    pub heartbeat_limit_ns: u64,
    /// Number of heartbeats.
    pub beats: u64,
    /// CLOCK_REALTIME minus the segment's clock, in ns.
    pub realtime_offset_ns: i64,
    /// The time of that measurement, in ns of the segment's clock.
    pub realtime_taken_ns: u64,
}
