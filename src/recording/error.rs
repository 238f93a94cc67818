//! Why a program cannot read or write a recording.

use std::io;
use std::path::PathBuf;

/// Why this program cannot read or write a recording.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordingError {
    /// The file system refuses the access.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or directory.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A file is damaged.
    #[error("{}:{line}: {what}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// The fault.
        what: String,
    },
    /// A file is no part of a recording that this program reads.
    #[error("{}: {what}", path.display())]
    Unfit {
        /// The file or directory.
        path: PathBuf,
        /// The fault.
        what: String,
    },
}

impl RecordingError {
    /// The file system refuses at `path`.
    pub(super) fn io(path: impl Into<PathBuf>) -> impl FnOnce(io::Error) -> Self {
        let path = path.into();
        |source| Self::Io { path, source }
    }
}
