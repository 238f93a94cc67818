//! Why the driver cannot open a board: one variant for each reason, with its cure.

use std::io;
use std::ops::Range;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use crate::device::system::System;
use crate::device::system::kernel::{Lockdown, may_do_raw_io};

/// A board, or a part of it, that the driver cannot open.
#[derive(Debug, thiserror::Error)]
#[error("cannot open {what}: {why}")]
pub struct OpenError {
    /// The part of the specification that failed.
    pub what: String,
    /// Why, and what to do.
    pub why: Why,
}

impl OpenError {
    /// The driver cannot open `what`, for the reason `why`.
    pub fn new(what: impl Into<String>, why: Why) -> Self {
        Self { what: what.into(), why }
    }
}

/// The reasons.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Why {
    /// The machine has no such node.
    #[error("there is no {path}; {cure}")]
    Missing {
        /// The file.
        path: PathBuf,
        /// What to do.
        cure: String,
    },
    /// The file's mode excludes this user.
    #[error("you may not read and write {path} ({}); {cure}", allowed.as_deref().unwrap_or("its mode cannot be seen"))]
    Permission {
        /// The file.
        path: PathBuf,
        /// Mode, owner and group.
        allowed: Option<String>,
        /// What to do.
        cure: &'static str,
    },
    /// Opening /dev/mem needs a capability.
    #[error(
        "the capability CAP_SYS_RAWIO is missing, and the kernel opens {0} only with it, whatever the mode; run as \
        root, give the service AmbientCapabilities=CAP_SYS_RAWIO, or have the service manager hand the descriptor \
        over (OpenFile=)"
    )]
    RawIo(PathBuf),
    /// The kernel is locked down.
    #[error(
        "the kernel is locked down (mode {0}, as with Secure Boot), which forbids {1}; reach the board through a UIO \
        driver, which stays allowed, or switch Secure Boot off"
    )]
    Lockdown(String, &'static str),
    /// The kernel refuses root with all capabilities.
    #[error(
        "the kernel refuses {0} although its mode and the capabilities allow it; in a service add DeviceAllow={0} rw \
        and PrivateDevices=no, in a container pass the device in"
    )]
    DeviceControl(PathBuf),
    /// STRICT_DEVMEM.
    #[error(
        "{} lies in main memory, which the kernel (STRICT_DEVMEM) does not map; the address is not that of the \
        board's window",
        span(.0)
    )]
    MainMemory(Range<u64>),
    /// IO_STRICT_DEVMEM.
    #[error(
        "{} is claimed by {by}, and the kernel (IO_STRICT_DEVMEM) refuses everybody else; unbind that driver, use a \
        UIO driver, or boot with iomem=relaxed",
        span(range)
    )]
    Claimed {
        /// The physical addresses requested.
        range: Range<u64>,
        /// The driver or device that claims them.
        by: String,
    },
    /// STRICT_DEVMEM or IO_STRICT_DEVMEM.
    #[error(
        "the kernel refuses {}: it is main memory (STRICT_DEVMEM) or claimed by a driver (IO_STRICT_DEVMEM); \
        root sees which in /proc/iomem",
        span(.0)
    )]
    Restricted(Range<u64>),
    /// The range lies beyond the processor's addresses, or is mapped elsewhere with another caching.
    #[error(
        "the kernel cannot map {}: no such physical address on this machine, or it is mapped elsewhere with another \
        caching",
        span(.0)
    )]
    NotMappable(Range<u64>),
    /// An inherited descriptor, or a device, does not serve as this board.
    #[error("{0}")]
    Unsuitable(String),
    /// Any other error.
    #[error("{doing}: {source}")]
    Io {
        /// The operation that failed.
        doing: String,
        /// The kernel's error.
        source: io::Error,
    },
}

fn span(range: &Range<u64>) -> String {
    format!("{:#x} to {:#x}", range.start, range.end.saturating_sub(1))
}

/// Why the kernel did not open the node at `path` for reading and writing; `missing` and `permission` are the cures.
#[must_use]
pub fn node_refused(
    system: &System,
    path: &Path,
    error: io::Error,
    missing: &str,
    permission: &'static str,
) -> Why {
    let path_buf = path.to_owned();
    match error.raw_os_error() {
        Some(libc::ENOENT) => Why::Missing { path: path_buf, cure: missing.to_owned() },
        Some(libc::EACCES) => {
            Why::Permission { path: path_buf, allowed: allowed(&system.path(path)), cure: permission }
        }
        Some(libc::EPERM) => Why::DeviceControl(path_buf),
        Some(libc::EBUSY) => Why::Unsuitable(format!(
            "{} is in use by another program; a board has one host: stop that one first",
            path.display()
        )),
        _ => Why::Io { doing: format!("opening {}", path.display()), source: error },
    }
}

/// Why the kernel did not open /dev/mem, or the node of the I/O ports, at `path`.
#[must_use]
pub fn raw_node_refused(system: &System, path: &Path, error: io::Error) -> Why {
    if error.raw_os_error() == Some(libc::EPERM) {
        return match Lockdown::of(system).mode() {
            Some(mode) => Why::Lockdown(mode.to_owned(), "raw access to memory and ports"),
            None if !may_do_raw_io(system) => Why::RawIo(path.to_owned()),
            None => Why::DeviceControl(path.to_owned()),
        };
    }
    let missing = "the kernel was built without it (CONFIG_DEVMEM, CONFIG_DEVPORT), or the service has \
        PrivateDevices=yes: let the service manager hand the descriptor over (OpenFile=), or use a UIO driver";
    let permission = "run as root, give the service AmbientCapabilities=CAP_SYS_RAWIO CAP_DAC_OVERRIDE, or have the \
        service manager hand the descriptor over (OpenFile=); do not widen the node's mode";
    node_refused(system, path, error, missing, permission)
}

/// Mode, owner and group of a file, in words.
#[must_use]
pub fn allowed(path: &Path) -> Option<String> {
    let metadata = std::fs::metadata(path).ok()?;
    let user = nix::unistd::User::from_uid(metadata.uid().into()).ok().flatten();
    let group = nix::unistd::Group::from_gid(metadata.gid().into()).ok().flatten();
    Some(format!(
        "mode {:04o}, user {}, group {}",
        metadata.mode() & 0o7777,
        user.map_or_else(|| metadata.uid().to_string(), |user| user.name),
        group.map_or_else(|| metadata.gid().to_string(), |group| group.name),
    ))
}
