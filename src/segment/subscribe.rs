//! The reader: attaches to a segment read-only; reads the latest sample, the next, or all since a given one.
//!
//! A reader writes nothing, holds no lock and can neither slow nor stop the daemon. It never shows old data as new: a
//! result carries its time stamp, and [`Subscriber::is_fresh`] and [`Subscriber::condition`] apply the rules of
//! [`super::freshness`].

use std::fs::File;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::counter::Counter;
use super::cursor::Cursor;
use super::freshness::{self, Staleness};
use super::header::{self, Geometry, HeaderError, Region};
use super::info::{Condition, HeaderInfo, RegionInfo};
use super::layout::*;
use super::lock::{self, FileId};
use super::memory::ReadMap;
use super::region_reader::{Read, RegionReader};
use super::ring::{Latest, Words};
use super::sample::{Sample, Stamp};
use super::{DIRECTORY, SegmentError, SegmentName, monotonic_ns};
use crate::map::Selection;

/// How long a sleeping reader goes without checking that the owner still lives.
const SLICE_NS: u64 = 100_000_000;

/// How a wait ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WaitOutcome {
    /// There is a newer sample.
    Newer,
    /// The time-out expired.
    TimedOut,
    /// No more samples will come: attach again.
    Dead,
}

/// A reader's end of a segment.
pub struct Subscriber {
    map: ReadMap,
    file: File,
    file_id: FileId,
    path: PathBuf,
    geometry: Geometry,
    /// The regions again, indexed by id, to avoid a search.
    regions_by_id: [Option<Region>; RegionId::ALL.len() + 1],
    generation: u64,
}

impl Subscriber {
    /// Attaches to the segment `name` in `/dev/shm`.
    ///
    /// # Errors
    /// [`SegmentError::NotFound`] without such a segment, [`SegmentError::ForeignOwner`] or
    /// [`SegmentError::WritableByOthers`] if this process must not trust it, [`SegmentError::Version`] or
    /// [`SegmentError::Malformed`] if it cannot read it.
    pub fn attach(name: &SegmentName) -> Result<Self, SegmentError> {
        Self::attach_in(Path::new(DIRECTORY), name)
    }

    /// Attaches to the segment `name` in another directory.
    ///
    /// # Errors
    /// As [`Subscriber::attach`].
    pub fn attach_in(directory: &Path, name: &SegmentName) -> Result<Self, SegmentError> {
        let path = name.object(directory);
        let file = lock::open(&path, false).map_err(|source| match source.kind() {
            io::ErrorKind::NotFound => SegmentError::NotFound { path: path.clone() },
            _ => SegmentError::Io { what: "open", path: path.clone(), source },
        })?;
        let there = file.metadata().map_err(SegmentError::io("inspect", &path))?;
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
            Err(HeaderError::Malformed(why)) => return Err(SegmentError::Malformed { path, why }),
            Err(HeaderError::Version(found)) => return Err(SegmentError::Version { path, found }),
        };
        let map = ReadMap::new(&file, geometry.total_length).map_err(SegmentError::io("map", &path))?;
        let generation = map.load(AT_GENERATION / WORD);
        let mut regions_by_id = [None; RegionId::ALL.len() + 1];
        for region in geometry.regions.iter().rev() {
            regions_by_id[region.id as usize] = Some(*region);
        }
        let file_id = FileId::of(&there);
        Ok(Self { map, file, file_id, path, geometry, regions_by_id, generation })
    }

    /// The segment's condition: its header's state, its owner's heartbeat, whether the owner lives, and whether another
    /// segment has replaced it. Two system calls.
    #[must_use]
    pub fn condition(&self) -> Condition {
        if self.is_replaced() { Condition::Replaced } else { self.own_condition() }
    }

    /// As [`Subscriber::condition`], but does not look whether the name leads to another segment. One system call.
    #[must_use]
    pub fn own_condition(&self) -> Condition {
        match self.header_condition(self.now_ns()) {
            Condition::Dead => Condition::Dead,
            _ if self.is_owner_gone() => Condition::OwnerGone,
            other => other,
        }
    }

    /// The condition from memory alone, without a system call: the header's state and the heartbeat.
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

    /// Whether a sample of `region` and `stamp` is live at `now_ns` (by the segment's clock), by the rules of
    /// [`super::freshness`]. Makes no system call; the heartbeat shows a dead owner within a moment.
    #[must_use]
    pub fn is_fresh(&self, region: RegionId, stamp: &Stamp, now_ns: u64) -> bool {
        let Ok(region) = self.region(region) else { return false };
        Staleness::of_segment(self.header_condition(now_ns), &self.header(), now_ns).is_none()
            && Staleness::of_sample(&region, stamp, now_ns).is_none()
    }

    /// The time by the segment's clock, in ns, to which all its times and ages refer.
    #[must_use]
    pub fn now_ns(&self) -> u64 {
        match self.geometry.clock {
            ClockKind::Monotonic => monotonic_ns(),
            ClockKind::Own => self.map.load(AT_NOW / WORD),
        }
    }

    /// Distinguishes this segment from earlier and later ones of the same name.
    #[must_use]
    pub fn generation(&self) -> u64 {
        self.generation
    }

    /// The segment's file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The segment's header.
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

    /// Number of samples published in a region, which is the number of the latest; 0 before the first.
    ///
    /// # Errors
    /// [`SegmentError::NoSuchRegion`].
    pub fn published(&self, region: RegionId) -> Result<u64, SegmentError> {
        Ok(self.region_of(region)?.ring.published(&self.map))
    }

    /// Copies the region's latest sample and returns its number; `None` before the first.
    ///
    /// # Errors
    /// [`SegmentError::NoSuchRegion`]; [`SegmentError::Overrun`] when the writer overtook every one of a bounded number
    /// of attempts; [`SegmentError::Corrupt`]. The sample is empty after `None` and after every error but
    /// `NoSuchRegion`.
    #[inline]
    pub fn latest(&self, region: RegionId, sample: &mut Sample) -> Result<Option<u64>, SegmentError> {
        // The usual path calls no function, so it saves no registers.
        let mut attempts = 0;
        if let Some(region) = &self.regions_by_id[region as usize]
            && let Some(slot) = sample.has_room(region.lines)
        {
            match region.ring.latest_at_once(&self.map, slot) {
                Latest::Whole { sequence, .. } if sample.accept(sequence, 0, region.payload_bytes) => {
                    return Ok(Some(sequence));
                }
                Latest::Overrun => attempts = 1,
                Latest::Whole { .. } | Latest::Empty => {}
            }
        }
        self.latest_after(attempts, region, sample)
    }

    /// As [`Subscriber::latest`], after `attempts` failed attempts.
    #[cold]
    fn latest_after(
        &self,
        attempts: u32,
        region: RegionId,
        sample: &mut Sample,
    ) -> Result<Option<u64>, SegmentError> {
        self.reader(region)?.latest(attempts, sample)
    }

    /// Copies sample `sequence` of a region. Leaves the sample empty if the region does not hold it.
    ///
    /// # Errors
    /// [`SegmentError::NoSuchRegion`], [`SegmentError::Corrupt`].
    #[inline]
    pub fn read(&self, region: RegionId, sequence: u64, sample: &mut Sample) -> Result<Read, SegmentError> {
        self.reader(region)?.read(sequence, sample)
    }

    /// Sleeps until the region has a sample newer than `sequence` (0: any), at most `timeout`. Notices within a moment
    /// when the owner stops, is killed or is replaced. The time-out is real time, whichever clock the segment has.
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

    /// Copies the cursor's next sample; `false`, and an empty sample, when it is not published yet. When the writer has
    /// overtaken the cursor, it continues half a ring behind and counts the samples it lost.
    ///
    /// # Errors
    /// [`SegmentError::OtherGeneration`] with another segment's cursor; [`SegmentError::Overrun`] when the writer
    /// overtook every attempt (call it again); [`SegmentError::Corrupt`].
    #[inline(always)]
    pub fn next(&self, cursor: &mut Cursor, sample: &mut Sample) -> Result<bool, SegmentError> {
        cursor.next(&self.reader(cursor.region())?, sample)
    }

    #[inline(always)]
    fn reader(&self, region: RegionId) -> Result<RegionReader<'_>, SegmentError> {
        Ok(RegionReader { map: &self.map, region: self.region_of(region)?, generation: self.generation })
    }

    fn is_replaced(&self) -> bool {
        lock::file_at(&self.path).is_some_and(|found| found != self.file_id)
    }

    fn is_owner_gone(&self) -> bool {
        // A failed check proves nothing; the heartbeat decides then.
        !lock::is_held(&self.file).unwrap_or(true)
    }

    #[inline(always)]
    fn region_of(&self, id: RegionId) -> Result<&Region, SegmentError> {
        // No `ok_or`: it would construct and drop an error on every read.
        match &self.regions_by_id[id as usize] {
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
