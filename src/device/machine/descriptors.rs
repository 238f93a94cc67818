//! Descriptors of this process: how many more the kernel gives it, and a way through one.

use std::os::fd::{AsRawFd, BorrowedFd};
use std::path::{Path, PathBuf};

use nix::sys::resource::{Resource, getrlimit};

/// What a process like this has open, where the kernel does not tell.
const USUAL: usize = 32;

/// Descriptors that may still be opened: the soft limit (`RLIMIT_NOFILE`) less those that are open.
#[must_use]
pub fn descriptors_left() -> usize {
    let limit = getrlimit(Resource::RLIMIT_NOFILE)
        .map_or(usize::MAX, |(soft, _)| usize::try_from(soft).unwrap_or(usize::MAX));
    let open = std::fs::read_dir("/proc/self/fd").map_or(USUAL, Iterator::count);
    limit.saturating_sub(open)
}

/// A path to `name` in a directory that is open, wherever that directory's own name leads by now.
#[must_use]
pub fn path_in(directory: BorrowedFd<'_>, name: &str) -> PathBuf {
    Path::new("/proc/self/fd").join(directory.as_raw_fd().to_string()).join(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_open_is_not_left() {
        let (soft, _) = getrlimit(Resource::RLIMIT_NOFILE).unwrap();
        let held: Vec<_> = (0..20).map(|_| std::fs::File::open("/dev/null").unwrap()).collect();
        assert!(descriptors_left() as u64 <= soft - held.len() as u64);
    }
}
