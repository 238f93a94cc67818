//! The directory that a simulator makes for its daemon, `PREFIX-PID-TIME`, and the directories of simulators that were
//! killed together with their daemons: no process was left to remove those, so the next simulator does.

use std::fs::{self, DirBuilder, DirEntry, OpenOptions};
use std::io;
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::Path;

use nix::errno::Errno;
use nix::fcntl::{Flock, FlockArg};
use nix::sys::signal::kill;
use nix::unistd::{Pid, geteuid};

/// Makes `directory`, and removes its neighbours that no process uses any more.
///
/// # Errors
/// The system's error, when the directory cannot be made. A directory that cannot be removed stays.
pub(super) fn make(directory: &Path) -> io::Result<()> {
    DirBuilder::new().mode(0o700).create(directory)?;
    let own = directory.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let (Some(parent), Some((prefix, _))) = (directory.parent(), split(&own)) else { return Ok(()) };
    for entry in fs::read_dir(parent).into_iter().flatten().flatten() {
        if is_left(&entry, prefix) {
            let _ = fs::remove_dir_all(entry.path());
        }
    }
    Ok(())
}

/// The prefix of a directory's name, and the process that its simulator ends with.
fn split(name: &str) -> Option<(&str, i32)> {
    let (begin, time) = name.rsplit_once('-')?;
    let (prefix, pid) = begin.rsplit_once('-')?;
    let pid = pid.parse().ok().filter(|pid| *pid > 0)?;
    time.bytes().all(|digit| digit.is_ascii_digit()).then_some((prefix, pid))
}

/// Whether the directory is of a simulator of this user that has ended, and its daemon too.
fn is_left(entry: &DirEntry, prefix: &str) -> bool {
    let name = entry.file_name();
    let Some((found, pid)) = name.to_str().and_then(split) else { return false };
    let is_own =
        entry.metadata().is_ok_and(|metadata| metadata.is_dir() && metadata.uid() == geteuid().as_raw());
    let daemon_has_ended = kill(Pid::from_raw(pid), None) == Err(Errno::ESRCH);
    found == prefix && is_own && daemon_has_ended && !is_locked(&entry.path().join("dpram"))
}

/// Whether a simulator holds its memory. The number of a daemon in another container means nothing here.
fn is_locked(memory: &Path) -> bool {
    let file = OpenOptions::new().read(true).open(memory);
    file.is_ok_and(|file| Flock::lock(file, FlockArg::LockExclusiveNonblock).is_err())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::board::dpram::open_shared;

    #[test]
    fn only_directories_whose_daemon_and_simulator_have_ended_are_removed() {
        let place = tempfile::tempdir().unwrap();
        let at = |name: &str| place.path().join(name);
        // No process has the highest number.
        let (dead, live) = (i32::MAX, std::process::id());
        let [left, empty, locked, used] = [
            at(&format!("pmac-sim-{dead}-1")),
            at(&format!("pmac-sim-{dead}-2")),
            at(&format!("pmac-sim-{dead}-3")),
            at(&format!("pmac-sim-{live}-4")),
        ];
        let strange = [at("pmac-sim-x-5"), at(&format!("other-{dead}-6")), at("pmac-sim")];
        for directory in [&left, &empty, &locked, &used].into_iter().chain(&strange) {
            fs::create_dir(directory).unwrap();
        }
        for directory in [&left, &used] {
            fs::write(directory.join("dpram"), "").unwrap();
            fs::write(directory.join("serial"), "").unwrap();
        }
        let _lock = open_shared(&locked.join("dpram"), 16).unwrap();
        let own = at(&format!("pmac-sim-{live}-7"));
        make(&own).unwrap();
        assert!(!left.exists() && !empty.exists());
        assert!([&locked, &used, &own].into_iter().chain(&strange).all(|directory| directory.exists()));
    }
}
