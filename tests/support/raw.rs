//! A client of the command socket that shares only the splitting of messages with ours.

use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;

use pmac_dpram::protocol::{BOARD, Inbox};
use serde_json::{Value, json};

use super::PATIENCE;
use super::bench::Bench;

/// A client that sends exactly the given bytes.
pub struct Raw {
    pub stream: UnixStream,
    inbox: Inbox,
}

impl Raw {
    /// Connects.
    pub fn new(bench: &Bench) -> Self {
        Self::at(&bench.socket)
    }

    /// Connects to the daemon at `socket`.
    pub fn at(socket: &Path) -> Self {
        let stream = UnixStream::connect(socket).unwrap();
        Self::over(stream)
    }

    /// Speaks over a connection that there is.
    pub fn over(stream: UnixStream) -> Self {
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream.set_write_timeout(Some(PATIENCE)).unwrap();
        Self { stream, inbox: Inbox::new(1 << 24) }
    }

    /// Sends bytes.
    pub fn send(&mut self, bytes: &[u8]) {
        self.stream.write_all(bytes).unwrap();
    }

    /// Calls a method of the board's interface.
    pub fn call(&mut self, method: &str, parameters: Value) {
        self.send(&call(method, parameters));
    }

    /// As [`Raw::call`]; `None` when the server has closed the connection.
    pub fn try_call(&mut self, method: &str, parameters: Value) -> Option<()> {
        self.stream.write_all(&call(method, parameters)).ok()
    }

    /// The next reply, or `None` when the server has closed the connection.
    pub fn receive(&mut self) -> Option<Value> {
        loop {
            if let Some(message) = self.inbox.next_message().unwrap() {
                return Some(serde_json::from_slice(&message).unwrap());
            }
            let mut chunk = [0; 65536];
            match self.stream.read(&mut chunk) {
                Ok(0) => return None,
                Ok(count) => self.inbox.push(&chunk[..count]),
                Err(error) if error.kind() == std::io::ErrorKind::ConnectionReset => return None,
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
                Err(error) => panic!("nothing received: {error}"),
            }
        }
    }
}

/// A call of the board's interface, with its NUL.
pub fn call(method: &str, parameters: Value) -> Vec<u8> {
    let mut bytes =
        json!({"method": format!("{BOARD}.{method}"), "parameters": parameters}).to_string().into_bytes();
    bytes.push(0);
    bytes
}

/// The last part of the name of the error in `reply`.
pub fn error_name(reply: &Value) -> &str {
    reply["error"].as_str().unwrap_or_default().rsplit('.').next().unwrap_or_default()
}
