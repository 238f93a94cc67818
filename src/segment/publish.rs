//! The writer: creates the segment, publishes into it, removes it.

use std::fs::{File, Permissions};
use std::io;
use std::os::unix::fs::{FileExt, MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

use nix::time::ClockId;

use super::counter::Counter;
use super::header::{self, Geometry};
use super::layout::*;
use super::lock::{self, NameLock};
use super::memory::WriteMap;
use super::newborn::{Newborn, clear_leftovers};
use super::placement::{CreateOptions, Placement};
use super::ring::{Ring, Words, WordsMut};
use super::sample::Stamp;
use super::{SegmentError, clock_ns, monotonic_ns};

/// The writer's side of one region.
#[derive(Clone, Copy)]
struct RegionWriter {
    ring: Ring,
    entry: usize,
    payload_bytes: usize,
    published: u64,
}

/// The owner's end of a segment. Dropping it marks the segment dead, wakes everyone who waits, and removes the name.
pub struct Publisher {
    map: WriteMap,
    file: File,
    path: PathBuf,
    generation: u64,
    clock: ClockKind,
    /// By region number.
    regions_by_id: [Option<RegionWriter>; RegionId::ALL.len() + 1],
    /// Buffer in which a slot is assembled; as long as the longest slot, so that publishing never allocates.
    staging: Vec<u64>,
    // Last, so that the name becomes free only after the segment is gone.
    _lock: NameLock,
}

impl Publisher {
    /// Creates the segment, replacing what a dead owner left. Never waits. The segment appears under its name complete,
    /// in state [`State::Init`].
    ///
    /// # Errors
    /// [`SegmentError::InUse`] when another process owns the name, [`SegmentError::ForeignOwner`] when another user's
    /// object is in the way, [`SegmentError::Full`] when there is not enough memory, [`SegmentError::Spec`] for regions
    /// that cannot be laid out.
    pub fn create(options: &CreateOptions) -> Result<Self, SegmentError> {
        let placement = Placement::new(options)?;
        let path = options.name.object(&options.directory);
        let lock = NameLock::take(options.name.lock(&options.directory))?;
        let previous = retire(&path)?;

        // We own the name, so a file with one of its temporary names comes from a process that died.
        clear_leftovers(&options.name, &options.directory);
        let newborn = Newborn::create(&options.name, &options.directory);
        let newborn = newborn.map_err(SegmentError::io("create", &path))?;
        let file = newborn.file().try_clone().map_err(SegmentError::io("create", &path))?;
        let publisher = Self::build(options, &placement, path.clone(), file, lock, previous)?;
        newborn.put_at(&path).map_err(SegmentError::io("put in place", &path))?;
        Ok(publisher)
    }

    fn build(
        options: &CreateOptions,
        placement: &Placement,
        path: PathBuf,
        file: File,
        lock: NameLock,
        previous: u64,
    ) -> Result<Self, SegmentError> {
        let fail = |what| SegmentError::io(what, &path);
        if !lock::try_hold(&file).map_err(fail("lock"))? {
            return Err(SegmentError::InUse { path, pid: None });
        }
        // Allocate the memory now, so that a full file system is an error here and not a SIGBUS later.
        nix::fcntl::posix_fallocate(&file, 0, placement.total_length as libc::off_t).map_err(|errno| {
            SegmentError::Full {
                path: path.clone(),
                bytes: placement.total_length as u64,
                source: errno.into(),
            }
        })?;
        let own = file.metadata().map_err(fail("inspect"))?.gid();
        if let Some(group) = options.group.filter(|group| *group != own) {
            std::os::unix::fs::fchown(&file, None, Some(group)).map_err(fail("give to its group"))?;
        }
        file.set_permissions(Permissions::from_mode(options.mode)).map_err(fail("set the mode of"))?;
        let map = WriteMap::new(&file, placement.total_length).map_err(fail("map"))?;
        let generation = clock_ns(ClockId::CLOCK_REALTIME).max(previous.wrapping_add(1));
        placement.write(&map, options, generation);

        let mut regions_by_id = [None; RegionId::ALL.len() + 1];
        for (spec, entry, ring) in &placement.regions {
            regions_by_id[spec.id as usize] = Some(RegionWriter {
                ring: *ring,
                entry: *entry,
                payload_bytes: spec.payload_bytes as usize,
                published: 0,
            });
        }
        let longest = placement.regions.iter().map(|(_, _, ring)| ring.body).max().unwrap_or(0);
        let publisher = Self {
            map,
            file,
            path,
            generation,
            clock: options.clock,
            regions_by_id,
            staging: vec![0; longest],
            _lock: lock,
        };
        publisher.beat(options.clock.start_ns());
        publisher.map.store_release(AT_MAGIC / WORD, MAGIC);
        Ok(publisher)
    }

    /// Publishes the board's 16-bit words as the region's next sample, wakes its waiting readers, and returns its
    /// number.
    ///
    /// Allocates nothing, never waits and cannot fail. Returns 0 without publishing if the segment has no such region
    /// or the payload is too long for it: bugs of the caller.
    #[inline]
    pub fn publish(&mut self, region: RegionId, stamp: Stamp, words: &[u16]) -> u64 {
        let published = self.put(region, stamp, words);
        self.wake(region);
        published
    }

    /// As [`Publisher::publish`], without the system call that wakes sleeping readers: for readers that poll, or with
    /// [`Publisher::wake`] afterwards.
    #[inline]
    pub fn put(&mut self, region: RegionId, stamp: Stamp, words: &[u16]) -> u64 {
        self.put_payload(region, stamp, words.len() * 2, |payload| {
            let (whole, rest) = words.as_chunks::<4>();
            for (word, chunk) in payload.iter_mut().zip(whole) {
                *word = join(*chunk);
            }
            if let (Some(word), false) = (payload.get_mut(whole.len()), rest.is_empty()) {
                let mut last = [0; 4];
                last[..rest.len()].copy_from_slice(rest);
                *word = join(last);
            }
        })
    }

    /// As [`Publisher::publish`], for bytes.
    pub fn publish_bytes(&mut self, region: RegionId, stamp: Stamp, bytes: &[u8]) -> u64 {
        let published = self.put_payload(region, stamp, bytes.len(), |payload| {
            for (word, chunk) in payload.iter_mut().zip(bytes.chunks(WORD)) {
                let mut last = [0; WORD];
                last[..chunk.len()].copy_from_slice(chunk);
                *word = u64::from_ne_bytes(last);
            }
        });
        self.wake(region);
        published
    }

    /// Wakes the readers that wait for a sample of the region.
    #[inline]
    pub fn wake(&self, region: RegionId) {
        let Some(region_writer) = &self.regions_by_id[region as usize] else { return };
        let woken = self.map.wake(region_writer.ring.head);
        if woken > 0 {
            self.counters().add(Counter::Wakes, woken);
        }
    }

    #[inline]
    fn put_payload(
        &mut self,
        region: RegionId,
        stamp: Stamp,
        length: usize,
        fill: impl FnOnce(&mut [u64]),
    ) -> u64 {
        let Some(region_writer) = &mut self.regions_by_id[region as usize] else { return 0 };
        if length > region_writer.payload_bytes {
            return 0;
        }
        let body = &mut self.staging[..STAMP_WORDS + length.div_ceil(WORD)];
        body[..STAMP_WORDS].copy_from_slice(&stamp.words(length));
        fill(&mut body[STAMP_WORDS..]);
        if self.clock == ClockKind::Own {
            // Stored before the sample, so that no reader finds a sample from the future.
            self.map.store(AT_NOW / WORD, stamp.time_ns.max(self.map.load(AT_NOW / WORD)));
        }
        region_writer.published += 1;
        region_writer.ring.write(&self.map, region_writer.published, body);
        region_writer.published
    }

    /// Number of samples published in `region` so far, which is the number of the latest.
    #[must_use]
    pub fn published(&self, region: RegionId) -> u64 {
        self.regions_by_id[region as usize].map_or(0, |region_writer| region_writer.published)
    }

    /// Sets whether the region is mirrored and its updates arrive in time.
    pub fn set_region_state(&self, region: RegionId, state: RegionState) {
        self.set_in_entry(region, REGION_STATE, state as u64);
    }

    /// Sets the expected time between samples, and the age at which the latest becomes stale (0: never).
    pub fn set_period(&self, region: RegionId, period_ns: u64, stale_after_ns: u64) {
        self.set_in_entry(region, REGION_PERIOD, period_ns);
        self.set_in_entry(region, REGION_STALE_AFTER, stale_after_ns);
    }

    fn set_in_entry(&self, region: RegionId, field: usize, value: u64) {
        if let Some(region_writer) = &self.regions_by_id[region as usize] {
            self.map.store((region_writer.entry + field) / WORD, value);
        }
    }

    /// Sets the state of the whole segment. Wakes nobody: waiting readers check the state when no data arrive.
    pub fn set_state(&self, state: State) {
        self.map.store_release(AT_STATE / WORD, state as u64);
    }

    /// Sets the segment's own clock ([`ClockKind::Own`]), by which readers compute every age; does nothing when the
    /// segment uses CLOCK_MONOTONIC.
    pub fn set_now(&self, now_ns: u64) {
        if self.clock == ClockKind::Own {
            self.map.store(AT_NOW / WORD, now_ns);
        }
    }

    /// Stores a heartbeat; call it at least ten times a second. `now_ns` is by the segment's clock, and is stored as in
    /// [`Publisher::set_now`]. Also measures the offset of CLOCK_REALTIME.
    pub fn beat(&self, now_ns: u64) {
        self.set_now(now_ns);
        let (realtime, taken) = match self.clock {
            ClockKind::Monotonic => {
                let before = monotonic_ns();
                let realtime = clock_ns(ClockId::CLOCK_REALTIME);
                (realtime, before + monotonic_ns().saturating_sub(before) / 2)
            }
            ClockKind::Own => (clock_ns(ClockId::CLOCK_REALTIME), now_ns),
        };
        self.map.store(AT_REALTIME_OFFSET / WORD, realtime.wrapping_sub(taken));
        self.map.store(AT_REALTIME_TAKEN / WORD, taken);
        self.map.store(AT_BEATS / WORD, self.map.load(AT_BEATS / WORD).wrapping_add(1));
        self.map.store(AT_HEARTBEAT / WORD, now_ns);
    }

    /// The counters in the segment.
    #[must_use]
    pub fn counters(&self) -> Counters<'_> {
        Counters { map: &self.map }
    }

    /// Distinguishes this segment from earlier and later ones of its name.
    #[must_use]
    pub fn generation(&self) -> u64 {
        self.generation
    }

    /// The segment's file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for Publisher {
    fn drop(&mut self) {
        self.set_state(State::Dead);
        for region_writer in self.regions_by_id.iter().flatten() {
            self.map.wake(region_writer.ring.head);
        }
        if lock::leads_to(&self.path, &self.file)
            && let Err(error) = std::fs::remove_file(&self.path)
        {
            log::warn!("cannot remove {}: {error}", self.path.display());
        }
    }
}

/// The counters of a segment, for its owner to write.
pub struct Counters<'a> {
    map: &'a WriteMap,
}

impl Counters<'_> {
    /// Adds to a counter.
    pub fn add(&self, counter: Counter, amount: u64) {
        self.set(counter, self.value(counter).wrapping_add(amount));
    }

    /// Sets a counter that is counted elsewhere.
    pub fn set(&self, counter: Counter, value: u64) {
        self.map.store(AT_COUNTERS / WORD + counter as usize, value);
    }

    /// The counter's value.
    #[must_use]
    pub fn value(&self, counter: Counter) -> u64 {
        self.map.load(AT_COUNTERS / WORD + counter as usize)
    }
}

/// Marks the segment that a dead owner left at `path` as dead, so that its readers notice, and returns its generation
/// (0: there was none). It stays until it is replaced, so that the name always exists.
fn retire(path: &Path) -> Result<u64, SegmentError> {
    if !lock::check_replaceable(path)? {
        return Ok(0);
    }
    let file = match lock::open(path, true) {
        Ok(file) => file,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(0),
        Err(error) => return Err(SegmentError::io("open the old", path)(error)),
    };
    let (words, length) = header::read(&file).map_err(SegmentError::io("read the old", path))?;
    if words.first() != Some(&MAGIC) {
        return Err(SegmentError::Occupied { path: path.to_owned(), why: "it is no segment" });
    }
    let Ok(geometry) = Geometry::parse(&words, length) else {
        // No reader can be attached to a malformed segment.
        return Ok(0);
    };
    let word = |offset: usize| words[offset / WORD];
    if lock::is_held(&file).map_err(SegmentError::io("probe", path))? {
        if file.metadata().map_err(SegmentError::io("inspect", path))?.nlink() > 1 {
            log::warn!("replacing {}, another name of a segment that lives", path.display());
            return Ok(0);
        }
        // Its owner lives: somebody removed only the lock file of its name.
        return Err(SegmentError::InUse {
            path: path.to_owned(),
            pid: u32::try_from(word(AT_OWNER_PID)).ok(),
        });
    }
    file.write_all_at(&(State::Dead as u64).to_ne_bytes(), AT_STATE as u64)
        .map_err(SegmentError::io("mark dead the old", path))?;
    if let Ok(map) = WriteMap::new(&file, geometry.total_length) {
        for region in &geometry.regions {
            map.wake(region.ring.head);
        }
    }
    log::info!(
        "replacing the segment {} that process {} of user {} left",
        path.display(),
        word(AT_OWNER_PID),
        file.metadata().map_or(0, |there| there.uid())
    );
    Ok(word(AT_GENERATION))
}

#[inline]
fn join(words: [u16; 4]) -> u64 {
    let [[a, b], [c, d], [e, f], [g, h]] = words.map(u16::to_ne_bytes);
    u64::from_ne_bytes([a, b, c, d, e, f, g, h])
}
