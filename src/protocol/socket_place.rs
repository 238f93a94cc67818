//! Where a board's command socket lies unless it was told: one order for the daemon and for its clients.

use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

use nix::unistd::geteuid;

/// The directory of the system's daemons, which root and the unit can make.
pub const SYSTEM: &str = "/run/pmacd";
/// The environment's name for the directory of the user's own sockets.
pub const RUNTIME: &str = "XDG_RUNTIME_DIR";

/// The places of the socket of the board called `name`, best first: the system's, then the user's own.
#[must_use]
pub fn socket_places(name: &str) -> Vec<PathBuf> {
    let runtime = std::env::var_os(RUNTIME).map(PathBuf::from).filter(|path| is_own(path));
    places(Path::new(SYSTEM), runtime, name)
}

/// Whether a directory is this user's and nobody else can write to it, as the XDG specification wants it. Another one may have come
/// along with the environment, as by `su`.
fn is_own(path: &Path) -> bool {
    path.metadata().is_ok_and(|found| {
        found.is_dir() && found.uid() == geteuid().as_raw() && found.permissions().mode() & 0o022 == 0
    })
}

fn places(system: &Path, runtime: Option<PathBuf>, name: &str) -> Vec<PathBuf> {
    // The XDG specification: a path that is not absolute is to be ignored.
    let own = runtime.filter(|path| path.is_absolute()).map(|path| path.join("pmacd"));
    let socket = format!("{}.sock", name.trim_start_matches('/'));
    [Some(system.to_owned()), own].into_iter().flatten().map(|directory| directory.join(&socket)).collect()
}

/// Where a client finds the socket of the board called `name`: the first of its places that is there, else the system's.
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
