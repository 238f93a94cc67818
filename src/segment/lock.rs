//! The owner of a name, and the processes that may replace a dead owner's files.
//!
//! There are two open-file-description locks; the kernel releases them when the owner dies, however it dies. The lock
//! on `<name>.lock` (mode 0600, so that no client can take it) keeps a second daemon away. The lock on the segment
//! itself tells clients, through their read-only descriptor, that the owner lives: only a write lock counts, and only a
//! process with write permission can hold one.

use std::fs::{File, Metadata, OpenOptions};
use std::io::{self, Read, Seek, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use nix::errno::Errno;
use nix::fcntl::{FcntlArg, fcntl};
use nix::unistd::{User, geteuid};

use super::SegmentError;

/// Follow no link, do not block on a named pipe, close in child programs.
const OPEN_FLAGS: i32 = libc::O_CLOEXEC | libc::O_NOFOLLOW | libc::O_NONBLOCK;

/// Opens an existing file, never creates one.
pub(super) fn open(path: &Path, write: bool) -> io::Result<File> {
    OpenOptions::new().read(true).write(write).custom_flags(OPEN_FLAGS).open(path)
}

/// Creates a new file for the owner alone; fails if it exists.
pub(super) fn create(path: &Path) -> io::Result<File> {
    OpenOptions::new().read(true).write(true).create_new(true).mode(0o600).custom_flags(OPEN_FLAGS).open(path)
}

/// Takes the write lock on the whole of `file`; false if another holds it.
pub(super) fn try_hold(file: &File) -> io::Result<bool> {
    match fcntl(file, FcntlArg::F_OFD_SETLK(&whole_file(libc::F_WRLCK))) {
        Ok(_) => Ok(true),
        Err(Errno::EAGAIN | Errno::EACCES) => Ok(false),
        Err(other) => Err(other.into()),
    }
}

/// Whether another process holds the write lock on `file`. Changes nothing, needs no write permission, costs one system
/// call.
pub(super) fn is_held(file: &File) -> io::Result<bool> {
    kernel_asked();
    let mut probe = whole_file(libc::F_RDLCK);
    fcntl(file, FcntlArg::F_OFD_GETLK(&mut probe))?;
    Ok(i32::from(probe.l_type) != libc::F_UNLCK)
}

fn whole_file(kind: libc::c_int) -> libc::flock {
    libc::flock {
        l_type: kind as libc::c_short,
        l_whence: libc::SEEK_SET as libc::c_short,
        l_start: 0,
        l_len: 0,
        l_pid: 0,
    }
}

/// Whether readers trust a segment of `uid`: root, the user `pmacd`, or this process's own user.
pub fn is_trusted(uid: u32) -> bool {
    uid == 0 || uid == geteuid().as_raw() || is_pmacd(uid)
}

/// Whether this process may remove files of a dead owner `uid`: its own, and as root also those of `pmacd`.
pub(super) fn may_replace(uid: u32) -> bool {
    uid == geteuid().as_raw() || (geteuid().is_root() && is_pmacd(uid))
}

fn is_pmacd(uid: u32) -> bool {
    matches!(User::from_name("pmacd"), Ok(Some(user)) if user.uid.as_raw() == uid)
}

/// Whether the file at `path` has another name.
pub(super) fn is_linked(path: &Path) -> bool {
    path.symlink_metadata().is_ok_and(|there| there.nlink() > 1)
}

/// Identifies a file, whatever its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FileId {
    device: u64,
    inode: u64,
}

impl FileId {
    pub(crate) fn of(there: &Metadata) -> Self {
        Self { device: there.dev(), inode: there.ino() }
    }
}

/// The file at `path`; `None` if the kernel does not say. One system call.
pub(crate) fn file_at(path: &Path) -> Option<FileId> {
    kernel_asked();
    path.symlink_metadata().ok().as_ref().map(FileId::of)
}

/// Whether `path` names `file` itself.
pub(super) fn leads_to(path: &Path, file: &File) -> bool {
    match (file_at(path), file.metadata()) {
        (Some(there), Ok(here)) => there == FileId::of(&here),
        _ => false,
    }
}

/// Rejects `path` unless it is a regular file that this process may replace. `Ok(false)`: there is no file.
pub(super) fn check_replaceable(path: &Path) -> Result<bool, SegmentError> {
    let there = match path.symlink_metadata() {
        Ok(there) => there,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(false),
        Err(error) => return Err(SegmentError::io("inspect", path)(error)),
    };
    if !may_replace(there.uid()) {
        return Err(SegmentError::ForeignOwner { path: path.to_owned(), uid: there.uid() });
    }
    if !there.is_file() {
        return Err(SegmentError::Occupied { path: path.to_owned(), why: "it is not a regular file" });
    }
    Ok(true)
}

/// The lock on a segment's name, held as long as the owner lives.
pub(super) struct NameLock {
    file: File,
    path: PathBuf,
}

impl NameLock {
    /// Takes the lock at `path`, or names its holder. Never waits.
    pub(super) fn take(path: PathBuf) -> Result<Self, SegmentError> {
        // The last holder removes the file when it ends. A lock on a removed file guards nothing, so try again.
        for _ in 0..100 {
            let file = if check_replaceable(&path)? { open(&path, true) } else { create(&path) };
            let mut file = match file {
                Ok(file) => file,
                Err(error)
                    if matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::AlreadyExists) =>
                {
                    continue;
                }
                Err(error) => return Err(SegmentError::io("open the lock", &path)(error)),
            };
            if !try_hold(&file).map_err(SegmentError::io("lock", &path))? {
                return Err(SegmentError::InUse { pid: pid_in(&mut file), path });
            }
            if leads_to(&path, &file) {
                let there = file.metadata().map_err(SegmentError::io("inspect", &path))?;
                if there.nlink() > 1 {
                    // Another process linked one of this user's files to this name: remove only the link.
                    std::fs::remove_file(&path).map_err(SegmentError::io("remove the link", &path))?;
                    continue;
                }
                if there.len() > 0 && pid_in(&mut file).is_none() {
                    return Err(SegmentError::Occupied { path, why: "it is no lock of pmacd" });
                }
                // The pid serves only the error message of a second daemon; failing to write it is no reason to stop.
                let cleared = file.set_len(0).and_then(|()| file.rewind());
                let _ = cleared.and_then(|()| writeln!(file, "{}", std::process::id()));
                return Ok(Self { file, path });
            }
        }
        Err(SegmentError::InUse { path, pid: None })
    }

    /// Whether the name still leads to it.
    pub(super) fn is_in_place(&self) -> bool {
        leads_to(&self.path, &self.file)
    }
}

impl Drop for NameLock {
    fn drop(&mut self) {
        if self.is_in_place()
            && let Err(error) = std::fs::remove_file(&self.path)
        {
            log::debug!("cannot remove {}: {error}", self.path.display());
        }
    }
}

fn pid_in(file: &mut File) -> Option<u32> {
    let mut text = String::new();
    file.rewind().ok()?;
    file.take(16).read_to_string(&mut text).ok()?;
    text.trim().parse().ok()
}

/// Counts a reader's system call, for the tests that limit their number.
fn kernel_asked() {
    #[cfg(test)]
    KERNEL_ASKED.with(|count| count.set(count.get() + 1));
}

#[cfg(test)]
thread_local! {
    /// System calls made by readers in this thread.
    pub(crate) static KERNEL_ASKED: std::cell::Cell<u64> = const { std::cell::Cell::new(0) };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_taker_is_refused_and_told_by_whom_and_a_third_succeeds_after_the_first_left() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("pmac0.lock");
        let first = NameLock::take(path.clone()).unwrap();
        match NameLock::take(path.clone()) {
            Err(SegmentError::InUse { pid, .. }) => assert_eq!(pid, Some(std::process::id())),
            other => panic!("{:?}", other.map(|_| ())),
        }
        drop(first);
        assert!(!path.exists());
        NameLock::take(path).unwrap();
    }

    #[test]
    fn a_lock_is_seen_on_a_read_only_descriptor_and_a_readers_lock_is_none() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let reader = open(file.path(), false).unwrap();
        assert!(!is_held(&reader).unwrap());
        let other_reader = open(file.path(), false).unwrap();
        fcntl(&other_reader, FcntlArg::F_OFD_SETLK(&whole_file(libc::F_RDLCK))).unwrap();
        assert!(!is_held(&reader).unwrap(), "a client's own lock must not look like an owner");
        drop(other_reader);
        assert!(try_hold(file.as_file()).unwrap());
        assert!(is_held(&reader).unwrap());
    }

    #[test]
    fn a_link_or_a_pipe_in_the_way_is_an_error_not_a_hang() {
        let directory = tempfile::tempdir().unwrap();
        let pipe = directory.path().join("pipe");
        nix::unistd::mkfifo(&pipe, nix::sys::stat::Mode::S_IRWXU).unwrap();
        assert!(matches!(NameLock::take(pipe), Err(SegmentError::Occupied { .. })));
        let link = directory.path().join("link");
        std::os::unix::fs::symlink("/etc/passwd", &link).unwrap();
        assert!(matches!(NameLock::take(link), Err(SegmentError::Occupied { .. })));
    }
}
