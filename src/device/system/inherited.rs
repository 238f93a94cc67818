//! Descriptors handed over by the service manager: `LISTEN_PID`, `LISTEN_FDS`, `LISTEN_FDNAMES` (sd_listen_fds(3)).
//!
//! With `OpenFile=/dev/mem:mem` systemd opens the node, and the daemon needs no privilege. A descriptor named `mem`,
//! `uio` or `cpu_latency` replaces opening the node of that kind.

use std::fs::File;
use std::os::fd::{OwnedFd, RawFd};

use crate::device::mapping;

/// The first descriptor that can be handed over.
const FIRST: RawFd = 3;
/// Most descriptors to accept; further ones are ignored.
const MOST_DESCRIPTORS: usize = 32;

/// The environment variables that announce descriptors; child programs must not see them.
pub const VARIABLES: [&str; 3] = ["LISTEN_PID", "LISTEN_FDS", "LISTEN_FDNAMES"];

/// The descriptors handed over, closed on drop. Drop it when the board is open: `/dev/mem` gives access to all of the
/// machine's memory.
#[derive(Debug, Default)]
pub struct Inherited(Vec<(String, OwnedFd)>);

impl Inherited {
    /// Takes the descriptors handed over to this process; a second call gets none. Child programs do not inherit them.
    #[must_use]
    pub fn take_all() -> Self {
        let [pid, count, names] = VARIABLES.map(|name| std::env::var(name).unwrap_or_default());
        let announced = announced(&pid, &count, &names, std::process::id());
        let taken =
            announced.into_iter().filter_map(|(number, name)| Some((name, mapping::inherited(number)?)));
        Self(taken.collect())
    }

    /// Holds these descriptors, for tests.
    #[must_use]
    pub fn of(descriptors: Vec<(String, OwnedFd)>) -> Self {
        Self(descriptors)
    }

    /// A duplicate of the first descriptor of this name, so that window and registers can both have one.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<File> {
        self.find_if(name, |_| true)
    }

    /// The first descriptor of this name that `suits` accepts.
    #[must_use]
    pub fn find_if(&self, name: &str, suits: impl Fn(&File) -> bool) -> Option<File> {
        let named = self.0.iter().filter(|(found, _)| found == name);
        named.filter_map(|(_, descriptor)| descriptor.try_clone().ok()).map(File::from).find(suits)
    }
}

/// The descriptors announced to process `own`, with their names.
fn announced(pid: &str, count: &str, names: &str, own: u32) -> Vec<(RawFd, String)> {
    if pid.parse() != Ok(own) {
        return Vec::new();
    }
    let count = count.parse().unwrap_or(0).min(MOST_DESCRIPTORS);
    let mut names = names.split(':');
    (FIRST..).take(count).map(|number| (number, names.next().unwrap_or_default().to_owned())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_was_announced_to_this_very_process_is_taken() {
        let named = |number, name: &str| (number, name.to_owned());
        assert_eq!(announced("7", "2", "mem:uio", 7), [named(3, "mem"), named(4, "uio")]);
        assert_eq!(announced("7", "2", "mem", 7), [named(3, "mem"), named(4, "")]);
        for (pid, count, own) in [("7", "2", 8), ("", "2", 7), ("7", "", 7), ("7", "-1", 7), ("7", "many", 7)]
        {
            assert_eq!(announced(pid, count, "mem:uio", own), []);
        }
        assert_eq!(announced("7", "4000000", "", 7).len(), MOST_DESCRIPTORS);
    }

    #[test]
    fn a_descriptor_is_found_by_name_and_by_what_it_is() {
        let (short, long) = (tempfile::tempfile().unwrap(), tempfile::tempfile().unwrap());
        long.set_len(7).unwrap();
        let inherited =
            Inherited::of(vec![("uio".to_owned(), short.into()), ("uio".to_owned(), long.into())]);
        let length = |file: &File| file.metadata().unwrap().len();
        assert!(inherited.find("mem").is_none());
        assert_eq!(inherited.find("uio").as_ref().map(length), Some(0));
        assert_eq!(inherited.find_if("uio", |file| length(file) == 7).as_ref().map(length), Some(7));
        assert!(inherited.find_if("uio", |file| length(file) == 8).is_none());
    }
}
