//! The reader: attaches to a segment read-only, and reads the latest sample, the next, or all since a given one.
//!
//! A reader writes nothing, holds no lock and can neither slow nor stop the daemon. It never shows old data as new: what it returns carries
//! its time stamp, and [`Subscriber::is_fresh`] and [`Subscriber::condition`] apply the rules of [`super::layout`].

use std::fs::File;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::cursor::Cursor;
use super::freshness::{self, Staleness};
use super::header::{self, Geometry, Refusal, Region};
use super::layout::*;
use super::lock::{self, FileId};
use super::memory::ReadMap;
use super::payload::blocks::BlockPlace;
use super::ring::{Attempt, Latest, Words};
use super::sample::{Sample, Stamp};
use super::{DIRECTORY, SegmentError, SegmentName, monotonic_ns};
use crate::map::Selection;

/// How often a read is started again when the writer comes round; with 4 slots or more, once is rare.
pub(super) const ATTEMPTS: u32 = 16;
/// How long a sleeping reader goes without looking whether the owner still lives.
const SLICE_NS: u64 = 100_000_000;

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

/// How a wait ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WaitOutcome {
    /// There is a newer sample.
    Newer,
    /// The time is over.
    TimedOut,
    /// There will be none: attach again.
    Dead,
}

/// What became of a read of one sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Read {
    /// It was copied.
    Sample,
    /// It is not published yet.
    NotYet,
    /// It was overwritten.
    Lost {
        /// The oldest sample that may still be there.
        first_available: u64,
    },
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
    /// What the owner says; see [`Subscriber::condition`] for whether it can be believed.
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

/// A reader's end of a segment.
pub struct Subscriber {
    map: ReadMap,
    file: File,
    file_id: FileId,
    path: PathBuf,
    geometry: Geometry,
    /// The regions once more, by number: found without a search.
    inlets: [Option<Region>; RegionId::ALL.len() + 1],
    generation: u64,
}

impl Subscriber {
    /// Attaches to the segment of that name in `/dev/shm`.
    ///
    /// # Errors
    /// [`SegmentError::NotFound`] when there is none, [`SegmentError::ForeignOwner`] or [`SegmentError::WritableByOthers`] when it cannot be
    /// trusted, [`SegmentError::Version`] or [`SegmentError::Malformed`] when it cannot be read.
    pub fn attach(name: &SegmentName) -> Result<Self, SegmentError> {
        Self::attach_in(Path::new(DIRECTORY), name)
    }

    /// Attaches to the segment of that name in another directory.
    ///
    /// # Errors
    /// As [`Subscriber::attach`].
    pub fn attach_in(directory: &Path, name: &SegmentName) -> Result<Self, SegmentError> {
        let path = name.object(directory);
        let file = lock::open(&path, false).map_err(|source| match source.kind() {
            io::ErrorKind::NotFound => SegmentError::NotFound { path: path.clone() },
            _ => SegmentError::Io { what: "open", path: path.clone(), source },
        })?;
        let there = file.metadata().map_err(SegmentError::io("look at", &path))?;
        if !lock::is_trusted(there.uid()) {
            return Err(SegmentError::ForeignOwner { path, uid: there.uid() });
        }
        if !there.is_file() {
            return Err(SegmentError::Malformed { path, why: "it is not a regular file".to_owned() });
        }
        if there.mode() & 0o022 != 0 {
            return Err(SegmentError::WritableByOthers { path, mode: there.mode() & 0o777 });
        }
        let (words, length) = header::read(&file).map_err(SegmentError::io("read", &path))?;
        let geometry = match Geometry::parse(&words, length) {
            Ok(geometry) => geometry,
            Err(Refusal::Malformed(why)) => return Err(SegmentError::Malformed { path, why }),
            Err(Refusal::Version(found)) => return Err(SegmentError::Version { path, found }),
        };
        let map = ReadMap::new(&file, geometry.total_length).map_err(SegmentError::io("map", &path))?;
        let generation = map.load(AT_GENERATION / WORD);
        let mut inlets = [None; RegionId::ALL.len() + 1];
        for region in geometry.regions.iter().rev() {
            inlets[region.id as usize] = Some(*region);
        }
        let file_id = FileId::of(&there);
        Ok(Self { map, file, file_id, path, geometry, inlets, generation })
    }

    /// How the segment stands: what its header says, whether its owner gives signs of life, exists at all, or was replaced. Two system calls.
    #[must_use]
    pub fn condition(&self) -> Condition {
        if self.is_replaced() {
            return Condition::Replaced;
        }
        match self.header_condition(self.now_ns()) {
            Condition::Dead => Condition::Dead,
            _ if self.is_owner_gone() => Condition::OwnerGone,
            other => other,
        }
    }

    /// How the segment stands as far as the memory shows it, without a system call: what its header says, and the heartbeat.
    #[must_use]
    pub fn header_condition(&self, now_ns: u64) -> Condition {
        let header = self.header();
        let overdue = freshness::is_old(header.heartbeat_ns, now_ns, header.heartbeat_limit_ns);
        match header.state {
            State::Dead => Condition::Dead,
            _ if overdue => Condition::Stale,
            State::Init => Condition::Init,
            State::Live => Condition::Live,
            State::Stale => Condition::Stale,
        }
    }

    /// Whether a sample of that region and stamp may be shown as live at `now_ns` (by the segment's clock), by the rules of
    /// [`super::freshness`]. Does not ask the kernel whether the owner lives; its heartbeat tells within a moment.
    #[must_use]
    pub fn is_fresh(&self, region: RegionId, stamp: &Stamp, now_ns: u64) -> bool {
        let Ok(region) = self.region(region) else { return false };
        Staleness::of_segment(self.header_condition(now_ns), &self.header(), now_ns).is_none()
            && Staleness::of_sample(&region, stamp, now_ns).is_none()
    }

    /// What time it is by the segment's clock, in ns: the one that all its times and ages are counted by.
    #[must_use]
    pub fn now_ns(&self) -> u64 {
        match self.geometry.clock {
            ClockKind::Monotonic => monotonic_ns(),
            ClockKind::Own => self.map.load(AT_NOW / WORD),
        }
    }

    /// What tells this segment from its predecessors and successors.
    #[must_use]
    pub fn generation(&self) -> u64 {
        self.generation
    }

    /// The segment's file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What the segment says about itself and its owner.
    #[must_use]
    pub fn header(&self) -> HeaderInfo {
        let word = |offset: usize| self.map.load(offset / WORD);
        HeaderInfo {
            abi_minor: word(AT_ABI_MINOR),
            total_length: self.geometry.total_length,
            clock: self.geometry.clock,
            state: State::from_number(word(AT_STATE)),
            generation: self.generation,
            owner_pid: word(AT_OWNER_PID),
            owner_uid: word(AT_OWNER_UID),
            created_ns: word(AT_CREATED),
            heartbeat_ns: word(AT_HEARTBEAT),
            heartbeat_limit_ns: word(AT_HEARTBEAT_LIMIT),
            beats: word(AT_BEATS),
            realtime_offset_ns: word(AT_REALTIME_OFFSET) as i64,
            realtime_taken_ns: word(AT_REALTIME_TAKEN),
        }
    }

    /// A counter; 0 if the segment's writer does not keep it.
    #[must_use]
    pub fn counter(&self, counter: Counter) -> u64 {
        let index = counter as usize;
        if index >= self.geometry.counter_count {
            return 0;
        }
        self.map.load(self.geometry.counters / WORD + index)
    }

    /// All counters this version knows, with their names.
    pub fn counters(&self) -> impl Iterator<Item = (Counter, u64)> + '_ {
        Counter::ALL.into_iter().map(|counter| (counter, self.counter(counter)))
    }

    /// The regions the segment holds and this version knows.
    pub fn regions(&self) -> impl Iterator<Item = RegionInfo> + '_ {
        self.geometry.regions.iter().map(|region| self.info(region))
    }

    /// One region.
    ///
    /// # Errors
    /// [`SegmentError::NoSuchRegion`].
    pub fn region(&self, region: RegionId) -> Result<RegionInfo, SegmentError> {
        Ok(self.info(self.region_of(region)?))
    }

    /// Number of samples published in a region, which is the number of the latest; 0 when there is none.
    ///
    /// # Errors
    /// [`SegmentError::NoSuchRegion`].
    pub fn published(&self, region: RegionId) -> Result<u64, SegmentError> {
        Ok(self.region_of(region)?.ring.published(&self.map))
    }

    /// Copies the region's latest sample and returns its number; `None` when there is none yet.
    ///
    /// # Errors
    /// [`SegmentError::NoSuchRegion`]; [`SegmentError::Overrun`] when the writer overtook every one of a bounded number of attempts;
    /// [`SegmentError::Corrupt`]. After an error other than `NoSuchRegion`, or `None`, the sample has no words.
    #[inline]
    pub fn latest(&self, region: RegionId, sample: &mut Sample) -> Result<Option<u64>, SegmentError> {
        // What nearly always happens calls nothing, so that no register need be saved for it.
        let mut attempts = 0;
        if let Some(inlet) = &self.inlets[region as usize]
            && let Some(slot) = sample.has_room(inlet.lines)
        {
            match inlet.ring.latest_at_once(&self.map, slot) {
                Latest::Whole { sequence, .. } if sample.accept(sequence, 0, inlet.payload_bytes) => {
                    return Ok(Some(sequence));
                }
                Latest::Overrun => attempts = 1,
                Latest::Whole { .. } | Latest::Empty => {}
            }
        }
        self.latest_after(attempts, region, sample)
    }

    /// As [`Subscriber::latest`], after so many attempts.
    #[cold]
    fn latest_after(
        &self,
        attempts: u32,
        region: RegionId,
        sample: &mut Sample,
    ) -> Result<Option<u64>, SegmentError> {
        let inlet = self.region_of(region)?;
        match inlet.ring.latest(&self.map, sample.room(inlet.lines), ATTEMPTS - attempts) {
            Latest::Whole { sequence, retries } => {
                accept(inlet, sample, sequence, attempts + retries).map(|()| Some(sequence))
            }
            Latest::Empty => {
                sample.clear();
                Ok(None)
            }
            Latest::Overrun => {
                sample.clear();
                Err(SegmentError::Overrun { region, attempts: ATTEMPTS })
            }
        }
    }

    /// Copies sample `sequence` of a region, if it is there. The sample is empty if it is not.
    ///
    /// # Errors
    /// [`SegmentError::NoSuchRegion`], [`SegmentError::Corrupt`].
    #[inline]
    pub fn read(&self, region: RegionId, sequence: u64, sample: &mut Sample) -> Result<Read, SegmentError> {
        let inlet = self.region_of(region)?;
        match inlet.ring.read(&self.map, sequence, sample.room(inlet.lines)) {
            Attempt::Whole => accept(inlet, sample, sequence, 0).map(|()| Read::Sample),
            Attempt::NotYet => {
                sample.clear();
                Ok(Read::NotYet)
            }
            Attempt::Lost => {
                sample.clear();
                let first_available = inlet.ring.oldest(inlet.ring.published(&self.map));
                Ok(Read::Lost { first_available: first_available.max(sequence.saturating_add(1)) })
            }
        }
    }

    /// Sleeps until the region has a sample newer than `sequence` (0: any), at most `timeout`. Notices within a moment
    /// when the owner stops, is killed or is replaced. The time-out is real time, whatever clock the segment has.
    ///
    /// # Errors
    /// [`SegmentError::NoSuchRegion`].
    pub fn wait_newer(
        &self,
        region: RegionId,
        sequence: u64,
        timeout: Duration,
    ) -> Result<WaitOutcome, SegmentError> {
        let ring = self.region_of(region)?.ring;
        let mut now = monotonic_ns();
        let deadline = now.saturating_add(u64::try_from(timeout.as_nanos()).unwrap_or(u64::MAX));
        let mut look_around = now.saturating_add(SLICE_NS);
        loop {
            let head = ring.published(&self.map);
            if head > sequence {
                return Ok(WaitOutcome::Newer);
            }
            if State::from_number(self.map.load(AT_STATE / WORD)) == State::Dead {
                return Ok(WaitOutcome::Dead);
            }
            if now >= look_around || now >= deadline {
                if self.condition().is_over() {
                    return Ok(WaitOutcome::Dead);
                }
                look_around = now.saturating_add(SLICE_NS);
            }
            if now >= deadline {
                return Ok(WaitOutcome::TimedOut);
            }
            self.map.wait(ring.head, head, deadline.min(look_around));
            now = monotonic_ns();
        }
    }

    /// A cursor that follows every sample of a region from number `next` on (1: from the very first).
    ///
    /// # Errors
    /// [`SegmentError::NoSuchRegion`].
    pub fn cursor(&self, region: RegionId, next: u64) -> Result<Cursor, SegmentError> {
        self.region_of(region)?;
        Ok(Cursor::new(region, self.generation, next))
    }

    /// For a cursor: as [`Subscriber::read`] of the sample it wants, looking at the head only when `head`, what it last was, is reached.
    /// When the sample is lost, `head` is looked at as well.
    #[inline(always)]
    pub(super) fn follow(
        &self,
        region: RegionId,
        sequence: u64,
        head: &mut u64,
        sample: &mut Sample,
    ) -> Result<Attempt, SegmentError> {
        let inlet = self.region_of(region)?;
        if sequence > *head {
            *head = inlet.ring.published(&self.map);
            if sequence > *head {
                sample.clear();
                return Ok(Attempt::NotYet);
            }
        }
        let attempt = inlet.ring.read_published(&self.map, sequence, *head, sample.room(inlet.lines));
        if attempt == Attempt::Whole {
            accept(inlet, sample, sequence, 0)?;
        } else {
            sample.clear();
            *head = inlet.ring.published(&self.map);
        }
        Ok(attempt)
    }

    /// Where an overrun reader of `region` goes on when the head is `head`.
    pub(super) fn resume(&self, region: RegionId, head: u64) -> Result<u64, SegmentError> {
        Ok(self.region_of(region)?.ring.resume(head))
    }

    fn is_replaced(&self) -> bool {
        lock::file_at(&self.path).is_some_and(|found| found != self.file_id)
    }

    fn is_owner_gone(&self) -> bool {
        // A probe that fails says nothing; the heartbeat tells then.
        !lock::is_held(&self.file).unwrap_or(true)
    }

    #[inline(always)]
    fn region_of(&self, id: RegionId) -> Result<&Region, SegmentError> {
        // No `ok_or`: it would make and drop an error on every read.
        match &self.inlets[id as usize] {
            Some(region) => Ok(region),
            None => Err(SegmentError::NoSuchRegion(id)),
        }
    }

    fn in_entry(&self, region: &Region, field: usize) -> u64 {
        self.map.load((region.entry + field) / WORD)
    }

    fn info(&self, region: &Region) -> RegionInfo {
        RegionInfo {
            id: region.id,
            slots: region.ring.count as u64,
            payload_bytes: region.payload_bytes,
            first_host_offset: region.first_host_offset,
            blocks: region.blocks,
            state: RegionState::from_number(self.in_entry(region, REGION_STATE)),
            period_ns: self.in_entry(region, REGION_PERIOD),
            stale_after_ns: self.in_entry(region, REGION_STALE_AFTER),
            published: region.ring.published(&self.map),
            selection: Selection::without(
                self.in_entry(region, REGION_UNREAD_WORDS),
                self.in_entry(region, REGION_UNREAD_NUMBERS),
            ),
        }
    }
}

#[inline(always)]
fn accept(region: &Region, sample: &mut Sample, sequence: u64, retries: u32) -> Result<(), SegmentError> {
    if sample.accept(sequence, retries, region.payload_bytes) {
        Ok(())
    } else {
        sample.clear();
        Err(SegmentError::Corrupt { region: region.id, sequence })
    }
}
