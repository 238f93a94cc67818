//! Process control that all programs of this package share (layer 0).

#[cfg(any(feature = "daemon", feature = "sim"))]
pub mod capabilities;
pub mod log_sink;

use std::io;
use std::os::fd::{AsRawFd, BorrowedFd};
use std::path::{Path, PathBuf};

use nix::sys::prctl::set_pdeathsig;
use nix::sys::signal::Signal;
use nix::unistd::{Pid, getppid};

#[cfg(any(feature = "cli", feature = "daemon", feature = "sim"))]
use {
    signal_hook::consts::SIGXFSZ,
    std::sync::{Arc, atomic::AtomicBool},
};

/// The kernel's directory of this process's open descriptors.
pub const DESCRIPTORS: &str = "/proc/self/fd";

/// A path to the open file of `descriptor`, even if it was renamed or never had a name.
#[must_use]
pub fn path_of(descriptor: BorrowedFd<'_>) -> PathBuf {
    Path::new(DESCRIPTORS).join(descriptor.as_raw_fd().to_string())
}

/// Has a panic of any thread end the process, once its message is out: no program goes on without one of its threads. (The
/// C libraries of this workspace catch a panic, so the compiler is not told that none unwinds.)
pub fn abort_on_panic() {
    let report = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        report(panic);
        std::process::abort();
    }));
}

/// Makes a write beyond the file size limit of this process (`ulimit -f`, `LimitFSIZE=`) an error of the write. By
/// default the kernel kills the process silently.
///
/// # Errors
/// The kernel's error.
#[cfg(any(feature = "cli", feature = "daemon", feature = "sim"))]
pub fn survive_file_size_limit() -> io::Result<()> {
    signal_hook::flag::register(SIGXFSZ, Arc::<AtomicBool>::default()).map(drop)
}

/// Has the kernel send SIGTERM to this process when its parent, process `parent`, ends for whatever reason.
///
/// # Errors
/// The kernel's error, or an error when `parent` has ended already.
pub fn end_with_parent(parent: u32) -> io::Result<()> {
    set_pdeathsig(Some(Signal::SIGTERM))?;
    if getppid() == Pid::from_raw(parent.cast_signed()) {
        Ok(())
    } else {
        Err(io::Error::other(format!("process {parent}, which this one was to end with, has ended")))
    }
}
