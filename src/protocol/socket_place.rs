//! Where a board's command socket lies unless it was told: one order for the daemon and for its clients.

use std::path::{Path, PathBuf};

/// The directory of the system's daemons, which root and the unit can make.
pub const SYSTEM: &str = "/run/pmacd";
/// The environment's name for the directory of the user's own sockets.
pub const RUNTIME: &str = "XDG_RUNTIME_DIR";

/// The places of the socket of the board called `name`, best first: the system's, then the user's own.
#[must_use]
pub fn socket_places(name: &str) -> Vec<PathBuf> {
    places(Path::new(SYSTEM), std::env::var_os(RUNTIME).map(PathBuf::from), name)
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
}
