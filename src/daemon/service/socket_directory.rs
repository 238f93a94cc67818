//! The directory of the command socket: the daemon makes a missing directory, and chooses a directory if the
//! configuration names none.

use std::fs::DirBuilder;
use std::io;
use std::os::unix::fs::{DirBuilderExt, chown};
use std::path::{Path, PathBuf};

use nix::fcntl::{AT_FDCWD, AtFlags};
use nix::unistd::{AccessFlags, faccessat};

use super::privilege::Account;
use crate::daemon::exit::{Failure, NO_PERMISSION};
use crate::daemon::socket::listener::DIRECTORY_MODE;
use crate::protocol::socket_place::RUNTIME;

/// The socket's path, in an existing directory: the path `told`, or else the first usable of the `usual` places. A
/// directory that the daemon makes belongs to `account`, the user that root becomes.
///
/// # Errors
/// No place is usable; why, and the cure.
pub fn prepare(
    told: Option<&Path>,
    usual: &[PathBuf],
    account: Option<&Account>,
) -> Result<PathBuf, Failure> {
    if let Some(path) = told {
        if account.is_some() {
            make(path, account).map_err(|error| Failure::system(&path.display().to_string(), error))?;
        }
        return Ok(path.to_owned());
    }
    let mut refused = Vec::new();
    for path in usual {
        match make(path, account) {
            Ok(()) => return Ok(path.clone()),
            Err(error) => refused.push(format!("{}: {error}", path.display())),
        }
    }
    let reason = format!(
        "no place for the command socket: {}; write --socket PATH, or set {RUNTIME} to a directory of your own",
        refused.join("; ")
    );
    Err(Failure::new(NO_PERMISSION, reason))
}

/// Makes the directory of `path` if it is missing, and checks that it can hold a socket.
fn make(path: &Path, account: Option<&Account>) -> io::Result<()> {
    let Some(directory) = path.parent().filter(|directory| !directory.as_os_str().is_empty()) else {
        return Ok(());
    };
    match DirBuilder::new().mode(DIRECTORY_MODE).create(directory) {
        Ok(()) => {
            if let Some(account) = account {
                chown(directory, Some(account.uid.as_raw()), Some(account.gid.as_raw()))?;
            }
        }
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
        Err(error) => return Err(error),
    }
    let rights = AccessFlags::W_OK | AccessFlags::X_OK;
    Ok(faccessat(AT_FDCWD, directory, rights, AtFlags::AT_EACCESS)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_place_that_can_be_made_is_taken() {
        let directory = tempfile::tempdir().unwrap();
        let own = directory.path().join("run/pmac0.sock");
        // Not even root can make a directory there.
        let system = PathBuf::from("/proc/pmacd/pmac0.sock");
        assert_eq!(prepare(None, &[system.clone(), own.clone()], None).unwrap(), own);
        assert!(own.parent().unwrap().is_dir());
        let both = [own.clone(), directory.path().join("other/pmac0.sock")];
        assert_eq!(prepare(None, &both, None).unwrap(), own, "what is there already is used");
        assert!(!both[1].parent().unwrap().exists());
        let failure = prepare(None, &[system], None).unwrap_err();
        assert_eq!(failure.status, NO_PERMISSION);
        assert!(failure.reason.contains("/proc/pmacd/pmac0.sock: ") && failure.reason.contains("--socket"));
        let told = Path::new("/nonexistent/x.sock");
        assert_eq!(prepare(Some(told), &[], None).unwrap(), told);
    }
}
