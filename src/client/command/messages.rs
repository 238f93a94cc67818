//! The texts that the board's programs send.

use std::io;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use serde_json::Map;

use super::link::{Link, after};
use super::{CommandError, Connection, DAEMON_TIMEOUT, check_process, not_taken, read_reply};
use crate::protocol::message::encode;
use crate::protocol::{BOARD, Call, Message};

impl Connection {
    /// Turns the connection into a stream of the texts that the board's programs send.
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn messages(mut self) -> Result<Messages, CommandError> {
        let mut call = Call::new(format!("{BOARD}.Messages"), Map::new());
        call.more = Some(true);
        let path = self.path.clone();
        let mut link = self.take_link()?;
        let sent = link.call(&encode(&call), Instant::now() + DAEMON_TIMEOUT);
        sent.map_err(|error| not_taken(&path, error))?;
        Ok(Messages { path, link, ended: false })
    }
}

/// A stream of the texts that the board's programs send.
#[derive(Debug)]
pub struct Messages {
    path: PathBuf,
    link: Link,
    ended: bool,
}

impl Messages {
    /// The next text; `None` if no text has come within `timeout`, or the stream has ended.
    ///
    /// # Errors
    /// [`CommandError`] when the connection broke; the stream has then ended.
    pub fn next_within(&mut self, timeout: Duration) -> Result<Option<Message>, CommandError> {
        if self.ended {
            return Ok(None);
        }
        check_process(&self.link)?;
        let reply = match self.link.next_reply(after(timeout)) {
            Ok(reply) => reply,
            Err(error) if error.kind() == io::ErrorKind::TimedOut => return Ok(None),
            Err(error) => {
                self.ended = true;
                return Err(CommandError::StreamEnded { path: self.path.clone(), source: error });
            }
        };
        self.ended = reply.continues != Some(true);
        read_reply(reply).map(Some)
    }

    /// Whether the stream is over: the daemon has ended it, or the connection broke.
    #[must_use]
    pub fn ended(&self) -> bool {
        self.ended
    }
}
