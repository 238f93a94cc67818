//! Where a board's command socket lies by default: one order for the daemon and its clients.

use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

use nix::unistd::geteuid;

/// The directory of the system's daemons, which root and the unit can make.
pub const SYSTEM: &str = "/run/pmacd";
/// The environment variable that names the directory of the user's own sockets.
pub const RUNTIME: &str = "XDG_RUNTIME_DIR";

/// The places of the socket of the board called `name`, best first: the system's, then the user's own.
#[must_use]
pub fn socket_places(name: &str) -> Vec<PathBuf> {
    let runtime = std::env::var_os(RUNTIME).map(PathBuf::from).filter(|path| is_own(path));
    places(Path::new(SYSTEM), runtime, name)
}

/// Whether a directory belongs to this user and no other user can write to it, as the XDG specification demands. The
/// environment may name another user's directory, for instance after `su`.
fn is_own(path: &Path) -> bool {
    path.metadata().is_ok_and(|found| {
        found.is_dir() && found.uid() == geteuid().as_raw() && found.permissions().mode() & 0o022 == 0
    })
}

fn places(system: &Path, runtime: Option<PathBuf>, name: &str) -> Vec<PathBuf> {
    // The XDG specification: ignore a path that is not absolute.
    let own = runtime.filter(|path| path.is_absolute()).map(|path| path.join("pmacd"));
    let socket = format!("{}.sock", name.trim_start_matches('/'));
    [Some(system.to_owned()), own].into_iter().flatten().map(|directory| directory.join(&socket)).collect()
}

/// Where a client finds the socket of the board called `name`: the first of its places that exists, else the system's.
#[must_use]
pub fn socket_path(name: &str) -> PathBuf {
    let places = socket_places(name);
    let first = places.first().cloned().unwrap_or_default();
    places.into_iter().find(|place| place.exists()).unwrap_or(first)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_system_comes_before_the_user() {
        let places = |runtime: Option<&str>| places(Path::new("/s"), runtime.map(PathBuf::from), "/pmac0");
        assert_eq!(places(None), [Path::new("/s/pmac0.sock")]);
        let both = [Path::new("/s/pmac0.sock"), Path::new("/run/user/7/pmacd/pmac0.sock")];
        assert_eq!(places(Some("/run/user/7")), both);
        assert_eq!(places(Some("relative")), [Path::new("/s/pmac0.sock")]);
    }

    #[test]
    fn a_directory_that_others_can_write_to_is_ignored() {
        let directory = tempfile::tempdir().unwrap();
        let with = |mode| {
            std::fs::set_permissions(directory.path(), PermissionsExt::from_mode(mode)).unwrap();
            is_own(directory.path())
        };
        assert!(with(0o700) && with(0o755));
        assert!(!with(0o777) && !with(0o720) && !with(0o702));
        assert!(!is_own(&directory.path().join("missing")));
        assert_eq!(is_own(Path::new("/")), geteuid().is_root(), "somebody else's");
    }
}
