//! The DPRAM as PMAC sees it: 16-bit words in a file that a host maps too.
//!
//! Every store is one exact 16-bit access, so a host on the other side really races with it. A shadow of what PMAC
//! wrote last lets the judge see when a host has written where only PMAC may.

use std::fs::{File, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};

use nix::fcntl::{Flock, FlockArg};
use nix::sys::memfd::{MFdFlags, memfd_create};

use crate::device::board::mapping::Mapping;
use crate::format::{join32, split32};
use crate::sim::board::offsets;

/// Why the shared file could not be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DpramError {
    /// The file could not be opened, created, sized or mapped.
    #[error("cannot use {path} as the board's memory: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file exists with another length.
    #[error("{path} is {length} bytes long, not {expected}; give another path or remove the file")]
    Length {
        /// The file.
        path: PathBuf,
        /// Its length in bytes.
        length: u64,
        /// The length it should have.
        expected: usize,
    },
    /// Another simulator runs on this file.
    #[error("{path} is the memory of another running pmac-sim; stop it or give another path")]
    InUse {
        /// The file.
        path: PathBuf,
    },
}

/// The shared memory, 0x4000 bytes.
pub struct Dpram {
    mapping: Mapping,
    /// Word by word what PMAC wrote last.
    shadow: Box<[u16]>,
    /// Held for life: one board a file.
    _lock: Option<Flock<File>>,
}

impl Dpram {
    /// Opens the file at `path`, or creates it 0x4000 bytes long and zeroed.
    ///
    /// The file is never removed: a host may have it mapped, and a simulator started anew must meet the same memory.
    ///
    /// # Errors
    /// [`DpramError`] when the file has another length, belongs to another running simulator or cannot be mapped.
    pub fn open(path: &Path) -> Result<Self, DpramError> {
        let file = open_shared(path, offsets::LENGTH)?;
        Self::map(&file, path).map(|dpram| Self { _lock: Some(file), ..dpram })
    }

    /// Memory that nobody else can map: a board on its own.
    ///
    /// # Errors
    /// [`DpramError::File`] when the system gives no memory.
    pub fn private() -> Result<Self, DpramError> {
        let fail = |source| DpramError::File { path: "private memory".into(), source };
        let file = memfd_create(c"pmac-dpram", MFdFlags::MFD_CLOEXEC).map_err(|errno| fail(errno.into()))?;
        let file = File::from(file);
        file.set_len(offsets::LENGTH as u64).map_err(fail)?;
        Self::map(&file, Path::new("private memory"))
    }

    fn map(file: &File, path: &Path) -> Result<Self, DpramError> {
        let mapping = Mapping::new(file, 0, offsets::LENGTH)
            .map_err(|source| DpramError::File { path: path.to_owned(), source })?;
        let mut dpram = Self { mapping, shadow: vec![0; offsets::LENGTH / 2].into(), _lock: None };
        for offset in (0..offsets::LENGTH as u16).step_by(2) {
            dpram.shadow[usize::from(offset) / 2] = dpram.read16(offset);
        }
        Ok(dpram)
    }

    /// Reads the word at the even byte `offset`; outside the memory a bus reads all ones.
    #[inline]
    #[must_use]
    pub fn read16(&self, offset: u16) -> u16 {
        self.mapping.read16(usize::from(offset)).unwrap_or(0xFFFF)
    }

    /// Writes the word at the even byte `offset`. A write outside the memory is lost, as on a bus.
    #[inline]
    pub fn write16(&mut self, offset: u16, value: u16) {
        if self.mapping.write16(usize::from(offset), value).is_some() {
            self.shadow[usize::from(offset) / 2] = value;
        }
    }

    /// Reads a `DP:` location, low word first.
    #[must_use]
    pub fn read32(&self, offset: u16) -> u32 {
        let low = self.read16(offset);
        join32(low, self.read16(offset.wrapping_add(2)))
    }

    /// Writes a `DP:` location, low word first.
    #[inline]
    pub fn write32(&mut self, offset: u16, value: u32) {
        let [low, high] = split32(value);
        self.write16(offset, low);
        self.write16(offset.wrapping_add(2), high);
    }

    /// What PMAC wrote last at `offset`, whatever a host did since.
    #[must_use]
    pub fn shadow(&self, offset: u16) -> u16 {
        self.shadow.get(usize::from(offset) / 2).copied().unwrap_or(0xFFFF)
    }

    /// Takes `value` as PMAC's own at `offset` without a store.
    pub fn adopt(&mut self, offset: u16, value: u16) {
        if let Some(word) = self.shadow.get_mut(usize::from(offset) / 2) {
            *word = value;
        }
    }

    /// Stores `value` without taking it as PMAC's own: what a fault puts on the bus.
    pub fn disturb(&self, offset: u16, value: u16) {
        let _ = self.mapping.write16(usize::from(offset), value);
    }

    /// Orders the data written before this call before a flag written after it.
    pub fn order_writes(&self) {
        self.mapping.order_writes();
    }

    /// Orders a flag read before this call before the data read after it.
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
    let file =
        OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path).map_err(fail)?;
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
        let mut first = Dpram::open(&path).unwrap();
        assert_eq!(std::fs::metadata(&path).unwrap().len(), 0x4000);
        assert!(matches!(Dpram::open(&path), Err(DpramError::InUse { .. })));
        first.write32(0x0800, 0x1234_5678);
        assert_eq!(first.read16(0x0800), 0x5678);
        assert_eq!(first.read16(0x0802), 0x1234);
        drop(first);
        assert_eq!(Dpram::open(&path).unwrap().read32(0x0800), 0x1234_5678);
    }

    #[test]
    fn a_file_of_another_length_is_refused_and_left_alone() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("dpram");
        std::fs::write(&path, [7; 100]).unwrap();
        let error = Dpram::open(&path).err().unwrap().to_string();
        assert!(error.contains("100 bytes"), "{error}");
        assert_eq!(std::fs::read(&path).unwrap(), [7; 100]);
    }
}
