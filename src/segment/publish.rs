//! The writer: creates the segment, publishes into it, removes it.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use super::counter::Counter;
use super::keeper::{Handover, Keeper};
use super::layout::*;
use super::lock::NameLock;
use super::memory::WriteMap;
use super::object::{Object, remove_name, retire};
use super::placement::{CreateOptions, Placement};
use super::ring::{Ring, Words, WordsMut};
use super::sample::Stamp;
use super::{SegmentError, monotonic_ns, realtime_ns};

/// The writer's side of one region.
#[derive(Clone, Copy)]
struct RegionWriter {
    ring: Ring,
    entry: usize,
    payload_bytes: usize,
    published: u64,
}

/// The owner's end of a segment. Dropping it marks the segment dead, wakes all waiting readers, and removes the name.
pub struct Publisher {
    object: Object,
    options: CreateOptions,
    path: PathBuf,
    generation: u64,
    header_words: usize,
    /// By region number.
    regions_by_id: [Option<RegionWriter>; RegionId::ALL.len() + 1],
    /// Buffer in which a slot is assembled; as long as the longest slot, so that publishing never allocates.
    staging: Vec<u64>,
    handover: Arc<Handover>,
    // Last, so that the name becomes free only after the segment is gone.
    lock: Arc<Mutex<NameLock>>,
}

impl Publisher {
    /// Creates the segment, in place of a dead owner's. Never waits. The segment appears under its name complete, in
    /// state [`State::Init`].
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
        let (newborn, object) = Object::make(options, placement.total_length)?;
        let generation = realtime_ns().max(previous.wrapping_add(1));
        placement.write(&object.map, options, generation);

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
            object,
            options: options.clone(),
            path,
            generation,
            header_words: placement.header_length / WORD,
            regions_by_id,
            staging: vec![0; longest],
            handover: Arc::default(),
            lock: Arc::new(Mutex::new(lock)),
        };
        publisher.beat(options.clock.start_ns());
        publisher.object.map.store_release(AT_MAGIC / WORD, MAGIC);
        newborn.put_at(&publisher.path).map_err(SegmentError::io("put in place", &publisher.path))?;
        Ok(publisher)
    }

    /// The keeper that makes this segment again when its name no longer leads to it.
    ///
    /// # Errors
    /// [`SegmentError::Io`] if the system has no more descriptors.
    pub fn keeper(&self) -> Result<Keeper, SegmentError> {
        let file = self.object.file.try_clone().map_err(SegmentError::io("keep", &self.path))?;
        Keeper::new(self.options.clone(), file, Arc::clone(&self.handover), Arc::clone(&self.lock))
    }

    /// Goes on in the file that the [`Keeper`] has made in place of this one, if there is such a file: the same
    /// segment, and every number goes on. Allocates nothing and never waits. Call it at each heartbeat.
    pub fn move_if_asked(&mut self) {
        let Self { object, handover, regions_by_id, header_words, .. } = self;
        handover.exchange(object, |old, new| {
            regions_by_id.iter().flatten().for_each(|region| region.ring.carry_over(&old.map, &new.map));
            (0..*header_words).for_each(|index| new.map.store(index, old.map.load(index)));
        });
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
        let woken = self.object.map.wake(region_writer.ring.head);
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
        if self.options.clock == ClockKind::Own {
            // Stored before the sample, so that no reader finds a sample later than the segment's time.
            self.object.map.store(AT_NOW / WORD, stamp.time_ns.max(self.object.map.load(AT_NOW / WORD)));
        }
        region_writer.published += 1;
        region_writer.ring.write(&self.object.map, region_writer.published, body);
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
            self.object.map.store((region_writer.entry + field) / WORD, value);
        }
    }

    /// Sets the state of the whole segment. Wakes no reader: a waiting reader checks the state when no data arrive.
    pub fn set_state(&self, state: State) {
        self.object.map.store_release(AT_STATE / WORD, state as u64);
    }

    /// Sets the segment's own clock ([`ClockKind::Own`]), by which readers compute every age; does nothing when the
    /// segment uses CLOCK_MONOTONIC.
    pub fn set_now(&self, now_ns: u64) {
        if self.options.clock == ClockKind::Own {
            self.object.map.store(AT_NOW / WORD, now_ns);
        }
    }

    /// Stores a heartbeat; call it at least ten times a second. `now_ns` is by the segment's clock, and is stored as in
    /// [`Publisher::set_now`]. Also measures the offset of CLOCK_REALTIME.
    pub fn beat(&self, now_ns: u64) {
        self.set_now(now_ns);
        let (realtime, taken) = match self.options.clock {
            ClockKind::Monotonic => {
                let before = monotonic_ns();
                let realtime = realtime_ns();
                (realtime, before + monotonic_ns().saturating_sub(before) / 2)
            }
            ClockKind::Own => (realtime_ns(), now_ns),
        };
        self.object.map.store(AT_REALTIME_OFFSET / WORD, realtime.wrapping_sub(taken));
        self.object.map.store(AT_REALTIME_TAKEN / WORD, taken);
        self.object.map.store(AT_BEATS / WORD, self.object.map.load(AT_BEATS / WORD).wrapping_add(1));
        self.object.map.store(AT_HEARTBEAT / WORD, now_ns);
    }

    /// The counters in the segment.
    #[must_use]
    pub fn counters(&self) -> Counters<'_> {
        Counters { map: &self.object.map }
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
}

impl Drop for Publisher {
    fn drop(&mut self) {
        self.object.end(self.regions_by_id.iter().flatten().map(|region_writer| region_writer.ring));
        remove_name(&self.path, &self.object.file);
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

    /// Sets a counter that another part of the daemon counts.
    pub fn set(&self, counter: Counter, value: u64) {
        self.map.store(AT_COUNTERS / WORD + counter as usize, value);
    }

    /// The counter's value.
    #[must_use]
    pub fn value(&self, counter: Counter) -> u64 {
        self.map.load(AT_COUNTERS / WORD + counter as usize)
    }
}

#[inline]
fn join(words: [u16; 4]) -> u64 {
    let [[a, b], [c, d], [e, f], [g, h]] = words.map(u16::to_ne_bytes);
    u64::from_ne_bytes([a, b, c, d, e, f, g, h])
}
