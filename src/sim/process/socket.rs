//! Unix stream sockets that never block the servo: a listener, its clients, and their buffers.

use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::fs::FileTypeExt;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

/// The output that a client may leave unread before the simulator drops the client.
const BACKLOG: usize = 1 << 20;
/// Clients served at once; more are refused.
const CLIENTS: usize = 64;

/// A listening socket that is removed when dropped.
#[derive(Debug)]
pub struct Listener {
    listener: UnixListener,
    path: PathBuf,
}

impl Listener {
    /// Listens at `path`. Replaces a dead process's socket, but neither a live process's socket nor another kind of
    /// file.
    ///
    /// # Errors
    /// The system's error, or `AddrInUse` when a process listens there.
    pub fn bind(path: &Path) -> io::Result<Self> {
        if std::fs::symlink_metadata(path).is_ok_and(|found| found.file_type().is_socket()) {
            if UnixStream::connect(path).is_ok() {
                return Err(io::Error::new(ErrorKind::AddrInUse, "another process listens there"));
            }
            std::fs::remove_file(path)?;
        }
        let listener = UnixListener::bind(path)?;
        listener.set_nonblocking(true)?;
        Ok(Self { listener, path: path.to_owned() })
    }

    /// Takes the clients that wait into `clients`.
    pub fn accept(&self, clients: &mut Vec<Client>) {
        while let Ok((stream, _)) = self.listener.accept() {
            if clients.len() < CLIENTS && stream.set_nonblocking(true).is_ok() {
                clients.push(Client { stream, output: Vec::new(), gone: false });
            }
        }
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

/// A connected client.
#[derive(Debug)]
pub struct Client {
    stream: UnixStream,
    output: Vec<u8>,
    gone: bool,
}

impl Client {
    /// Reads the bytes that have come, at most `buffer.len()`.
    pub fn receive<'a>(&mut self, buffer: &'a mut [u8]) -> &'a [u8] {
        match self.stream.read(buffer) {
            Ok(0) => self.gone = true,
            Ok(count) => return &buffer[..count],
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {}
            Err(_) => self.gone = true,
        }
        &[]
    }

    /// Sends `bytes`, now or when the socket has room. Drops a client that reads nothing for too long.
    pub fn send(&mut self, bytes: &[u8]) {
        self.output.extend_from_slice(bytes);
        self.flush();
        self.gone |= self.output.len() > BACKLOG;
    }

    /// Sends the bytes that wait.
    pub fn flush(&mut self) {
        while !self.output.is_empty() {
            match self.stream.write(&self.output) {
                Ok(count) => drop(self.output.drain(..count)),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => {
                    self.gone |= error.kind() != ErrorKind::WouldBlock;
                    return;
                }
            }
        }
    }

    /// Whether everything sent is on its way.
    #[must_use]
    pub fn idle(&self) -> bool {
        self.output.is_empty()
    }

    /// Whether the client has closed its end or was dropped.
    #[must_use]
    pub fn gone(&self) -> bool {
        self.gone
    }
}
