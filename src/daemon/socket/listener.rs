//! The command socket's place in the file system. The daemon makes the socket's file with mode and group complete,
//! takes the place over from a dead daemon but never from a living one, and removes the file at the end.

use std::fs::{DirBuilder, File};
use std::io;
use std::os::fd::AsFd;
use std::os::unix::fs::{DirBuilderExt, FileTypeExt, MetadataExt, OpenOptionsExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::time::Instant;

use log::warn;
use nix::fcntl::{AT_FDCWD, AtFlags, OFlag, renameat};
use nix::sys::stat::{FchmodatFlags, Mode, fchmodat};
use nix::unistd::{Gid, UnlinkatFlags, fchownat, unlinkat};

use super::policy::{PolicyError, group_id};
use crate::process::path_of;
use crate::protocol::transport::connect;
use crate::segment::{FileId, file_at};

/// The mode of a directory that the daemon makes for the socket.
pub const DIRECTORY_MODE: u32 = 0o755;

/// The daemon cannot put the socket in its place.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ListenError {
    /// A living daemon answers at the path.
    #[error("{0}: another daemon serves this socket; stop it, or choose another --name or --socket")]
    Served(PathBuf),
    /// The path is not a socket, so the daemon does not delete it.
    #[error("{0}: exists and is not a socket; move it away or choose another --socket")]
    Foreign(PathBuf),
    /// The daemon cannot look up the group in the settings.
    #[error("{path}: {source}")]
    Group {
        /// The socket.
        path: PathBuf,
        /// The fault of the group.
        source: PolicyError,
    },
    /// The file system or the kernel refused.
    #[error("{path}: {action}: {source}")]
    Io {
        /// The socket's path.
        path: PathBuf,
        /// The daemon's action that failed.
        action: &'static str,
        /// The kernel's error.
        source: io::Error,
    },
}

/// A listening socket, and its file, which the daemon removes together with the socket.
#[derive(Debug)]
pub struct Listener {
    socket: UnixListener,
    file: Option<OwnFile>,
}

#[derive(Debug)]
struct OwnFile {
    path: PathBuf,
    mode: u32,
    group: Option<String>,
    made: FileId,
}

impl OwnFile {
    /// Whether the path still leads to this file. While the socket listens, the kernel gives no other file its number.
    fn is_in_place(&self) -> bool {
        file_at(&self.path) == Some(self.made)
    }
}

impl Drop for OwnFile {
    fn drop(&mut self) {
        // Removes only the daemon's own file: a successor may have put another file at the path.
        if self.is_in_place() {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

/// A directory beside the socket's place, which only this user may enter. The daemon makes the socket in this
/// directory, so nobody finds the socket with the wrong mode or group. The move into place replaces a dead daemon's
/// file in one step.
///
/// The daemon reaches the directory by its descriptor, not by its name. A user who may write to the parent directory
/// could put a link under any name there, and so have root change the mode of a file of that user's choice.
struct Workshop {
    name: PathBuf,
    directory: File,
}

/// The socket's name in that directory.
const SOCKET: &str = "s";
/// How many names the daemon tries: it passes over a name that a dead process of the same number has left.
const NAMES: u32 = 16;

impl Workshop {
    fn beside(path: &Path) -> io::Result<Self> {
        let name = |attempt: u32| {
            let mut name = path.as_os_str().to_owned();
            name.push(format!(".{}.{attempt}", std::process::id()));
            PathBuf::from(name)
        };
        let mut made = Err(io::ErrorKind::AlreadyExists.into());
        for name in (0..NAMES).map(name) {
            made = DirBuilder::new().mode(0o700).create(&name).map(|()| name);
            if !made.as_ref().is_err_and(|error| error.kind() == io::ErrorKind::AlreadyExists) {
                break;
            }
        }
        let name = made?;
        let flags = OFlag::O_PATH | OFlag::O_DIRECTORY | OFlag::O_NOFOLLOW | OFlag::O_CLOEXEC;
        let directory = File::options().read(true).custom_flags(flags.bits()).open(&name)?;
        let workshop = Self { name, directory };
        let found = workshop.directory.metadata()?;
        if found.uid() != nix::unistd::geteuid().as_raw() || found.mode() & 0o077 != 0 {
            return Err(io::Error::other("somebody put another directory in its place"));
        }
        Ok(workshop)
    }

    fn bind(&self) -> io::Result<UnixListener> {
        UnixListener::bind(self.socket())
    }

    fn socket(&self) -> PathBuf {
        path_of(self.directory.as_fd()).join(SOCKET)
    }

    /// Sets the socket's mode and group; returns the file's identity.
    fn finish(&self, mode: u32, group: Option<Gid>) -> io::Result<FileId> {
        let made = self.socket().symlink_metadata()?;
        // A service may be forbidden this call, so the daemon makes it only if the group differs.
        if let Some(group) = group.filter(|group| group.as_raw() != made.gid()) {
            fchownat(&self.directory, SOCKET, None, Some(group), AtFlags::AT_SYMLINK_NOFOLLOW)?;
        }
        fchmodat(&self.directory, SOCKET, Mode::from_bits_truncate(mode), FchmodatFlags::FollowSymlink)?;
        Ok(FileId::of(&made))
    }

    fn move_to(&self, path: &Path) -> io::Result<()> {
        Ok(renameat(&self.directory, SOCKET, AT_FDCWD, path)?)
    }
}

impl Drop for Workshop {
    fn drop(&mut self) {
        let _ = unlinkat(&self.directory, SOCKET, UnlinkatFlags::NoRemoveDir);
        let _ = std::fs::remove_dir(&self.name);
    }
}

impl Listener {
    /// Listens at `path` with the given mode and, when named, group. Replaces a socket that a dead daemon has left.
    ///
    /// The segment's lock keeps two daemons apart that start at once: each takes the lock before this call.
    ///
    /// # Errors
    /// [`ListenError`]; the daemon has then left the file at `path` alone.
    pub fn bind(path: &Path, mode: u32, group: Option<&str>) -> Result<Self, ListenError> {
        let fault = |action| move |source| ListenError::Io { path: path.to_owned(), action, source };
        match path.symlink_metadata() {
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            Err(error) => return Err(fault("looking whether it exists")(error)),
            Ok(found) if !found.file_type().is_socket() => return Err(ListenError::Foreign(path.to_owned())),
            Ok(_) => match connect(path, Instant::now()) {
                Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => {}
                Ok(_) => return Err(ListenError::Served(path.to_owned())),
                // The backlog is full: the daemon there is stopped, but lives.
                Err(error) if error.kind() == io::ErrorKind::TimedOut => {
                    return Err(ListenError::Served(path.to_owned()));
                }
                Err(error) => return Err(fault("asking whether a daemon serves it")(error)),
            },
        }
        let group_number = group.map(group_id).transpose();
        let group_number =
            group_number.map_err(|source| ListenError::Group { path: path.to_owned(), source })?;

        let workshop = Workshop::beside(path).map_err(fault("making a directory to create the socket in"))?;
        let socket = workshop.bind().map_err(fault("creating the socket"))?;
        let made = workshop.finish(mode, group_number).map_err(fault("setting its mode and group"))?;
        workshop.move_to(path).map_err(fault("moving the socket into place"))?;
        let file = OwnFile { path: path.to_owned(), mode, group: group.map(str::to_owned), made };
        socket.set_nonblocking(true).map_err(fault("preparing the socket"))?;
        Ok(Self { socket, file: Some(file) })
    }

    /// Makes the socket's file again, and listens there, if the path no longer leads to the file: anybody with the
    /// right to the directory may have removed, renamed or replaced the file. The server calls this now and then, when
    /// no connection waits.
    ///
    /// # Errors
    /// As [`Listener::bind`]; the old socket then goes on listening.
    pub(super) fn keep(&mut self) -> Result<(), ListenError> {
        let Some(OwnFile { path, mode, group, .. }) = self.file.as_ref().filter(|file| !file.is_in_place())
        else {
            return Ok(());
        };
        if let Some(directory) = path.parent() {
            // The directory may be gone, too. If the daemon cannot make it, the next step says why.
            let _ = DirBuilder::new().mode(DIRECTORY_MODE).create(directory);
        }
        let made = Self::bind(path, *mode, group.as_deref())?;
        warn!("{} was removed, renamed or replaced by somebody; listening there again", path.display());
        *self = made;
        Ok(())
    }

    /// Takes a listening socket that the service manager made and will remove.
    ///
    /// # Errors
    /// The kernel does not make the socket non-blocking.
    pub fn inherited(socket: UnixListener) -> io::Result<Self> {
        socket.set_nonblocking(true)?;
        Ok(Self { socket, file: None })
    }

    /// The socket's path, if the daemon has made the file itself.
    #[must_use]
    pub fn path(&self) -> Option<&Path> {
        self.file.as_ref().map(|file| file.path.as_path())
    }

    /// The next connection, non-blocking, or `WouldBlock`.
    pub(super) fn accept(&self) -> io::Result<UnixStream> {
        let (stream, _) = self.socket.accept()?;
        stream.set_nonblocking(true)?;
        Ok(stream)
    }
}

impl AsFd for Listener {
    fn as_fd(&self) -> std::os::fd::BorrowedFd<'_> {
        self.socket.as_fd()
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    fn mode(path: &Path) -> u32 {
        path.symlink_metadata().unwrap().mode() & 0o7777
    }

    #[test]
    fn the_file_has_its_mode_and_goes_with_the_listener() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("pmac0.sock");
        let listener = Listener::bind(&path, 0o660, None).unwrap();
        assert_eq!(mode(&path), 0o660);
        assert_eq!(listener.path(), Some(path.as_path()));
        drop(listener);
        assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_dead_daemons_socket_is_replaced_and_a_living_ones_is_not() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("pmac0.sock");
        drop(UnixListener::bind(&path).unwrap());
        let first = Listener::bind(&path, 0o600, None).unwrap();
        assert!(matches!(Listener::bind(&path, 0o600, None), Err(ListenError::Served(_))));
        // Somebody replaces the file: the first listener may no longer remove it.
        std::fs::remove_file(&path).unwrap();
        let second = Listener::bind(&path, 0o600, None).unwrap();
        drop(first);
        assert!(path.exists());
        drop(second);
        assert!(!path.exists());
    }

    #[test]
    fn nothing_that_is_not_a_socket_is_deleted() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("precious");
        std::fs::write(&path, "data").unwrap();
        assert!(matches!(Listener::bind(&path, 0o600, None), Err(ListenError::Foreign(_))));
        assert_eq!(std::fs::read(&path).unwrap(), b"data");
        let link = directory.path().join("link");
        std::os::unix::fs::symlink(&path, &link).unwrap();
        assert!(matches!(Listener::bind(&link, 0o600, None), Err(ListenError::Foreign(_))));
    }

    /// Root once changed such a mode for the directory's owner.
    #[test]
    fn the_mode_of_nothing_else_is_set_whatever_is_put_in_the_way() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("pmac0.sock");
        let workshop = Workshop::beside(&path).unwrap();
        let trap = directory.path().join("trap");
        std::fs::create_dir(&trap).unwrap();
        std::fs::write(trap.join(SOCKET), "somebody else's").unwrap();
        std::fs::set_permissions(trap.join(SOCKET), std::fs::Permissions::from_mode(0o600)).unwrap();
        std::fs::rename(&workshop.name, directory.path().join("away")).unwrap();
        std::os::unix::fs::symlink(&trap, &workshop.name).unwrap();
        let _socket = workshop.bind().unwrap();
        workshop.finish(0o666, None).unwrap();
        workshop.move_to(&path).unwrap();
        assert_eq!((mode(&trap.join(SOCKET)), mode(&path)), (0o600, 0o666));
        // The daemon does not work in a directory that others may enter.
        let opened = directory.path().join(format!("x.{}.0", std::process::id()));
        std::fs::create_dir(&opened).unwrap();
        assert_ne!(Workshop::beside(&directory.path().join("x")).unwrap().name, opened);
    }

    #[test]
    fn failures_say_where() {
        let missing = Path::new("/nonexistent-directory/pmac0.sock");
        let error = Listener::bind(missing, 0o600, None).unwrap_err().to_string();
        assert!(error.contains("/nonexistent-directory/pmac0.sock"), "{error}");
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("pmac0.sock");
        let error = Listener::bind(&path, 0o600, Some("no-such-group-here")).unwrap_err().to_string();
        assert!(error.contains("no-such-group-here"), "{error}");
        assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 0);
    }
}
