//! A segment's file before it gets its name.
//!
//! Every user may create files in the directory of segments, and could take a predictable name first. So the unfinished
//! file has no name, or an unpredictable one.

use std::fs::{File, OpenOptions};
use std::hash::{BuildHasher, RandomState};
use std::io;
use std::os::fd::AsFd;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use nix::errno::Errno;
use nix::fcntl::{AT_FDCWD, AtFlags};
use nix::unistd::linkat;

use super::{SegmentName, lock};
use crate::process::path_of;

/// Most random names to try. A random name is never taken by accident, so trying for ever would not help.
const TRIES: u32 = 16;

/// A file without its final name. Dropping it removes its random name, if it has one.
pub(super) struct Newborn<'a> {
    file: File,
    name: &'a SegmentName,
    directory: &'a Path,
    /// Its random name, if it has one.
    temporary: Option<PathBuf>,
}

impl<'a> Newborn<'a> {
    /// Creates the file without a name, or with a random one if the file system does not support files without.
    pub(super) fn create(name: &'a SegmentName, directory: &'a Path) -> io::Result<Self> {
        let unnamed = OpenOptions::new()
            .read(true)
            .write(true)
            .mode(0o600)
            .custom_flags(libc::O_TMPFILE | libc::O_CLOEXEC)
            .open(directory);
        match unnamed {
            Ok(file) => Ok(Self { file, name, directory, temporary: None }),
            Err(error) if matches!(error.raw_os_error(), Some(libc::EOPNOTSUPP | libc::EISDIR)) => {
                Self::create_named(name, directory)
            }
            Err(error) => Err(error),
        }
    }

    fn create_named(name: &'a SegmentName, directory: &'a Path) -> io::Result<Self> {
        let (path, file) = at_random_name(name, directory, lock::create)?;
        Ok(Self { file, name, directory, temporary: Some(path) })
    }

    pub(super) fn file(&self) -> &File {
        &self.file
    }

    /// Puts the completed file at `path`, in place of the file there.
    pub(super) fn put_at(mut self, path: &Path) -> io::Result<()> {
        let temporary = match self.temporary.take() {
            Some(temporary) => temporary,
            None => self.link()?,
        };
        std::fs::rename(self.temporary.insert(temporary), path)?;
        self.temporary = None;
        Ok(())
    }

    /// Gives the file a random name. A link cannot replace an existing file; a rename can.
    fn link(&self) -> io::Result<PathBuf> {
        let source = path_of(self.file.as_fd());
        let link = |path: &Path| {
            linkat(AT_FDCWD, &source, AT_FDCWD, path, AtFlags::AT_SYMLINK_FOLLOW).map_err(Errno::into)
        };
        Ok(at_random_name(self.name, self.directory, link)?.0)
    }
}

impl Drop for Newborn<'_> {
    fn drop(&mut self) {
        if let Some(temporary) = &self.temporary {
            let _ = std::fs::remove_file(temporary);
        }
    }
}

/// Calls `make` with unpredictable names, until one is free.
fn at_random_name<T>(
    name: &SegmentName,
    directory: &Path,
    make: impl Fn(&Path) -> io::Result<T>,
) -> io::Result<(PathBuf, T)> {
    let mut tries = 1;
    loop {
        // The hasher's keys are random, and so is every hash.
        let path = name.temporary(directory, RandomState::new().hash_one(tries));
        match make(&path) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists && tries < TRIES => tries += 1,
            made => return made.map(|made| (path, made)),
        }
    }
}

/// Removes the files of owners that died between the random name and the final one. The caller must hold the lock on
/// `name`.
pub(super) fn clear_leftovers(name: &SegmentName, directory: &Path) {
    let entries = std::fs::read_dir(directory).into_iter().flatten().flatten();
    for entry in entries.filter(|entry| name.is_temporary(&entry.file_name())) {
        let path = entry.path();
        // Files of other users do no harm.
        if lock::check_replaceable(&path).is_ok_and(|is_there| is_there)
            && let Err(error) = std::fs::remove_file(&path)
        {
            log::warn!("cannot remove the unfinished {}: {error}", path.display());
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};

    use super::*;

    #[test]
    fn a_file_is_seen_only_in_its_place_with_or_without_a_name_before() {
        let name = SegmentName::new("pmac0").unwrap();
        let directory = tempfile::tempdir().unwrap();
        let count = || std::fs::read_dir(directory.path()).unwrap().count();
        let path = directory.path().join("pmac0");
        std::fs::write(&path, b"old").unwrap();
        for (create, names) in
            [(Newborn::create as fn(_, _) -> _, 1), (Newborn::create_named as fn(_, _) -> io::Result<_>, 2)]
        {
            let newborn: Newborn<'_> = create(&name, directory.path()).unwrap();
            assert_eq!(count(), names);
            let mut kept = newborn.file().try_clone().unwrap();
            kept.write_all(b"new").unwrap();
            newborn.put_at(&path).unwrap();
            assert!(lock::leads_to(&path, &kept));
            assert_eq!(count(), 1);
            drop(create(&name, directory.path()).unwrap());
            assert_eq!(count(), 1, "what is not put in place is gone");
        }
        let mut text = String::new();
        File::open(path).unwrap().read_to_string(&mut text).unwrap();
        assert_eq!(text, "new");
    }
}
