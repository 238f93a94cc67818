//! Commands to the board, through the daemon's socket.
//!
//! Every call is bounded: by the caller's time-out for the board, plus a second for the daemon's answer. A call that
//! ran into its time-out leaves a late reply behind, so the next call uses a new connection.
//!
//! A connection belongs to the process that made it, and so does all that the daemon keeps for it. In a forked child
//! every call over it is an error; the child opens its own.

mod gather;
pub mod jobs;
pub mod lines;
mod link;
mod messages;
pub mod rotary;
pub mod trace;
pub mod variables;

use std::io;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use nix::sys::socket::{getsockopt, sockopt::PeerCredentials};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use self::link::{Link, after};
pub use self::messages::Messages;
use crate::map::HostOffset;
use crate::protocol::board::{Done, ReadReply, ResetsReply, SendReply};
use crate::protocol::message::encode;
use crate::protocol::parameters::to_map;
use crate::protocol::program_words::ASKS_FIRST;
use crate::protocol::transport::connect;
use crate::protocol::{BOARD, BoardInfo, BoardSettings, Call, CallError, Reply, calls, control};
use crate::segment::{SegmentName, is_trusted};

/// How long the daemon may take to accept, and to answer without the board.
pub(super) const DAEMON_TIMEOUT: Duration = Duration::from_secs(5);
/// How much longer than the board the daemon may take: more than the daemon's own grace.
pub(super) const MARGIN: Duration = Duration::from_secs(2);

/// How long to wait until the daemon uses a function, and how often to ask: a large board has many M-variables.
const USED: Duration = Duration::from_secs(15);
const USED_LOOK: Duration = Duration::from_millis(50);

/// A command failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CommandError {
    /// No daemon serves the socket.
    #[error("{path}: {source}; is pmacd running, and may you use its socket?")]
    Connect {
        /// The socket.
        path: PathBuf,
        /// The kernel's error.
        source: io::Error,
    },
    /// An untrusted user's process serves the socket.
    #[error(
        "{path} is served by user {uid}, who is not trusted here: only root, pmacd and yourself are; nothing was sent"
    )]
    Stranger {
        /// The socket.
        path: PathBuf,
        /// The user.
        uid: u32,
    },
    /// The daemon at the socket has another board.
    #[error("{path} is the socket of the board {found}, not of {wanted}; leave --name or --socket out")]
    OtherBoard {
        /// The socket.
        path: PathBuf,
        /// The expected board.
        wanted: String,
        /// The daemon's board.
        found: String,
    },
    /// Another process made the connection; this process is a fork of it.
    #[error(
        "this connection to pmacd belongs to process {process}, from which this one was forked; open another one here; nothing was sent"
    )]
    OtherProcess {
        /// The process that made the connection.
        process: u32,
    },
    /// The daemon did not receive the whole call, so it began no part of it.
    #[error(
        "{path}: pmacd did not take the call ({source}); nothing of it was carried out; see whether pmacd runs (pmacctl status)"
    )]
    NotTaken {
        /// The socket.
        path: PathBuf,
        /// The kernel's error.
        source: io::Error,
    },
    /// The connection broke, or the daemon closed it, before the answer came.
    #[error(
        "{path}: the connection to pmacd broke before the answer came ({source}); what was asked may or may not have been carried out"
    )]
    Broken {
        /// The socket.
        path: PathBuf,
        /// The kernel's error.
        source: io::Error,
    },
    /// The connection of a stream or a watch broke, or the daemon closed it.
    #[error("{path}: pmacd is gone, or has ended the stream ({source})")]
    StreamEnded {
        /// The socket.
        path: PathBuf,
        /// The kernel's error.
        source: io::Error,
    },
    /// The daemon itself did not answer in time.
    #[error(
        "{path}: pmacd did not answer in time (is it stopped?); what was asked may or may not have been carried out"
    )]
    NoAnswer {
        /// The socket.
        path: PathBuf,
    },
    /// The daemon or the board refused; [`CallError::Board`] is the board's own error.
    #[error(transparent)]
    Refused(#[from] CallError),
}

impl CommandError {
    /// Whether the board may have received the command or a part of it.
    #[must_use]
    pub const fn is_uncertain(&self) -> bool {
        matches!(
            self,
            Self::Broken { .. }
                | Self::NoAnswer { .. }
                | Self::Refused(
                    CallError::TimedOut { .. } | CallError::Interrupted { .. } | CallError::Protocol(_)
                )
        )
    }
}

/// A connection to the daemon of one board.
#[derive(Debug)]
pub struct Connection {
    path: PathBuf,
    link: Option<Link>,
    /// The daemon may send lines that end all clients' command lines.
    confirms: bool,
}

/// A line's parameters besides its text, as in the method `Send`.
#[derive(Debug, Clone, Copy, Default)]
pub struct SendAs {
    /// A question, as in [`Connection::question`].
    pub question: Option<bool>,
    /// `true`: the line enters the program buffer that this process has open, or opens a buffer
    /// ([`Connection::send_into_buffer`]). `false`: the line enters no buffer; while a buffer is open, the daemon
    /// refuses all lines but `CLOSE` and on-line commands.
    pub into_buffer: Option<bool>,
    /// The line's jogs without an end stop when this connection ends, as in [`Connection::send_while_connected`].
    pub while_connected: Option<bool>,
    /// These jogs also stop after so many milliseconds without a call over this connection, such as
    /// [`Connection::jog_renew`].
    pub silence_ms: Option<u64>,
}

impl Connection {
    /// Connects to the daemon at the socket `path`.
    ///
    /// # Errors
    /// [`CommandError::Connect`]; [`CommandError::Stranger`] if the server's user is neither root, `pmacd` nor this
    /// one.
    pub fn open(path: &Path) -> Result<Self, CommandError> {
        let mut connection = Self { path: path.to_owned(), link: None, confirms: false };
        connection.link = Some(connection.dial()?);
        Ok(connection)
    }

    /// A connection made by the caller. If it breaks, the next call connects to the daemon at the socket `path`.
    #[must_use]
    pub fn over(stream: UnixStream, path: &Path) -> Self {
        let link = Some(Link::new(stream));
        Self { path: path.to_owned(), link, confirms: false }
    }

    /// The same connection. If it `confirms`, the daemon also sends a line that ends all clients' command lines (`^Z`,
    /// `I58=0`) or others' work (`$$$`, `SAVE`); otherwise the daemon refuses such a line.
    #[must_use]
    pub fn confirming(self, confirms: bool) -> Self {
        Self { confirms, ..self }
    }

    /// The parameter `confirmed` of calls that send lines.
    fn confirmed(&self) -> Option<bool> {
        self.confirms.then_some(true)
    }

    /// Checks that this process made the connection and is no fork of that process.
    ///
    /// # Errors
    /// [`CommandError::OtherProcess`].
    pub fn check_process(&self) -> Result<(), CommandError> {
        self.link.as_ref().map_or(Ok(()), check_process)
    }

    /// The link; makes a new one after the last one broke.
    fn take_link(&mut self) -> Result<Link, CommandError> {
        self.check_process()?;
        self.link.take().map_or_else(|| self.dial(), Ok)
    }

    fn dial(&self) -> Result<Link, CommandError> {
        let stream = connect(&self.path, Instant::now() + DAEMON_TIMEOUT)
            .map_err(|source| CommandError::Connect { path: self.path.clone(), source })?;
        // The kernel vouches for the server's user: the caller would take a stranger's answers for the board's.
        let uid = getsockopt(&stream, PeerCredentials)
            .map_err(|errno| CommandError::Connect { path: self.path.clone(), source: errno.into() })?
            .uid();
        if !is_trusted(uid) {
            return Err(CommandError::Stranger { path: self.path.clone(), uid });
        }
        Ok(Link::new(stream))
    }

    /// The same connection, after the daemon has said that its board is `name`: then segment and socket belong to one
    /// board.
    ///
    /// # Errors
    /// [`CommandError::OtherBoard`], and those of [`Connection::info`].
    pub fn of_board(mut self, name: &SegmentName) -> Result<Self, CommandError> {
        let segment = self.info()?.segment;
        if segment.trim_start_matches('/') == name.as_str() {
            return Ok(self);
        }
        let (found, wanted) = (segment.trim_start_matches('/').to_owned(), name.as_str().to_owned());
        Err(CommandError::OtherBoard { path: self.path, wanted, found })
    }

    /// The daemon's facts about its board and itself.
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn info(&mut self) -> Result<BoardInfo, CommandError> {
        self.call("GetInfo", &calls::NoParameters {}, DAEMON_TIMEOUT)
    }

    /// The settings that no document decides: the places of the buffers, and the readings of uncertain formats.
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn settings(&mut self) -> Result<BoardSettings, CommandError> {
        self.call("GetSettings", &calls::NoParameters {}, DAEMON_TIMEOUT)
    }

    /// Sends one command line (1 to 200 printable ASCII characters) and returns the lines of its reply; none if the
    /// board only acknowledged.
    ///
    /// # Errors
    /// [`CommandError`], with [`CallError::Board`] inside if the board refused the line.
    pub fn send(&mut self, line: &str, timeout: Duration) -> Result<Vec<String>, CommandError> {
        self.send_as(line, timeout, SendAs::default())
    }

    /// As [`Connection::send`], for a mere question: the daemon refuses a line that would enter an open program buffer,
    /// whoever has opened the buffer.
    ///
    /// # Errors
    /// As [`Connection::send`].
    pub fn question(&mut self, line: &str, timeout: Duration) -> Result<Vec<String>, CommandError> {
        self.send_as(line, timeout, SendAs { question: Some(true), ..SendAs::default() })
    }

    /// As [`Connection::send`], for a line of the program buffer that this process has open. The daemon refuses the
    /// line if that buffer is closed, since the board would execute the line at once, or if another process's buffer is
    /// open.
    ///
    /// # Errors
    /// As [`Connection::send`].
    pub fn send_into_buffer(&mut self, line: &str, timeout: Duration) -> Result<Vec<String>, CommandError> {
        self.send_as(line, timeout, SendAs { into_buffer: Some(true), ..SendAs::default() })
    }

    /// As [`Connection::send`], for a line whose jogs without an end (`#1J+`) end with this connection: the daemon
    /// stops the motor when the connection ends, unless the motor has got another command meanwhile. The line must name
    /// its motors.
    ///
    /// # Errors
    /// As [`Connection::send`].
    pub fn send_while_connected(
        &mut self,
        line: &str,
        timeout: Duration,
    ) -> Result<Vec<String>, CommandError> {
        self.send_as(line, timeout, SendAs { while_connected: Some(true), ..SendAs::default() })
    }

    /// Asks the board for its servo counter, which restarts at a reset, and returns how many resets the daemon has
    /// found in this way. Two calls differ if the board was reset between them.
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn check_reset(&mut self) -> Result<u64, CommandError> {
        let reply: ResetsReply = self.call("CheckReset", &calls::NoParameters {}, DAEMON_TIMEOUT + MARGIN)?;
        Ok(reply.resets)
    }

    /// Leaves a note, of which the daemon takes the first [`calls::NOTE_MAX`] characters, for whoever asks for the state of
    /// the board.
    ///
    /// # Errors
    /// [`CommandError`]; the daemon refuses a second note of a user within a second.
    pub fn note(&mut self, text: &str) -> Result<(), CommandError> {
        let text = text.chars().take(calls::NOTE_MAX).collect();
        let Done {} = self.call("Note", &calls::Note { text }, DAEMON_TIMEOUT)?;
        Ok(())
    }

    /// As [`Connection::send`], with these parameters.
    ///
    /// # Errors
    /// As [`Connection::send`].
    pub fn send_as(
        &mut self,
        line: &str,
        timeout: Duration,
        send_as: SendAs,
    ) -> Result<Vec<String>, CommandError> {
        Ok(self.send_and_see(line, timeout, send_as)?.lines)
    }

    /// As [`Connection::send_as`]. The reply also names the open program buffer, if the line entered it or may have.
    ///
    /// # Errors
    /// As [`Connection::send`].
    pub fn send_and_see(
        &mut self,
        line: &str,
        timeout: Duration,
        SendAs { question, into_buffer, while_connected, silence_ms }: SendAs,
    ) -> Result<SendReply, CommandError> {
        let (line, timeout_ms, confirmed) = (line.to_owned(), Some(milliseconds(timeout)), self.confirmed());
        let parameters =
            calls::Send { line, timeout_ms, question, into_buffer, while_connected, silence_ms, confirmed };
        self.call("Send", &parameters, timeout.saturating_add(MARGIN))
    }

    /// Sends the control character `character` (1 to 31) before all waiting lines, and returns the board's answer,
    /// which is empty for most of them. `^A` and `^K` drop every client's waiting lines.
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn control(&mut self, character: u8) -> Result<Vec<String>, CommandError> {
        self.send_control(character, false)
    }

    /// As [`Connection::control`], but `^A` and `^K` drop no waiting lines.
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn control_keeping_queue(&mut self, character: u8) -> Result<Vec<String>, CommandError> {
        self.send_control(character, true)
    }

    fn send_control(&mut self, character: u8, keeps_queue: bool) -> Result<Vec<String>, CommandError> {
        let parameters = calls::SendControl {
            character: control::name(character),
            keep_queue: keeps_queue.then_some(true),
            confirmed: self.confirmed(),
        };
        let reply: SendReply = self.call("SendControl", &parameters, DAEMON_TIMEOUT + MARGIN)?;
        Ok(reply.lines)
    }

    /// Reads `words` (1 to 64) consecutive words of the DPRAM: the CLOCK_MONOTONIC time of the first read in
    /// nanoseconds, and the words.
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn read(&mut self, first: HostOffset, words: usize) -> Result<(u64, Vec<u16>), CommandError> {
        let parameters = calls::Read { host_offset: calls::Offset(first), words };
        let reply: ReadReply = self.call("Read", &parameters, DAEMON_TIMEOUT + MARGIN)?;
        if reply.words.len() != words {
            let what = format!("{} words instead of {words}", reply.words.len());
            return Err(CallError::Protocol(what).into());
        }
        Ok((reply.time_ns, reply.words))
    }

    /// As [`Connection::call`], and waits until the daemon uses the function.
    pub(super) fn call_used<T: DeserializeOwned>(
        &mut self,
        method: &str,
        parameters: &impl Serialize,
        timeout: Duration,
    ) -> Result<T, CommandError> {
        when_used(|| self.call(method, parameters, timeout))
    }

    pub(super) fn call<T: DeserializeOwned>(
        &mut self,
        method: &str,
        parameters: &impl Serialize,
        timeout: Duration,
    ) -> Result<T, CommandError> {
        self.ask(method, parameters, timeout)?;
        self.answer(timeout)
    }

    /// Sends a call without waiting for its reply; [`Connection::answer`] takes the reply. Several calls may be under
    /// way; the daemon answers them in order.
    pub(super) fn ask(
        &mut self,
        method: &str,
        parameters: &impl Serialize,
        timeout: Duration,
    ) -> Result<(), CommandError> {
        let call = Call::new(format!("{BOARD}.{method}"), to_map(parameters));
        let mut link = self.take_link()?;
        link.call(&encode(&call), after(timeout)).map_err(|error| not_taken(&self.path, error))?;
        self.link = Some(link);
        Ok(())
    }

    /// The reply to the oldest call under way.
    pub(super) fn answer<T: DeserializeOwned>(&mut self, timeout: Duration) -> Result<T, CommandError> {
        self.check_process()?;
        let Some(mut link) = self.link.take() else {
            let source = io::ErrorKind::NotConnected.into();
            return Err(CommandError::Broken { path: self.path.clone(), source });
        };
        let reply = link.next_reply(after(timeout)).map_err(|error| fault(&self.path, error))?;
        // Only after its last reply can the connection take another call.
        self.link = Some(link);
        read_reply(reply)
    }
}

/// Repeats the call until the daemon uses the function: for a few seconds after the daemon's start.
fn when_used<T>(mut call: impl FnMut() -> Result<T, CommandError>) -> Result<T, CommandError> {
    let deadline = Instant::now() + USED;
    loop {
        match call() {
            Err(CommandError::Refused(CallError::Refused { reason }))
                if reason.contains(ASKS_FIRST) && Instant::now() < deadline =>
            {
                std::thread::sleep(USED_LOOK);
            }
            other => return other,
        }
    }
}

/// Whether this process made `link`; a forked child did not.
fn check_process(link: &Link) -> Result<(), CommandError> {
    match link.process {
        process if process == std::process::id() => Ok(()),
        process => Err(CommandError::OtherProcess { process }),
    }
}

/// A time-out as the socket takes it.
pub(super) fn milliseconds(timeout: Duration) -> u64 {
    u64::try_from(timeout.as_millis()).unwrap_or(u64::MAX).max(1)
}

fn read_reply<T: DeserializeOwned>(reply: Reply) -> Result<T, CommandError> {
    if let Some(error) = reply.error() {
        return Err(error.into());
    }
    let parameters = Value::Object(reply.parameters.unwrap_or_default());
    serde_json::from_value(parameters).map_err(|error| CallError::Protocol(error.to_string()).into())
}

/// The daemon has not received the whole call.
fn not_taken(path: &Path, source: io::Error) -> CommandError {
    CommandError::NotTaken { path: path.to_owned(), source }
}

fn fault(path: &Path, error: io::Error) -> CommandError {
    let path = path.to_owned();
    match error.kind() {
        io::ErrorKind::TimedOut => CommandError::NoAnswer { path },
        _ => CommandError::Broken { path, source: error },
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};

    use super::*;

    #[test]
    fn a_watch_is_looked_after_without_waiting() {
        let (ours, mut theirs) = UnixStream::pair().unwrap();
        theirs.write_all(b"{\"parameters\":{\"watched\":1,\"table\":7},\"continues\":true}\0").unwrap();
        let registers = ["X:$0028".parse().unwrap()];
        let mut watch = Connection::over(ours, Path::new("unused")).watch_variables(&registers).unwrap();
        assert_eq!(watch.table(), 7);
        // If each look waited for the socket, these would take ten seconds.
        for _ in 0..10_000 {
            watch.check().unwrap();
        }
        theirs.write_all(b"{\"error\":\"io.github.pmac-dpram.Board.Busy\"}\0").unwrap();
        assert!(matches!(watch.check(), Err(CommandError::Refused(CallError::Busy))));
        drop(theirs);
        assert!(matches!(watch.check(), Err(CommandError::StreamEnded { .. })), "the daemon is gone");
    }

    #[test]
    fn in_a_forked_child_no_call_is_sent_and_no_reply_taken_over_the_parents_connection() {
        let (ours, mut theirs) = UnixStream::pair().unwrap();
        theirs.write_all(b"{\"parameters\":{\"lines\":[\"the parent's\"]}}\0").unwrap();
        theirs.set_nonblocking(true).unwrap();
        let mut connection = Connection::over(ours, Path::new("x.sock"));
        let belongs_to = |connection: &mut Connection, process| {
            connection.link.as_mut().unwrap().process = process;
        };
        let parent = std::os::unix::process::parent_id();
        belongs_to(&mut connection, parent);
        let is_refused = |result: Result<(), CommandError>| {
            let error = result.unwrap_err();
            assert!(matches!(error, CommandError::OtherProcess { process } if process == parent), "{error}");
            assert!(!error.is_uncertain() && error.to_string().ends_with("nothing was sent"), "{error}");
        };
        let second = Duration::from_secs(1);
        for _ in 0..2 {
            is_refused(connection.send("P1=5", second).map(drop));
            is_refused(connection.answer::<SendReply>(second).map(drop));
            let options = lines::LinesOptions { kind: "download", timeout: second, keep_going: false };
            is_refused(connection.run_lines(options, &["P1=5"], |_| true).map(drop));
        }
        let sent = theirs.read(&mut [0; 64]).unwrap_err();
        assert_eq!(sent.kind(), io::ErrorKind::WouldBlock);
        // The parent's own call goes on, and finds its reply.
        belongs_to(&mut connection, std::process::id());
        assert_eq!(connection.send("P1", second).unwrap(), ["the parent's"]);

        belongs_to(&mut connection, parent);
        let registers = ["X:$0028".parse().unwrap()];
        is_refused(connection.watch_variables(&registers).map(drop));
    }

    #[test]
    fn a_broken_connection_says_whether_a_line_may_have_been_carried_out() {
        let said = |theirs: Option<&[u8]>| {
            let (ours, mut other) = UnixStream::pair().unwrap();
            let mut connection = Connection::over(ours, Path::new("x.sock"));
            let ending = theirs.map(|reply| {
                let reply = reply.to_vec();
                std::thread::spawn(move || {
                    let mut call = [0; 512];
                    assert!(other.read(&mut call).unwrap() > 0);
                    other.write_all(&reply).unwrap();
                })
            });
            let error = connection.send("#1J+", Duration::from_secs(5)).unwrap_err();
            if let Some(ending) = ending {
                ending.join().unwrap();
            }
            error.to_string()
        };
        // The daemon was gone before the call: the whole call was never there.
        let told = said(None);
        assert!(
            told.contains("did not take the call") && told.contains("nothing of it was carried out"),
            "{told}"
        );
        for half in [&b""[..], b"{\"parameters\":"] {
            let told = said(Some(half));
            assert!(told.contains("may or may not have been carried out"), "{told}");
        }
    }
}
