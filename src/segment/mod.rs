//! The shared-memory segment (layer 4): how a daemon publishes its mirror and how clients read it.
//!
//! One writer serves any number of readers. They map the segment read-only and exchange no messages with the daemon.
//! Each region is a ring of slots with a sequence number per slot. So a writer stopped or killed in mid-write never
//! blocks a reader, reads are bounded, and a reader that keeps up misses nothing; a slower reader knows exactly how
//! many samples it lost.
//!
//! | file | content |
//! |---|---|
//! | [`layout`] | **the ABI, field by field** (`docs/segment.md`): enough to write a reader in C or Python |
//! | [`payload`] | the content of a sample of each region |
//! | [`name`] | the allowed names of segments, and the lock on a name |
//! | [`ring`] | the slot-ring protocol, over any memory (shared, or a model checker's) |
//! | `memory` | mapping, words, futex |
//! | `wide_copy` | the vector copy of a slot, and the argument for it; with `memory` the only unsafe code |
//! | [`freshness`] | the one rule for which data are live |
//! | [`publish`], [`subscribe`] | writer and reader |
//! | `placement`, `header` | places everything in a new segment; checks the header of an existing one |
//! | `info`, `counter` | the header's facts about the segment and its regions; the daemon's counters |
//! | `region_reader`, `cursor`, `sample` | reading a region; following its samples; one sample's copy |
//! | `lock` | the owner of a name |
//! | `keeper`, `object`, `newborn` | keeps the names leading to their files; a segment's file, before and after it gets its name |

use std::io;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

mod counter;
mod cursor;
pub mod freshness;
mod header;
mod info;
mod keeper;
pub mod layout;
mod lock;
mod memory;
pub mod name;
mod newborn;
mod object;
pub mod payload;
mod placement;
pub mod publish;
mod region_reader;
pub mod ring;
mod sample;
pub mod subscribe;
mod wide_copy;

/// CLOCK_MONOTONIC in ns: the clock of a segment, unless the segment has its own ([`ClockKind::Own`]).
pub use crate::clock::monotonic_ns;
pub use counter::Counter;
pub use cursor::Cursor;
pub use freshness::Staleness;
pub use info::{Condition, HeaderInfo, RegionInfo};
pub use keeper::Keeper;
pub use layout::{ClockKind, RegionId, RegionState, State};
#[cfg(all(test, feature = "client"))]
pub(crate) use lock::KERNEL_ASKED;
pub use lock::is_trusted;
#[cfg(feature = "daemon")]
pub(crate) use lock::{FileId, file_at};
pub use memory::end_on_bus_error;
pub use name::SegmentName;
pub use payload::blocks::BlockPlace;
pub use payload::identity::{self, Identity, UserUnit};
pub use placement::{CreateOptions, RegionSpec};
pub use publish::{Counters, Publisher};
pub use region_reader::Read;
pub use sample::{Sample, Stamp};
pub use subscribe::{Subscriber, WaitOutcome};

/// The directory of segments, that of POSIX shared-memory objects. A test may use another.
pub const DIRECTORY: &str = "/dev/shm";

/// Errors of a segment. Every message says what is wrong, where, and what to do.
#[derive(Debug, thiserror::Error)]
pub enum SegmentError {
    /// The name is not allowed for a segment.
    #[error(
        "{name:?} cannot be a segment's name: {why}; use up to 64 letters, digits, '.', '_' or '-', as in pmac0"
    )]
    Name {
        /// The name given.
        name: String,
        /// The rule that it breaks.
        why: &'static str,
    },
    /// The requested regions cannot be laid out.
    #[error("the segment cannot be laid out: {0}")]
    Spec(String),
    /// Another live process owns the name.
    #[error("{} is in use by {}; stop that process or choose another --name", path.display(), holder(*pid))]
    InUse {
        /// The lock file.
        path: PathBuf,
        /// The process that holds it, if known.
        pid: Option<u32>,
    },
    /// Another user owns an object of this name.
    #[error(
        "{} belongs to user {uid}, who is not trusted here; have it removed, or choose another --name",
        path.display()
    )]
    ForeignOwner {
        /// The object in the way.
        path: PathBuf,
        /// Its owner.
        uid: u32,
    },
    /// Another program made the object in the way.
    #[error("{} is in the way: {why}. It is left alone: move it away, or choose another --name", path.display())]
    Occupied {
        /// The object in the way.
        path: PathBuf,
        /// Why it is not replaced.
        why: &'static str,
    },
    /// Other users may write to the object.
    #[error("{} can be written by others than its owner (mode {mode:03o}); it must not be: chmod go-w", path.display())]
    WritableByOthers {
        /// The object.
        path: PathBuf,
        /// Its permission bits.
        mode: u32,
    },
    /// No segment has this name.
    #[error("there is no segment {}; is pmacd running under this --name?", path.display())]
    NotFound {
        /// The path searched.
        path: PathBuf,
    },
    /// There is not enough memory for the segment.
    #[error(
        "there is no room for the {bytes} bytes of {}: {source}; free some memory in that file system, or raise the limit of a \
         file's size (ulimit -f, LimitFSIZE=)",
        path.display()
    )]
    Full {
        /// The object to be created.
        path: PathBuf,
        /// Its size in bytes.
        bytes: u64,
        /// The kernel's error.
        source: io::Error,
    },
    /// The publishing thread did not go on in the new file in time.
    #[error("{} is gone, and the thread that publishes makes no rounds in which to publish it again", path.display())]
    NotMoved {
        /// The segment's file.
        path: PathBuf,
    },
    /// A file operation failed.
    #[error("cannot {what} {}: {source}", path.display())]
    Io {
        /// The operation that failed.
        what: &'static str,
        /// The file.
        path: PathBuf,
        /// The kernel's error.
        source: io::Error,
    },
    /// The object is no segment, is truncated, or has a header that contradicts itself.
    #[error("{} is not a usable segment: {why}; restart pmacd", path.display())]
    Malformed {
        /// The object.
        path: PathBuf,
        /// The fault.
        why: String,
    },
    /// A daemon of another ABI version wrote the segment.
    #[error(
        "{} has layout version {found}, this program reads version {}; use programs of one release",
        path.display(), layout::ABI_MAJOR
    )]
    Version {
        /// The object.
        path: PathBuf,
        /// Its major version.
        found: u64,
    },
    /// The segment does not hold that region.
    #[error("the segment holds no {} region; the daemon does not mirror it", .0.name())]
    NoSuchRegion(RegionId),
    /// The writer overtook every attempt to read: this process gets too little processor time.
    #[error(
        "the {} region was overwritten during each of {attempts} attempts to read it; this process gets too little \
        processor time",
        region.name()
    )]
    Overrun {
        /// The region.
        region: RegionId,
        /// Number of attempts.
        attempts: u32,
    },
    /// A slot that no publisher writes.
    #[error("sample {sequence} of the {} region is corrupt; restart pmacd", region.name())]
    Corrupt {
        /// The region.
        region: RegionId,
        /// The sample's number.
        sequence: u64,
    },
    /// A cursor met another segment than its own.
    #[error("the cursor belongs to generation {cursor} of the segment, not to {segment}; make a new one")]
    OtherGeneration {
        /// The cursor's generation.
        cursor: u64,
        /// The segment's generation.
        segment: u64,
    },
}

fn holder(pid: Option<u32>) -> String {
    pid.map_or_else(|| "another process".to_owned(), |pid| format!("process {pid}"))
}

impl SegmentError {
    fn io(what: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { what, path, source }
    }
}

/// CLOCK_REALTIME in nanoseconds. The standard library's time has 64 bits, even where the C library's ends in 2038.
fn realtime_ns() -> u64 {
    let now = UNIX_EPOCH.elapsed().unwrap_or_default();
    u64::try_from(now.as_nanos()).unwrap_or(u64::MAX)
}
