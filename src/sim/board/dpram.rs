//! The DPRAM as PMAC sees it: 16-bit words in a file that a host maps too.
//!
//! Every store is one exact 16-bit access, so a host on the other side really races with it. A shadow of PMAC's last
//! writes shows the judge that a host has written where only PMAC may.

use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use nix::fcntl::{Flock, FlockArg};
use nix::sys::memfd::{MFdFlags, memfd_create};
use nix::unistd::geteuid;

use crate::device::mapping::Mapping;
use crate::format::{join32, split32};
use crate::map::HostOffset;
use crate::map::functions::{Flag, Timer};

/// Why the shared file could not be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DpramError {
    /// The file could not be opened, created, sized or mapped.
    #[error("cannot use {path} as the board's memory: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The file exists with another length.
    #[error("{path} is {length} bytes long, not {expected}; give another path or remove the file")]
    Length {
        /// The file.
        path: PathBuf,
        /// Its length in bytes.
        length: u64,
        /// The expected length.
        expected: usize,
    },
    /// The file at the path is not the simulator's to use.
    #[error("{path} cannot be the board's memory: {why}; give another path or remove it")]
    Stranger {
        /// The file.
        path: PathBuf,
        /// The reason.
        why: String,
    },
    /// Another simulator runs on this file.
    #[error("{path} is the memory of another running pmac-sim; stop it or give another path")]
    InUse {
        /// The file.
        path: PathBuf,
    },
}

/// The shared memory.
pub struct Dpram {
    mapping: Mapping,
    /// PMAC's last write to each word.
    shadow: Box<[u16]>,
    /// The lock on the file, held for life: one board a file.
    _lock: Option<Flock<File>>,
}

impl Dpram {
    /// Opens the file at `path`, or creates it `length` bytes long and zeroed.
    ///
    /// The file is never removed: a host may have it mapped, and a simulator started anew must meet the same memory.
    ///
    /// # Errors
    /// [`DpramError`] when the file has another length, belongs to another running simulator or cannot be mapped.
    pub fn open(path: &Path, length: u32) -> Result<Self, DpramError> {
        let file = open_shared(path, length as usize)?;
        Self::map(&file, path, length as usize).map(|dpram| Self { _lock: Some(file), ..dpram })
    }

    /// Memory of `length` bytes that no other process can map: a board on its own.
    ///
    /// # Errors
    /// [`DpramError::File`] when the system gives no memory.
    pub fn private(length: u32) -> Result<Self, DpramError> {
        let fail = |source| DpramError::File { path: "private memory".into(), source };
        let file = memfd_create(c"pmac-dpram", MFdFlags::MFD_CLOEXEC).map_err(|errno| fail(errno.into()))?;
        let file = File::from(file);
        file.set_len(length.into()).map_err(fail)?;
        Self::map(&file, Path::new("private memory"), length as usize)
    }

    fn map(file: &File, path: &Path, length: usize) -> Result<Self, DpramError> {
        let mapping = Mapping::new(file, 0, length)
            .map_err(|source| DpramError::File { path: path.to_owned(), source })?;
        let mut dpram = Self { mapping, shadow: vec![0; length / 2].into(), _lock: None };
        for offset in dpram.words() {
            dpram.shadow[offset.word()] = dpram.read16(offset);
        }
        Ok(dpram)
    }

    /// Every word, in order.
    pub fn words(&self) -> impl Iterator<Item = HostOffset> + Clone + use<> {
        (0..self.shadow.len()).map(|word| HostOffset::new(0).plus_words(word))
    }

    /// Reads the word at `offset`; outside the memory a bus reads all ones.
    #[inline]
    #[must_use]
    pub fn read16(&self, offset: HostOffset) -> u16 {
        self.mapping.read16(offset.bytes() as usize).unwrap_or(0xFFFF)
    }

    /// Writes the word at `offset`. A write outside the memory is lost, as on a bus.
    #[inline]
    pub fn write16(&mut self, offset: HostOffset, value: u16) {
        if self.mapping.write16(offset.bytes() as usize, value).is_some() {
            self.shadow[offset.word()] = value;
        }
    }

    /// Reads a `DP:` location, low word first.
    #[must_use]
    pub fn read32(&self, offset: HostOffset) -> u32 {
        let low = self.read16(offset);
        join32(low, self.read16(offset.plus_words(1)))
    }

    /// Writes a `DP:` location, low word first.
    #[inline]
    pub fn write32(&mut self, offset: HostOffset, value: u32) {
        let [low, high] = split32(value);
        self.write16(offset, low);
        self.write16(offset.plus_words(1), high);
    }

    /// PMAC's last write at `offset`, whatever a host has written since.
    #[must_use]
    pub fn shadow(&self, offset: HostOffset) -> u16 {
        self.shadow.get(offset.word()).copied().unwrap_or(0xFFFF)
    }

    /// Takes `value` as PMAC's own at `offset` without a store.
    pub fn adopt(&mut self, offset: HostOffset, value: u16) {
        if let Some(word) = self.shadow.get_mut(offset.word()) {
            *word = value;
        }
    }

    /// Stores `value` but leaves the shadow: a fault's disturbance on the bus.
    pub fn disturb(&self, offset: HostOffset, value: u16) {
        let _ = self.mapping.write16(offset.bytes() as usize, value);
    }

    /// Whether `flag` is set.
    #[must_use]
    pub fn is_set(&self, flag: Flag) -> bool {
        flag.is_set(self.read16(flag.word))
    }

    /// Sets or clears `flag` and stores the other bits as in PMAC's last write.
    #[inline]
    pub fn set(&mut self, flag: Flag, set: bool) {
        let others = self.shadow(flag.word) & !flag.mask;
        self.write16(flag.word, if set { others | flag.mask } else { others });
    }

    /// Stores the low bits of `count` that fit `timer`, and the other bits of its words as in PMAC's last write.
    #[inline]
    pub fn store_timer(&mut self, timer: Timer, count: u32) {
        let mut store = |word, bits: u32, part: u32| {
            let mask = ((1_u32 << bits) - 1) as u16;
            let others = self.shadow(word) & !mask;
            self.write16(word, others | part as u16 & mask);
        };
        store(timer.low, timer.low_bits, count);
        if let Some((word, bits)) = timer.high {
            store(word, bits, count >> timer.low_bits);
        }
    }

    /// Data written before this call reach memory before a flag written after it.
    pub fn order_writes(&self) {
        self.mapping.order_writes();
    }

    /// A read of a flag before this call precedes a read of data after it.
    pub fn order_reads(&self) {
        self.mapping.order_reads();
    }
}

/// Opens the file at `path` that a host shares, or creates it `length` bytes long and zeroed, and locks it: one board a
/// file.
///
/// # Errors
/// [`DpramError`], as for [`Dpram::open`].
pub fn open_shared(path: &Path, length: usize) -> Result<Flock<File>, DpramError> {
    let fail = |source| DpramError::File { path: path.to_owned(), source };
    let stranger = |why: String| DpramError::Stranger { path: path.to_owned(), why };
    let mut options = OpenOptions::new();
    // Never through a link, and no hang at a named pipe.
    options
        .read(true)
        .write(true)
        .create(true)
        .truncate(false)
        .custom_flags(libc::O_NOFOLLOW | libc::O_NONBLOCK);
    let file = options.open(path).map_err(|error| match error.raw_os_error() {
        Some(libc::ELOOP) => stranger("it is a symbolic link".to_owned()),
        _ => fail(error),
    })?;
    let there = file.metadata().map_err(fail)?;
    if !there.is_file() {
        return Err(stranger("it is not a regular file".to_owned()));
    }
    if there.uid() != geteuid().as_raw() {
        return Err(stranger(format!("it belongs to user {}", there.uid())));
    }
    if there.nlink() > 1 {
        return Err(stranger("it is also another file, by a hard link".to_owned()));
    }
    let file = Flock::lock(file, FlockArg::LockExclusiveNonblock).map_err(|(_, errno)| {
        if errno == nix::errno::Errno::EWOULDBLOCK {
            DpramError::InUse { path: path.to_owned() }
        } else {
            fail(errno.into())
        }
    })?;
    let found = file.metadata().map_err(fail)?.len();
    if found == 0 {
        file.set_len(length as u64).map_err(fail)?;
    } else if found != length as u64 {
        return Err(DpramError::Length { path: path.to_owned(), length: found, expected: length });
    }
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_file_is_created_and_a_second_board_refused() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("dpram");
        let mut first = Dpram::open(&path, 0x4000).unwrap();
        assert_eq!(std::fs::metadata(&path).unwrap().len(), 0x4000);
        assert!(matches!(Dpram::open(&path, 0x4000), Err(DpramError::InUse { .. })));
        first.write32(HostOffset::new(0x0800), 0x1234_5678);
        assert_eq!(first.read16(HostOffset::new(0x0800)), 0x5678);
        assert_eq!(first.read16(HostOffset::new(0x0802)), 0x1234);
        drop(first);
        assert_eq!(Dpram::open(&path, 0x4000).unwrap().read32(HostOffset::new(0x0800)), 0x1234_5678);
    }

    #[test]
    fn no_link_is_followed_to_a_memory() {
        let directory = tempfile::tempdir().unwrap();
        let target = directory.path().join("target");
        std::fs::write(&target, b"").unwrap();
        let link = directory.path().join("link");
        std::os::unix::fs::symlink(&target, &link).unwrap();
        let error = Dpram::open(&link, 0x4000).err().unwrap().to_string();
        assert!(error.contains("link cannot be the board's memory: it is a symbolic link"), "{error}");
        let other_name = directory.path().join("other-name");
        std::fs::hard_link(&target, &other_name).unwrap();
        let error = Dpram::open(&other_name, 0x4000).err().unwrap().to_string();
        assert!(error.contains("hard link"), "{error}");
        assert_eq!(std::fs::read(&target).unwrap(), b"", "nothing became of it");
        let missing = directory.path().join("missing");
        std::os::unix::fs::symlink(&missing, directory.path().join("dangling")).unwrap();
        assert!(Dpram::open(&directory.path().join("dangling"), 0x4000).is_err() && !missing.exists());
    }

    #[test]
    #[ignore = "needs root, to give a file to another user"]
    fn as_root_b4_6_a_strangers_file_is_no_memory() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("dpram");
        std::fs::write(&path, b"").unwrap();
        std::os::unix::fs::chown(&path, Some(12345), None).unwrap();
        let error = Dpram::open(&path, 0x4000).err().unwrap().to_string();
        assert!(error.contains("it belongs to user 12345"), "{error}");
        assert_eq!(std::fs::read(&path).unwrap(), b"");
    }

    #[test]
    fn a_file_of_another_length_is_refused_and_left_alone() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("dpram");
        std::fs::write(&path, [7; 100]).unwrap();
        let error = Dpram::open(&path, 0x4000).err().unwrap().to_string();
        assert!(error.contains("100 bytes"), "{error}");
        assert_eq!(std::fs::read(&path).unwrap(), [7; 100]);
    }

    #[test]
    fn timers_and_flags_share_words_with_each_other() {
        let mut dpram = Dpram::private(0x1_0000).unwrap();
        let (low, high) = (HostOffset::new(0xC06C), HostOffset::new(0xC06E));
        let timer = Timer { low, low_bits: 16, high: Some((high, 8)) };
        let ready = Flag { word: high, mask: 1 << 15 };
        dpram.set(ready, true);
        dpram.store_timer(timer, 0x12_3456);
        assert_eq!([dpram.read16(low), dpram.read16(high)], [0x3456, 0x8012]);
        dpram.set(ready, false);
        dpram.store_timer(Timer { low, low_bits: 15, high: None }, 0xFFFF);
        assert_eq!([dpram.read16(low), dpram.read16(high)], [0x7FFF, 0x0012]);
        assert!(!dpram.is_set(ready));
    }
}
