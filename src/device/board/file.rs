//! The `file:` board: a file that another process treats as its DPRAM, such as the simulator's memory.

use std::fs::{File, OpenOptions};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use super::exclusive_lock;
use crate::device::board::mapped::Mapped;
use crate::device::mapping::Mapping;
use crate::device::{Access, Presence};
use crate::map::{FAMILIES, Family};

/// Why a file cannot serve as a board.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FileBoardError {
    /// The kernel cannot open or map the file.
    #[error(
        "cannot open the board's memory file {path}: {source}; is the simulator running, and may you read and write it?"
    )]
    Open {
        /// The file.
        path: PathBuf,
        /// The kernel's error.
        source: std::io::Error,
    },
    /// Not a regular file.
    #[error("{path} is not a regular file; the file: board needs the simulator's memory file")]
    NotAFile {
        /// The path.
        path: PathBuf,
    },
    /// The file is not as long as the DPRAM.
    #[error("{path} has {found} bytes, a DPRAM has {expected}; {}", whose(*found))]
    Length {
        /// The file.
        path: PathBuf,
        /// Its length in bytes.
        found: u64,
        /// The length needed.
        expected: usize,
    },
    /// Another host uses it.
    #[error("{path} is the board of another running pmacd; a board has one host: stop that one first")]
    InUse {
        /// The file.
        path: PathBuf,
    },
}

/// The families whose DPRAM has `bytes`.
fn whose(bytes: u64) -> String {
    let has = |family: &&&Family| family.lengths().any(|length| u64::from(length) == bytes);
    let names: Vec<_> =
        FAMILIES.iter().filter(has).map(|family| format!("family = \"{}\"", family.name)).collect();
    match names.as_slice() {
        [] => "is this the simulator's memory file?".to_owned(),
        names => format!("that is the DPRAM of {}", names.join(" or ")),
    }
}

/// A board whose DPRAM is an ordinary file.
pub struct FileBoard {
    mapping: Mapping,
    path: PathBuf,
    /// Device and inode of the mapped file, to notice that the path names another one.
    identity: (u64, u64),
    /// Held as long as the board is open: two hosts on one board take each other's replies and clear each other's
    /// flags.
    _lock: Option<File>,
}

impl FileBoard {
    /// Maps the first `length` bytes of the file at `path`.
    ///
    /// # Errors
    /// When the path is no regular file of that length, cannot be opened for reading and writing, or has a host
    /// already.
    pub fn open(path: &Path, length: usize) -> Result<Self, FileBoardError> {
        let open_error = |source| FileBoardError::Open { path: path.to_owned(), source };
        let kind = std::fs::metadata(path).map_err(open_error)?.file_type();
        if !kind.is_file() {
            return Err(FileBoardError::NotAFile { path: path.to_owned() });
        }
        let file = OpenOptions::new().read(true).write(true).open(path).map_err(open_error)?;
        let metadata = file.metadata().map_err(open_error)?;
        if metadata.len() != length as u64 {
            return Err(FileBoardError::Length {
                path: path.to_owned(),
                found: metadata.len(),
                expected: length,
            });
        }
        // This kind of lock differs from the one that keeps a second simulator away, so the two do not interfere.
        if !exclusive_lock::lock(&file).map_err(open_error)? {
            return Err(FileBoardError::InUse { path: path.to_owned() });
        }
        let mapping = Mapping::new(&file, 0, length).map_err(open_error)?;
        Ok(Self { mapping, path: path.to_owned(), identity: identity(&metadata), _lock: Some(file) })
    }

    /// The same board, with data read by accesses of up to this width.
    #[must_use]
    pub fn with_access(self, access: Access) -> Self {
        Self { mapping: self.mapping.with_access(access), ..self }
    }

    /// The same board through an open `file`, for tests that have no path.
    ///
    /// # Errors
    /// The error of `mmap`.
    pub fn from_file(file: &File, length: usize) -> std::io::Result<Self> {
        Ok(Self {
            mapping: Mapping::new(file, 0, length)?,
            path: PathBuf::from("/proc/self/fd"),
            identity: identity(&file.metadata()?),
            _lock: None,
        })
    }
}

fn identity(metadata: &std::fs::Metadata) -> (u64, u64) {
    (metadata.dev(), metadata.ino())
}

impl Mapped for FileBoard {
    fn mapping(&self) -> &Mapping {
        &self.mapping
    }
}

impl Presence for FileBoard {
    fn still_there(&self) -> bool {
        std::fs::metadata(&self.path).is_ok_and(|metadata| identity(&metadata) == self.identity)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::Bus;
    use crate::map::HostOffset;

    const BYTES: usize = 0x4000;

    fn memory(length: u64) -> tempfile::NamedTempFile {
        let file = tempfile::NamedTempFile::new().unwrap();
        file.as_file().set_len(length).unwrap();
        file
    }

    #[test]
    fn a_block_reads_what_single_writes_left() {
        let file = memory(0x4000);
        let mut board = FileBoard::open(file.path(), BYTES).unwrap();
        for index in 0..8u16 {
            board.write16(HostOffset::new(0x3FF0).plus_words(index.into()), 0x1000 + index).unwrap();
        }
        let mut words = [0; 8];
        board.read_block(HostOffset::new(0x3FF0), &mut words).unwrap();
        assert_eq!(words, [0x1000, 0x1001, 0x1002, 0x1003, 0x1004, 0x1005, 0x1006, 0x1007]);
        assert!(board.read_block(HostOffset::new(0x3FF2), &mut words).is_err());
        assert!(board.read16(HostOffset::new(0x4000)).is_err());
        assert!(board.write16(HostOffset::new(0x4000), 1).is_err());
    }

    #[test]
    fn only_a_file_of_the_right_length_is_a_board() {
        let short = memory(0x3FFE);
        assert!(matches!(FileBoard::open(short.path(), BYTES), Err(FileBoardError::Length { .. })));
        assert!(matches!(
            FileBoard::open(Path::new("/dev/null"), BYTES),
            Err(FileBoardError::NotAFile { .. })
        ));
        assert!(matches!(
            FileBoard::open(Path::new("/nonexistent/dpram"), BYTES),
            Err(FileBoardError::Open { .. })
        ));
    }

    #[test]
    fn a_file_of_another_size_tells_whose_dpram_it_is() {
        let large = memory(0x1_0000);
        let error = FileBoard::open(large.path(), BYTES).err().unwrap().to_string();
        let end =
            "65536 bytes, a DPRAM has 16384; that is the DPRAM of family = \"turbo\" or family = \"turbo2\"";
        assert!(error.ends_with(end), "{error}");
        let error = FileBoard::open(memory(5).path(), BYTES).err().unwrap().to_string();
        assert!(error.ends_with("is this the simulator's memory file?"), "{error}");
    }

    #[test]
    fn a_board_has_one_host() {
        let file = memory(0x4000);
        let first = FileBoard::open(file.path(), BYTES).unwrap();
        assert!(matches!(FileBoard::open(file.path(), BYTES), Err(FileBoardError::InUse { .. })));
        drop(first);
        assert!(FileBoard::open(file.path(), BYTES).is_ok());
    }

    #[test]
    fn a_replaced_file_is_noticed() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("dpram");
        std::fs::write(&path, vec![0; BYTES]).unwrap();
        let board = FileBoard::open(&path, BYTES).unwrap();
        assert!(board.still_there());
        std::fs::write(directory.path().join("new"), vec![0; BYTES]).unwrap();
        std::fs::rename(directory.path().join("new"), &path).unwrap();
        assert!(!board.still_there());
        std::fs::remove_file(&path).unwrap();
        assert!(!board.still_there());
    }
}
