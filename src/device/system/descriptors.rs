//! How many more descriptors this process may open.

use nix::sys::resource::{Resource, getrlimit, setrlimit};

use crate::process::DESCRIPTORS;

/// Descriptors that such a process has open, where the kernel does not say.
const USUAL: usize = 32;

/// Raises the limit of open descriptors to the hard limit.
pub fn allow_descriptors() {
    if let Ok((soft, hard)) = getrlimit(Resource::RLIMIT_NOFILE)
        && soft < hard
    {
        let _ = setrlimit(Resource::RLIMIT_NOFILE, hard, hard);
    }
}

/// How many more descriptors may be opened: the soft limit (`RLIMIT_NOFILE`) minus the open ones.
#[must_use]
pub fn descriptors_left() -> usize {
    let limit = getrlimit(Resource::RLIMIT_NOFILE)
        .map_or(usize::MAX, |(soft, _)| usize::try_from(soft).unwrap_or(usize::MAX));
    let open = std::fs::read_dir(DESCRIPTORS).map_or(USUAL, Iterator::count);
    limit.saturating_sub(open)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_open_is_not_left() {
        let (soft, _) = getrlimit(Resource::RLIMIT_NOFILE).unwrap();
        let held: Vec<_> = (0..20).map(|_| std::fs::File::open("/dev/null").unwrap()).collect();
        assert!(descriptors_left() + held.len() <= usize::try_from(soft).unwrap());
    }
}
