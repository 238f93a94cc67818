//! The settings of the command socket.

use std::io;
use std::path::PathBuf;
use std::time::Duration;

use super::listener::{ListenError, Listener};
use super::policy::{PolicyError, Roles};

/// The settings of the command socket.
#[derive(Debug, Clone)]
pub struct ServeOptions {
    /// The socket's path: `/run/pmacd/pmac0.sock`.
    pub path: PathBuf,
    /// The users who may connect, as file mode bits.
    pub mode: u32,
    /// The group of the file, if it is not the daemon's own.
    pub group: Option<String>,
    /// The groups that raise a user's role.
    pub roles: Roles,
    /// The most connections at a time; fewer if the limit of open files is lower.
    pub max_clients: usize,
    /// The most connections of one user; root and the daemon's user are exempt. The last eighth of all places is for
    /// users with fewer than four connections, root too; half of that is for operators and engineers.
    pub max_clients_per_user: usize,
    /// How long a motor may still move after the stop of a held jog, until ^A stops everything. `None`: for ever.
    pub stop_all_after: Option<Duration>,
    /// How long a client may leave a message half sent, or its output unfetched.
    pub patience: Duration,
}

impl ServeOptions {
    /// The defaults: mode 0660, 256 connections, 64 of one user, 10 s.
    #[must_use]
    pub fn new(path: PathBuf) -> Self {
        Self {
            path,
            mode: 0o660,
            group: None,
            roles: Roles::default(),
            max_clients: 256,
            max_clients_per_user: 64,
            stop_all_after: Some(Duration::from_secs(1)),
            patience: Duration::from_secs(10),
        }
    }

    /// Puts the socket in its place. A separate step, so that the daemon can do it before it gives up its privileges.
    ///
    /// # Errors
    /// [`ListenError`].
    pub fn listen(&self) -> Result<Listener, ListenError> {
        Listener::bind(&self.path, self.mode, self.group.as_deref())
    }
}

/// The server cannot start.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ServeError {
    /// A group in the settings is unknown.
    #[error(transparent)]
    Policy(#[from] PolicyError),
    /// The system gave no descriptor or no thread.
    #[error("starting the command socket's thread: {0}")]
    Io(#[from] io::Error),
}
