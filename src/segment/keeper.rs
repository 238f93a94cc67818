//! Keeps the names of a segment and of its lock on their owner's files, and makes missing files again.
//!
//! Any process of the same user may remove, rename or replace the files, as Python's `SharedMemory` does at its end; so
//! may a logout (RemoveIPC) and a file system mounted over the directory. A file that has lost its name cannot get a
//! new one. So the keeper makes a new file that continues the old one: same generation, same samples under the same
//! numbers. The keeper copies the bulk; the publishing thread copies the later words, and goes on in the new file. Then
//! the new file gets the name, and the keeper marks the old one dead, so that its readers attach again.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Duration;

use super::layout::{AT_STATE, State, WORD};
use super::lock::{self, NameLock};
use super::memory::ReadMap;
use super::newborn::Newborn;
use super::object::{Object, remove_name, retire};
use super::placement::{CreateOptions, Placement};
use super::{SegmentError, header};

/// How long the writer may take to move: several heartbeats.
const PATIENCE: Duration = Duration::from_millis(500);

/// The place where the keeper leaves a new file for the writer, and the writer the old file for the keeper.
#[derive(Default)]
pub(super) struct Handover {
    object: Mutex<Option<Object>>,
    /// Whether the file is the keeper's new one.
    is_offered: AtomicBool,
    taken: Condvar,
}

impl Handover {
    /// The writer's part: exchanges `object` for a new one from the keeper, after `carry_over` of both. Never waits.
    pub(super) fn exchange(&self, object: &mut Object, carry_over: impl FnOnce(&Object, &Object)) {
        if !self.is_offered.load(Ordering::Acquire) {
            return;
        }
        // The keeper holds the lock for a moment at a time; the next heartbeat tries again.
        let Ok(mut place) = self.object.try_lock() else { return };
        if let Some(new) = place.as_mut().filter(|_| self.is_offered.load(Ordering::Acquire)) {
            carry_over(object, new);
            std::mem::swap(object, new);
            self.is_offered.store(false, Ordering::Release);
            drop(place);
            self.taken.notify_one();
        }
    }

    /// The keeper's part: offers `new`, and returns the old file; `None` if the writer does not take `new` in time.
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
    /// The file that the name must lead to.
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

    /// Makes missing files again, and logs it. Waits for the publishing thread, for a bounded time. Call it once a
    /// second.
    ///
    /// # Errors
    /// As [`super::Publisher::create`]: a foreign file stays; or [`SegmentError::NotMoved`].
    pub fn tend(&mut self) -> Result<(), SegmentError> {
        self.tend_lock()?;
        if lock::leads_to(&self.path, &self.file) {
            return Ok(());
        }
        let path = &self.path;
        match retire(path) {
            // This process holds the lock of the name, so the segment in the way has another name, which stays.
            Err(SegmentError::InUse { .. }) if lock::is_linked(path) => {
                log::warn!("replacing {}, another name of a segment that lives", path.display());
            }
            retired => drop(retired?),
        }
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
        let placed = put_in_place(newborn, path, &file).map_err(fail("put in place"));
        old.end(rings());
        self.file = file;
        placed?;
        log::warn!("{} was removed, renamed or replaced by somebody; published it again", path.display());
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

/// Gives its name to `newborn`, in which the publishing thread goes on. If that thread has ended the segment meanwhile,
/// the thread found no name to remove: then this removes the name again.
fn put_in_place(newborn: Newborn<'_>, path: &Path, file: &File) -> io::Result<()> {
    newborn.put_at(path)?;
    // The state is read after the name exists: a thread that ends the segment later finds the name itself.
    let (words, _) = header::read(file)?;
    if words.get(AT_STATE / WORD) == Some(&(State::Dead as u64)) {
        remove_name(path, file);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::segment::Publisher;

    #[test]
    fn a_segment_that_ends_before_it_has_its_name_again_leaves_none() {
        let directory = tempfile::tempdir().unwrap();
        let mut options = CreateOptions::new("pmac0".parse().unwrap(), Vec::new());
        options.directory = directory.path().to_owned();
        let mut publisher = Publisher::create(&options).unwrap();
        let path = publisher.path().to_owned();
        std::fs::remove_file(&path).unwrap();
        let length = Placement::new(&options).unwrap().total_length;
        let (newborn, new) = Object::make(&options, length).unwrap();
        let file = new.file.try_clone().unwrap();
        let keeper = publisher.keeper().unwrap();
        std::thread::scope(|scope| {
            let offered = scope.spawn(|| keeper.handover.offer(new));
            while !offered.is_finished() {
                publisher.move_if_asked();
            }
            assert!(offered.join().unwrap().is_some());
        });
        drop(publisher);
        put_in_place(newborn, &path, &file).unwrap();
        assert!(!path.exists());
    }
}
