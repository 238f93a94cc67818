//! Sees that the names of a segment and of its lock lead to what their owner holds, and makes again what is gone.
//!
//! Any process of the same user may remove, rename or replace them, as Python's `SharedMemory` does when it ends; so may a logout
//! (RemoveIPC) and a file system that is mounted over the directory. The kernel gives a file that has lost its last name no other
//! one. So the keeper makes a new file that continues the old one: same generation, same samples under the same numbers. The keeper
//! copies the bulk; the thread that publishes copies the little that came meanwhile, and goes on in the new file. Then the new
//! file gets the name, and the old one is marked dead, so that its readers attach again.

use std::fs::File;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Duration;

use super::SegmentError;
use super::lock::{self, NameLock};
use super::memory::ReadMap;
use super::object::{Object, retire};
use super::placement::{CreateOptions, Placement};

/// How long the writer may take to move: several heartbeats.
const PATIENCE: Duration = Duration::from_millis(500);

/// Where the keeper leaves a new file for the writer, and the writer the old one for the keeper.
#[derive(Default)]
pub(super) struct Handover {
    object: Mutex<Option<Object>>,
    /// Whether that is a new one.
    is_offered: AtomicBool,
    taken: Condvar,
}

impl Handover {
    /// The writer's part: exchanges `object` for the new one that is offered, if one is, after `carry_over` of both. Never waits.
    pub(super) fn exchange(&self, object: &mut Object, carry_over: impl FnOnce(&Object, &Object)) {
        if !self.is_offered.load(Ordering::Acquire) {
            return;
        }
        // The keeper holds it for a moment at a time: there is another heartbeat.
        let Ok(mut place) = self.object.try_lock() else { return };
        if let Some(new) = place.as_mut().filter(|_| self.is_offered.load(Ordering::Acquire)) {
            carry_over(object, new);
            std::mem::swap(object, new);
            self.is_offered.store(false, Ordering::Release);
            drop(place);
            self.taken.notify_one();
        }
    }

    /// The keeper's part: offers `new`, and returns the old one; `None` when the writer does not take it in time.
    fn offer(&self, new: Object) -> Option<Object> {
        let mut place = self.object.lock().unwrap_or_else(PoisonError::into_inner);
        *place = Some(new);
        self.is_offered.store(true, Ordering::Release);
        let offered = |_: &mut Option<Object>| self.is_offered.load(Ordering::Acquire);
        let waited = self.taken.wait_timeout_while(place, PATIENCE, offered);
        let (mut place, _) = waited.unwrap_or_else(PoisonError::into_inner);
        let old = place.take();
        if self.is_offered.swap(false, Ordering::AcqRel) { None } else { old }
    }
}

/// Keeps the names of a segment; see [`super::Publisher::keeper`].
pub struct Keeper {
    options: CreateOptions,
    placement: Placement,
    path: PathBuf,
    /// What its name shall lead to.
    file: File,
    handover: Arc<Handover>,
    lock: Arc<Mutex<NameLock>>,
}

impl Keeper {
    pub(super) fn new(
        options: CreateOptions,
        file: File,
        handover: Arc<Handover>,
        lock: Arc<Mutex<NameLock>>,
    ) -> Result<Self, SegmentError> {
        let placement = Placement::new(&options)?;
        let path = options.name.object(&options.directory);
        Ok(Self { options, placement, path, file, handover, lock })
    }

    /// Makes again what is gone, and logs it. Waits for the publishing thread, for a bounded time. To be called once a second.
    ///
    /// # Errors
    /// As [`super::Publisher::create`]: what is in the way is left alone; or [`SegmentError::NotMoved`].
    pub fn tend(&mut self) -> Result<(), SegmentError> {
        self.tend_lock()?;
        if lock::leads_to(&self.path, &self.file) {
            return Ok(());
        }
        retire(&self.path)?;
        let path = &self.path;
        let fail = |what| SegmentError::io(what, path);
        let length = self.placement.total_length;
        let (newborn, new) = Object::make(&self.options, length)?;
        new.map.lock();
        let rings = || self.placement.regions.iter().map(|(_, _, ring)| *ring);
        let old = ReadMap::new(&self.file, length).map_err(fail("read the old"))?;
        rings().for_each(|ring| ring.carry_over(&old, &new.map));
        let file = new.file.try_clone().map_err(fail("keep"))?;
        let Some(old) = self.handover.offer(new) else {
            return Err(SegmentError::NotMoved { path: path.clone() });
        };
        let placed = newborn.put_at(path).map_err(fail("put in place"));
        old.end(rings());
        self.file = file;
        placed?;
        log::warn!(
            "{} was removed, renamed or replaced by somebody; published it again",
            self.path.display()
        );
        Ok(())
    }

    fn tend_lock(&self) -> Result<(), SegmentError> {
        let mut held = self.lock.lock().unwrap_or_else(PoisonError::into_inner);
        if held.is_in_place() {
            return Ok(());
        }
        let path = self.options.name.lock(&self.options.directory);
        *held = NameLock::take(path.clone())?;
        log::warn!("{} was removed, renamed or replaced by somebody; took it again", path.display());
        Ok(())
    }
}
