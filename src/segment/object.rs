//! A segment's file, mapped for writing: creates it, and ends it.

use std::fs::{File, Permissions};
use std::io;
use std::os::unix::fs::{FileExt, MetadataExt, PermissionsExt};
use std::path::Path;

use super::SegmentError;
use super::header::{self, Geometry};
use super::layout::*;
use super::lock;
use super::memory::WriteMap;
use super::newborn::{Newborn, clear_leftovers};
use super::placement::CreateOptions;
use super::ring::{Ring, WordsMut};

/// A segment's file and its memory.
pub(super) struct Object {
    pub(super) map: WriteMap,
    pub(super) file: File,
}

impl Object {
    /// Makes a file of `length` zeros, still without the segment's name, which the caller must own. The caller fills
    /// the file and puts it in place.
    pub(super) fn make(options: &CreateOptions, length: usize) -> Result<(Newborn<'_>, Self), SegmentError> {
        let path = options.name.object(&options.directory);
        let fail = |what| SegmentError::io(what, &path);
        // This process owns the name, so a process that made a file with one of its temporary names is dead.
        clear_leftovers(&options.name, &options.directory);
        let newborn = Newborn::create(&options.name, &options.directory).map_err(fail("create"))?;
        let file = newborn.file().try_clone().map_err(fail("create"))?;
        if !lock::try_hold(&file).map_err(fail("lock"))? {
            return Err(SegmentError::InUse { path, pid: None });
        }
        // Allocate the memory now, so that a full file system is an error here and not a SIGBUS later.
        nix::fcntl::posix_fallocate(&file, 0, length as libc::off_t).map_err(|errno| SegmentError::Full {
            path: path.clone(),
            bytes: length as u64,
            source: errno.into(),
        })?;
        let own = file.metadata().map_err(fail("inspect"))?.gid();
        if let Some(group) = options.group.filter(|group| *group != own) {
            std::os::unix::fs::fchown(&file, None, Some(group)).map_err(fail("give to its group"))?;
        }
        file.set_permissions(Permissions::from_mode(options.mode)).map_err(fail("set the mode of"))?;
        let map = WriteMap::new(&file, length).map_err(fail("map"))?;
        Ok((newborn, Self { map, file }))
    }

    /// Marks the segment dead, and wakes every reader that waits for a sample of `rings`.
    pub(super) fn end(&self, rings: impl Iterator<Item = Ring>) {
        self.map.store_release(AT_STATE / WORD, State::Dead as u64);
        rings.for_each(|ring| {
            self.map.wake(ring.head);
        });
    }
}

/// Removes the name at `path` if it leads to `file`.
pub(super) fn remove_name(path: &Path, file: &File) {
    if lock::leads_to(path, file)
        && let Err(error) = std::fs::remove_file(path)
    {
        log::warn!("cannot remove {}: {error}", path.display());
    }
}

/// Marks the segment that a dead owner left at `path` as dead, so that its readers notice, and returns its generation
/// (0: there was none). The file stays until a new segment replaces it, so that the name always exists.
pub(super) fn retire(path: &Path) -> Result<u64, SegmentError> {
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
        return if is_blank(&file).map_err(SegmentError::io("read the old", path))? {
            log::warn!("replacing {}, which holds nothing: somebody has truncated it", path.display());
            Ok(0)
        } else {
            Err(SegmentError::Occupied { path: path.to_owned(), why: "it is no segment" })
        };
    }
    let Ok(geometry) = Geometry::parse(&words, length) else {
        // A malformed segment has no readers.
        return Ok(0);
    };
    let word = |offset: usize| words[offset / WORD];
    if lock::is_held(&file).map_err(SegmentError::io("probe", path))? {
        // The owner lives: another process removed only the lock file of its name, or linked another segment to this
        // name.
        return Err(SegmentError::InUse {
            path: path.to_owned(),
            pid: u32::try_from(word(AT_OWNER_PID)).ok(),
        });
    }
    file.write_all_at(&(State::Dead as u64).to_ne_bytes(), AT_STATE as u64)
        .map_err(SegmentError::io("mark dead the old", path))?;
    let map = WriteMap::new(&file, geometry.total_length);
    if let Ok(map) = map {
        Object { map, file }.end(geometry.regions.iter().map(|region| region.ring));
    }
    log::info!(
        "replacing the segment {} that process {} made, and nobody writes",
        path.display(),
        word(AT_OWNER_PID)
    );
    Ok(word(AT_GENERATION))
}

/// A longer file of zeros counts as another program's: reading it would take seconds.
const LONGEST_BLANK: u64 = 1 << 28;

/// Whether a file holds nothing but zeros, or nothing at all.
fn is_blank(file: &File) -> io::Result<bool> {
    if file.metadata()?.len() > LONGEST_BLANK {
        return Ok(false);
    }
    let mut piece = [0; 4096];
    let mut at = 0;
    loop {
        match file.read_at(&mut piece, at)? {
            0 => return Ok(true),
            count if piece[..count].iter().any(|byte| *byte != 0) => return Ok(false),
            count => at += count as u64,
        }
    }
}
