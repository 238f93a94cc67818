//! The regions to publish, and their places in the segment.

use std::path::PathBuf;

use super::counter::Counter;
use super::header;
use super::layout::*;
use super::memory::WriteMap;
use super::payload::blocks::BlockPlace;
use super::ring::{Ring, Words, WordsMut};
use super::{DIRECTORY, SegmentError, SegmentName, monotonic_ns};
use crate::map::Selection;

/// Regions begin on two cache lines: processors fetch lines in pairs, and the head should be alone in its pair.
const REGION_ALIGNMENT: usize = 2 * LINE;

/// A region to lay out.
#[derive(Clone, Copy, Debug)]
pub struct RegionSpec {
    /// The region's kind.
    pub id: RegionId,
    /// Number of slots, a power of two and at least 2.
    pub slots: u32,
    /// Longest payload in bytes, at most [`MAX_PAYLOAD`].
    pub payload_bytes: u32,
    /// Host byte offset of the payload's first word in the DPRAM.
    pub first_host_offset: u32,
    /// Where the payload holds the block of each motor or coordinate system.
    pub blocks: BlockPlace,
    /// Expected time between samples, in ns; 0 without a period.
    pub period_hint_ns: u64,
    /// The age at which the latest sample becomes stale, in ns; 0: never.
    pub stale_after_ns: u64,
}

/// How to create a segment.
#[derive(Clone, Debug)]
pub struct CreateOptions {
    /// Its name.
    pub name: SegmentName,
    /// Permission bits; only the owner may have the write bit.
    pub mode: u32,
    /// Its group, if not the process's own.
    pub group: Option<u32>,
    /// The directory to create it in.
    pub directory: PathBuf,
    /// The clock of every time in it.
    pub clock: ClockKind,
    /// After this time without [`super::Publisher::beat`] readers take the owner for stopped, in ns; 0: never.
    pub heartbeat_limit_ns: u64,
    /// Its regions.
    pub regions: Vec<RegionSpec>,
    /// The regions that the daemon reads only in part.
    pub selections: Vec<(RegionId, Selection)>,
}

impl CreateOptions {
    /// A world-readable segment `name` in `/dev/shm`, stale after 300 ms without a heartbeat.
    #[must_use]
    pub fn new(name: SegmentName, regions: Vec<RegionSpec>) -> Self {
        Self {
            name,
            mode: 0o644,
            group: None,
            directory: PathBuf::from(DIRECTORY),
            clock: ClockKind::Monotonic,
            heartbeat_limit_ns: 300_000_000,
            regions,
            selections: Vec::new(),
        }
    }
}

impl ClockKind {
    /// The clock's time when the segment is created.
    pub(super) fn start_ns(self) -> u64 {
        match self {
            Self::Monotonic => monotonic_ns(),
            Self::Own => 0,
        }
    }
}

/// The place of everything.
pub(super) struct Placement {
    pub(super) header_length: usize,
    pub(super) total_length: usize,
    /// Each region with the offset of its entry and its ring.
    pub(super) regions: Vec<(RegionSpec, usize, Ring)>,
}

impl Placement {
    pub(super) fn new(options: &CreateOptions) -> Result<Self, SegmentError> {
        let refuse = |why: String| Err(SegmentError::Spec(why));
        if options.mode & !0o777 != 0 || options.mode & 0o022 != 0 {
            return refuse(format!("mode {:o} would let others than the owner write to it", options.mode));
        }
        let mut placement = Self {
            header_length: AT_REGIONS + options.regions.len() * REGION_STRIDE,
            total_length: 0,
            regions: Vec::new(),
        };
        let mut end = placement.header_length;
        for (index, spec) in options.regions.iter().enumerate() {
            let name = spec.id.name();
            if placement.regions.iter().any(|(other, ..)| other.id == spec.id) {
                return refuse(format!("there are two {name} regions"));
            }
            if !spec.slots.is_power_of_two() || spec.slots < 2 {
                return refuse(format!("{} slots for the {name} region are not a power of two", spec.slots));
            }
            if u64::from(spec.payload_bytes) > MAX_PAYLOAD {
                return refuse(format!("a {name} payload of {} bytes is too long", spec.payload_bytes));
            }
            if !spec.blocks.fits(u64::from(spec.payload_bytes)) {
                return refuse(format!(
                    "a {name} payload of {} bytes has no room for its blocks",
                    spec.payload_bytes
                ));
            }
            let payload_bytes = spec.payload_bytes as usize;
            let stride = header::slot_bytes(payload_bytes).next_multiple_of(LINE);
            let head = end.next_multiple_of(REGION_ALIGNMENT);
            let slots = head + REGION_ALIGNMENT;
            // On a 32-bit target such a region may have more bytes than a `usize` counts.
            let length = slots as u64 + u64::from(spec.slots) * stride as u64;
            if length > MAX_TOTAL {
                return refuse(format!("{length} bytes are more than a segment may have"));
            }
            end = length as usize;
            let ring = header::ring_at(head, slots, spec.slots as usize, stride, payload_bytes);
            placement.regions.push((*spec, AT_REGIONS + index * REGION_STRIDE, ring));
        }
        placement.total_length = end.next_multiple_of(4096);
        Ok(placement)
    }

    /// Writes the header except the magic. The memory is new, so every other word is zero.
    pub(super) fn write(&self, map: &WriteMap, options: &CreateOptions, generation: u64) {
        let put = |offset: usize, value: u64| map.store(offset / WORD, value);
        put(AT_ABI_MAJOR, ABI_MAJOR);
        put(AT_ABI_MINOR, ABI_MINOR);
        put(AT_HEADER_LENGTH, self.header_length as u64);
        put(AT_TOTAL_LENGTH, self.total_length as u64);
        put(AT_BYTE_ORDER, BYTE_ORDER);
        put(AT_WORD_BYTES, WORD as u64);
        put(AT_STATE, State::Init as u64);
        put(AT_GENERATION, generation);
        put(AT_OWNER_PID, u64::from(std::process::id()));
        put(AT_OWNER_UID, u64::from(nix::unistd::geteuid().as_raw()));
        put(AT_CLOCK_KIND, options.clock as u64);
        put(AT_CREATED, options.clock.start_ns());
        put(AT_HEARTBEAT_LIMIT, options.heartbeat_limit_ns);
        put(AT_REGION_TABLE, AT_REGIONS as u64);
        put(AT_REGION_COUNT, self.regions.len() as u64);
        put(AT_REGION_STRIDE, REGION_STRIDE as u64);
        put(AT_COUNTER_TABLE, AT_COUNTERS as u64);
        put(AT_COUNTER_COUNT, Counter::ALL.len() as u64);
        for (spec, entry, ring) in &self.regions {
            put(entry + REGION_ID, spec.id as u64);
            put(entry + REGION_HEAD, (ring.head * WORD) as u64);
            put(entry + REGION_SLOTS, (ring.slots * WORD) as u64);
            put(entry + REGION_SLOT_COUNT, ring.count as u64);
            put(entry + REGION_SLOT_STRIDE, (ring.stride * WORD) as u64);
            put(entry + REGION_PAYLOAD, u64::from(spec.payload_bytes));
            put(entry + REGION_HOST_OFFSET, u64::from(spec.first_host_offset));
            put(entry + REGION_BLOCK_START, u64::from(spec.blocks.start));
            put(entry + REGION_BLOCK_STRIDE, u64::from(spec.blocks.stride));
            put(entry + REGION_BLOCK_COUNT, u64::from(spec.blocks.count));
            put(entry + REGION_STATE, RegionState::Off as u64);
            put(entry + REGION_PERIOD, spec.period_hint_ns);
            put(entry + REGION_STALE_AFTER, spec.stale_after_ns);
            for (_, selection) in options.selections.iter().filter(|(id, _)| *id == spec.id) {
                let (words, numbers) = selection.left_out();
                put(entry + REGION_UNREAD_WORDS, words);
                put(entry + REGION_UNREAD_NUMBERS, numbers);
            }
        }
        let entries = self.regions.iter().map(|(_, entry, _)| *entry);
        put(AT_LAYOUT_HASH, header::hash_of(entries, |offset| map.load(offset / WORD)));
    }
}
