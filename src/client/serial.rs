//! A board at the end of a serial line: for set-up, before its DPRAM is switched on.
//!
//! Eight data bits, no parity, one stop bit, no flow control. This process locks the line for itself (an advisory
//! lock), and every wait is bounded. In a forked child every call is an error: the answers are the parent's.

use std::fs::{File, OpenOptions};
use std::io::{self, Read, Write};
use std::os::fd::AsFd;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use nix::errno::Errno;
use nix::fcntl::{Flock, FlockArg, OFlag};
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use rustix::termios::{ControlModes, OptionalActions, QueueSelector, tcflush, tcgetattr, tcsetattr};

use super::serial_reply::{Handshake, Reply, SerialAnswer, parse, recognise};
use crate::protocol::control::CANCEL;

/// A silence that ends an answer without an end mark; several characters long at the lowest rate.
const QUIET: Duration = Duration::from_millis(250);
/// How long the board may take to tell its handshake.
const PROBE: Duration = Duration::from_secs(1);
/// How often this program asks the board; a text that a board's program sends can spoil an answer.
const PROBES: usize = 3;
/// Longer than any listing that a set-up reads.
const LONGEST_ANSWER: usize = 64 * 1024;

/// The rates of a board, in bits a second.
pub const BAUD_RATES: [u32; 8] = [1200, 2400, 4800, 9600, 19_200, 38_400, 57_600, 115_200];

/// Why a serial line is useless, or the board did not carry out a line.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SerialError {
    /// The system cannot open or set the line.
    #[error("{path}: {source}")]
    Port {
        /// The device.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The path is no serial line.
    #[error("{path}: not a serial line")]
    NotSerial {
        /// The path.
        path: PathBuf,
    },
    /// Another program holds the line.
    #[error("{path}: another program uses it")]
    InUse {
        /// The device.
        path: PathBuf,
    },
    /// Another process opened the line; this process is a fork of it.
    #[error("{path}: process {process}, from which this one was forked, uses it; nothing was sent")]
    OtherProcess {
        /// The device.
        path: PathBuf,
        /// The process that opened it.
        process: u32,
    },
    /// The line does not have this rate.
    #[error("{baud} baud is none of 1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200")]
    Rate {
        /// The requested rate.
        baud: u32,
    },
    /// Nothing came back that a PMAC sends.
    #[error("{path}: {}; is a PMAC there, and is {baud} its rate?", if *.silent { "no answer" } else { "no answer that makes sense" })]
    NoBoard {
        /// The device.
        path: PathBuf,
        /// The rate in use.
        baud: u32,
        /// Nothing came at all.
        silent: bool,
    },
    /// The board did not answer the line in time.
    #[error("the board did not answer in time; the line may or may not have been carried out")]
    TimedOut,
    /// The board refused the line.
    #[error("{}", refusal(*.code))]
    Board {
        /// The number of `ERRnnn`; `None` when the board says none (I6 is 0 or 2).
        code: Option<u16>,
        /// The answer's lines so far.
        lines: Vec<String>,
    },
}

fn refusal(code: Option<u16>) -> String {
    match code {
        Some(code) => {
            format!("ERR{code:03}: {}", crate::map::errors::meaning(code).unwrap_or("unknown error"))
        }
        None => "the board refuses the line and says no number; I6=1 makes it say one".to_owned(),
    }
}

/// A serial line with a board that answers.
#[derive(Debug)]
pub struct SerialLine {
    path: PathBuf,
    baud: u32,
    file: Flock<File>,
    handshake: Handshake,
    /// The process that opened it.
    process: u32,
}

impl SerialLine {
    /// Opens the device `path` at `baud` bits a second and asks the board for its handshake. This sends one ^X and the
    /// question `I4`, and changes no variable.
    ///
    /// # Errors
    /// [`SerialError`].
    pub fn open(path: &Path, baud: u32) -> Result<Self, SerialError> {
        if !BAUD_RATES.contains(&baud) {
            return Err(SerialError::Rate { baud });
        }
        let port = |source: io::Error| SerialError::Port { path: path.to_owned(), source };
        // Without O_NONBLOCK, opening a line without carrier waits for it.
        let flags = OFlag::O_NOCTTY | OFlag::O_NONBLOCK;
        let file =
            OpenOptions::new().read(true).write(true).custom_flags(flags.bits()).open(path).map_err(port)?;
        let mut settings = match tcgetattr(&file) {
            Ok(settings) => settings,
            Err(rustix::io::Errno::NOTTY) => return Err(SerialError::NotSerial { path: path.to_owned() }),
            Err(error) => return Err(port(error.into())),
        };
        let file = Flock::lock(file, FlockArg::LockExclusiveNonblock).map_err(|(_, error)| match error {
            Errno::EWOULDBLOCK => SerialError::InUse { path: path.to_owned() },
            error => port(error.into()),
        })?;
        settings.make_raw();
        settings.control_modes |= ControlModes::CLOCAL | ControlModes::CREAD;
        settings.control_modes &= !(ControlModes::CSTOPB | ControlModes::CRTSCTS);
        settings.set_speed(baud).map_err(|error| port(error.into()))?;
        tcsetattr(&*file, OptionalActions::Now, &settings).map_err(|error| port(error.into()))?;
        tcflush(&*file, QueueSelector::IOFlush).map_err(|error| port(error.into()))?;
        let handshake = Handshake { line_feeds: false, acknowledge: false, checksum: false };
        let mut line = Self { path: path.to_owned(), baud, file, handshake, process: std::process::id() };
        // Keeps the board from executing another program's half line.
        line.write(&[CANCEL])?;
        line.recognise()?;
        Ok(line)
    }

    /// Sends one command line and returns the lines of its answer.
    ///
    /// # Errors
    /// [`SerialError`]; [`SerialError::Board`] when the board refused the line.
    pub fn send(&mut self, line: &str, timeout: Duration) -> Result<Vec<String>, SerialError> {
        let reply = self.exchange(line, timeout)?;
        if !self.handshake.acknowledge && !self.handshake.line_feeds && reply.error.is_none() {
            // In this handshake only silence says that the board took a line: only an answer to another line shows that
            // the board has finished.
            self.answers_within(timeout)?;
        }
        match reply.error {
            None => Ok(reply.lines),
            Some(error) => Err(SerialError::Board { code: error.code, lines: reply.lines }),
        }
    }

    /// Asks the board for its handshake until it answers: after a reset, which may change the handshake.
    ///
    /// # Errors
    /// [`SerialError::NoBoard`] if the board has not answered within `timeout`.
    pub fn answers_within(&mut self, timeout: Duration) -> Result<(), SerialError> {
        let deadline = Instant::now() + timeout;
        loop {
            match self.recognise() {
                Err(SerialError::NoBoard { .. }) if Instant::now() < deadline => {}
                result => return result,
            }
        }
    }

    fn recognise(&mut self) -> Result<(), SerialError> {
        let mut silent = true;
        for _ in 0..PROBES {
            self.drain()?;
            self.write(b"I4\r")?;
            let bytes = self.collect(PROBE, |bytes| match bytes {
                [] => Finish::No,
                _ => Finish::AfterSilence,
            })?;
            if let Some(handshake) = recognise(&bytes) {
                self.handshake = handshake;
                return Ok(());
            }
            silent &= bytes.is_empty();
        }
        Err(SerialError::NoBoard { path: self.path.clone(), baud: self.baud, silent })
    }

    fn exchange(&mut self, line: &str, timeout: Duration) -> Result<Reply, SerialError> {
        self.drain()?;
        self.write(format!("{line}\r").as_bytes())?;
        let handshake = self.handshake;
        let bytes = self.collect(timeout, |bytes| match parse(handshake, bytes) {
            SerialAnswer::Complete(_) => Finish::Now,
            SerialAnswer::PerhapsComplete(_) => Finish::AfterSilence,
            SerialAnswer::Unfinished => Finish::No,
        })?;
        match parse(handshake, &bytes) {
            SerialAnswer::PerhapsComplete(reply) | SerialAnswer::Complete(reply) => Ok(reply),
            SerialAnswer::Unfinished => Err(SerialError::TimedOut),
        }
    }

    /// Throws away unrequested bytes before a line goes out.
    fn drain(&mut self) -> Result<(), SerialError> {
        if self.process != std::process::id() {
            return Err(SerialError::OtherProcess { path: self.path.clone(), process: self.process });
        }
        tcflush(&*self.file, QueueSelector::IFlush).map_err(|error| self.port(error.into()))
    }

    /// The received bytes, until `finish` accepts them or `timeout` is over.
    fn collect(
        &mut self,
        timeout: Duration,
        finish: impl Fn(&[u8]) -> Finish,
    ) -> Result<Vec<u8>, SerialError> {
        let deadline = Instant::now() + timeout;
        let mut bytes = Vec::new();
        let mut chunk = [0; 1024];
        let mut heard = Instant::now();
        loop {
            let until = match finish(&bytes) {
                Finish::Now => return Ok(bytes),
                Finish::AfterSilence => deadline.min(heard + QUIET),
                Finish::No => deadline,
            };
            let wait = until.saturating_duration_since(Instant::now());
            if wait.is_zero() || bytes.len() > LONGEST_ANSWER {
                return Ok(bytes);
            }
            if !self.ready(PollFlags::POLLIN, wait)? {
                continue;
            }
            match self.file.read(&mut chunk) {
                Ok(0) => return Err(self.port(io::ErrorKind::UnexpectedEof.into())),
                Ok(count) => bytes.extend_from_slice(&chunk[..count]),
                Err(error) if again(&error) => {}
                Err(error) => return Err(self.port(error)),
            }
            heard = Instant::now();
        }
    }

    fn write(&mut self, mut bytes: &[u8]) -> Result<(), SerialError> {
        let deadline = Instant::now() + PROBE + Duration::from_secs(2 * bytes.len() as u64 / 100);
        while !bytes.is_empty() {
            if !self.ready(PollFlags::POLLOUT, deadline.saturating_duration_since(Instant::now()))? {
                return Err(
                    self.port(io::Error::new(io::ErrorKind::TimedOut, "the line does not take characters"))
                );
            }
            match self.file.write(bytes) {
                Ok(count) => bytes = &bytes[count..],
                Err(error) if again(&error) => {}
                Err(error) => return Err(self.port(error)),
            }
        }
        Ok(())
    }

    fn ready(&self, events: PollFlags, wait: Duration) -> Result<bool, SerialError> {
        // Rounded up, so that a wait that is nearly over does not spin.
        let millis = u16::try_from(wait.as_millis().saturating_add(1)).unwrap_or(u16::MAX);
        match poll(&mut [PollFd::new(self.file.as_fd(), events)], PollTimeout::from(millis)) {
            Ok(count) => Ok(count > 0),
            Err(Errno::EINTR) => Ok(false),
            Err(error) => Err(self.port(error.into())),
        }
    }

    fn port(&self, source: io::Error) -> SerialError {
        SerialError::Port { path: self.path.clone(), source }
    }
}

/// Whether the received bytes are an answer.
enum Finish {
    /// An answer.
    Now,
    /// An answer, if no byte follows for [`QUIET`].
    AfterSilence,
    /// No answer yet.
    No,
}

fn again(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::Interrupted | io::ErrorKind::WouldBlock)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_serial_line_is_said() {
        let refused = |path: &str| SerialLine::open(Path::new(path), 9600).unwrap_err().to_string();
        assert!(refused("/nonexistent/ttyS0").contains("No such file"));
        assert_eq!(refused("/dev/null"), "/dev/null: not a serial line");
        let error = SerialLine::open(Path::new("/dev/null"), 300).unwrap_err().to_string();
        assert!(error.starts_with("300 baud is none of 1200"), "{error}");
    }

    #[test]
    fn a_line_on_which_nobody_answers_is_given_up() {
        let pty = nix::pty::openpty(None, None).unwrap();
        let path = nix::unistd::ttyname(&pty.slave).unwrap();
        let error = SerialLine::open(&path, 38_400).unwrap_err();
        assert!(matches!(error, SerialError::NoBoard { silent: true, .. }), "{error}");
        assert!(error.to_string().contains("is 38400 its rate"), "{error}");
    }
}
