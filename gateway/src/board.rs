//! The board as one client has it: a connection of his own to `pmacd`, opened when he first needs it.
//!
//! A line that opens a program buffer, and every line until its close, goes as a sequence of `pmacd`: no other client's
//! lines enter the buffer, and `pmacd` closes it when the client or this program is gone. `pmacd` also ends a jog
//! without an end then.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use log::{info, warn};
use pmac_dpram::client::command::SendAs;
use pmac_dpram::client::command::lines::LinesOptions;
use pmac_dpram::client::{CommandError, Connection};
use pmac_dpram::language::{Effect, Meaning, deadlines};
use pmac_dpram::map::{Family, HostOffset};
use pmac_dpram::protocol::board::LineOutcome;
use pmac_dpram::protocol::{CallError, READ_MAX};
use pmac_dpram::segment::SegmentName;

/// [`Failure::Refused`]: the board or `pmacd` does not allow the command now.
pub const NOT_NOW: u16 = 1;
/// [`Failure::Refused`]: the client lacks a right.
pub const NO_RIGHT: u16 = 2;
/// [`Failure::Refused`]: unknown command or value.
pub const UNKNOWN: u16 = 3;
/// [`Failure::Refused`]: a character is not allowed.
pub const ILLEGAL: u16 = 4;
/// [`Failure::Refused`]: the line needs an open buffer, and none is open (any more).
pub const NO_BUFFER: u16 = 5;
/// [`Failure::Refused`]: the line is too long.
pub const NO_ROOM: u16 = 6;
/// [`Failure::Refused`]: another client has a buffer open.
pub const IN_USE: u16 = 7;

/// After this silence of the gateway `pmacd` stops its clients' jogs: a hanging gateway can send no stop.
const SILENCE_MS: u64 = 1000;
/// How often the gateway renews a client's jogs, and his open buffer.
const RENEW_JOGS: Duration = Duration::from_millis(200);
const RENEW_BUFFER: Duration = Duration::from_secs(1);
/// How often the gateway leaves a note with `pmacd`, which takes one a second.
const NOTE_EVERY: Duration = Duration::from_secs(2);
/// The name of the sequences, as `pmacd` tells it to others.
const SEQUENCE: &str = "download";

/// Why the board did not carry something out, or may not have.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Failure {
    /// The board refused it, or nothing was sent.
    Refused {
        /// The number of `ERRnnn`, as a board would say it.
        code: u16,
        /// The board's lines before the refusal.
        lines: Vec<String>,
        /// The reason; `None` if the board itself gave it or the log has it already.
        why: Option<String>,
        /// Whether a part of it was sent.
        is_sent: bool,
    },
    /// The line was sent, and the board need not answer it: the gateway tells the client neither success nor failure.
    Unanswered(String),
    /// The gateway does not know what the board has done. The client gets no answer.
    Gone(String),
}

impl Failure {
    /// A refusal with nothing sent.
    #[must_use]
    pub fn unsent(code: u16, why: impl Into<String>) -> Self {
        Self::Refused { code, lines: Vec::new(), why: Some(why.into()), is_sent: false }
    }
}

/// The reason, where the failure ends the client's connection.
impl From<Failure> for String {
    fn from(failure: Failure) -> Self {
        match failure {
            Failure::Refused { why: Some(why), .. } | Failure::Unanswered(why) | Failure::Gone(why) => why,
            Failure::Refused { code, .. } => {
                format!("a request that has no room for an error met ERR{code:03}")
            }
        }
    }
}

impl From<CommandError> for Failure {
    fn from(error: CommandError) -> Self {
        let why = error.to_string();
        match error {
            CommandError::Refused(CallError::Board { code, lines, .. }) => {
                Self::Refused { code, lines, why: None, is_sent: true }
            }
            CommandError::Refused(CallError::NotPermitted { .. }) => Self::unsent(NO_RIGHT, why),
            CommandError::Refused(CallError::InvalidLine { .. }) => Self::unsent(ILLEGAL, why),
            CommandError::Refused(
                CallError::Refused { .. } | CallError::Busy | CallError::Unavailable { .. },
            )
            | CommandError::NotTaken { .. } => Self::unsent(NOT_NOW, why),
            CommandError::Refused(
                CallError::OutOfRange
                | CallError::InvalidParameter { .. }
                | CallError::InterfaceNotFound { .. }
                | CallError::MethodNotFound { .. },
            ) => Self::unsent(UNKNOWN, why),
            // [`Place::connect`] has logged it, once.
            CommandError::Connect { .. }
            | CommandError::Stranger { .. }
            | CommandError::OtherBoard { .. } => {
                Self::Refused { code: NOT_NOW, lines: Vec::new(), why: None, is_sent: false }
            }
            _ => Self::Gone(why),
        }
    }
}

/// The daemon's socket and board.
#[derive(Debug, Clone)]
pub struct Place {
    /// Its socket.
    socket: PathBuf,
    /// The board's name; `None` if the socket alone says which board.
    name: Option<SegmentName>,
    /// The log says already that no daemon with this board answers there.
    is_away: Arc<AtomicBool>,
    /// When the last note went to the daemon.
    noted: Arc<Mutex<Option<Instant>>>,
}

impl Place {
    /// The daemon at `socket`; its board must be `name`, if given.
    #[must_use]
    pub fn new(socket: PathBuf, name: Option<SegmentName>) -> Self {
        Self { socket, name, is_away: Arc::default(), noted: Arc::default() }
    }

    /// A connection to the daemon, after the daemon has confirmed its board. Logs once that the daemon is away, and
    /// once that it is back.
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn connect(&self) -> Result<Connection, CommandError> {
        let connection = Connection::open(&self.socket).and_then(|connection| match &self.name {
            Some(name) => connection.of_board(name),
            None => Ok(connection),
        });
        match &connection {
            Err(error) if !self.is_away.swap(true, Relaxed) => {
                warn!("{error}; until that is mended, lines are answered ERR{NOT_NOW:03}");
            }
            Ok(_) if self.is_away.swap(false, Relaxed) => warn!("pmacd is there again"),
            _ => {}
        }
        connection
    }

    /// Logs `text`, and leaves it with the daemon as a note for whoever asks for the state of the board, unless another
    /// note has just gone there.
    pub fn tell(&self, text: &str) {
        info!("{text}");
        let mut last = self.noted.lock().unwrap_or_else(PoisonError::into_inner);
        if last.is_some_and(|last| last.elapsed() < NOTE_EVERY) {
            return;
        }
        *last = Some(Instant::now());
        drop(last);
        // Without a daemon the log alone has it.
        let _ = self.connect().and_then(|mut connection| connection.note(text));
    }
}

/// One client's way to the board.
#[derive(Debug)]
pub struct Board {
    place: Place,
    /// Jogs without an end go on when the client is gone.
    keeps_jogs: bool,
    connection: Option<Connection>,
    in_buffer: bool,
    /// A motor may still jog that `pmacd` stops with the client.
    has_jogs: bool,
    /// When the gateway last told `pmacd` that the client and the gateway are alive.
    renewed: Instant,
}

impl Board {
    /// Not connected yet. A jog without an end (`J+`) ends with the client, or with this program, unless `keeps_jogs`.
    #[must_use]
    pub fn new(place: Place, keeps_jogs: bool) -> Self {
        let renewed = Instant::now();
        Self { place, keeps_jogs, connection: None, in_buffer: false, has_jogs: false, renewed }
    }

    /// Whether lines enter a program buffer that this client has opened.
    #[must_use]
    pub fn is_in_buffer(&self) -> bool {
        self.in_buffer
    }

    /// Calls the daemon.
    fn ask<T>(
        &mut self,
        call: impl FnOnce(&mut Connection) -> Result<T, CommandError>,
    ) -> Result<T, CommandError> {
        let mut connection = match self.connection.take() {
            Some(connection) => connection,
            None => self.place.connect()?,
        };
        let answer = call(&mut connection);
        // A broken connection is dropped: the next call opens a new one and checks the board again.
        if matches!(answer, Ok(_) | Err(CommandError::Refused(_))) {
            self.connection = Some(connection);
        }
        answer
    }

    /// Sends `line` and returns the lines of its reply.
    ///
    /// # Errors
    /// [`Failure`].
    pub fn send(&mut self, line: &str) -> Result<Vec<String>, Failure> {
        let meaning = Meaning::of(line);
        let has_end = self.keeps_jogs || !meaning.possible_jogs().any();
        // The board executes a jog even while a program buffer is open. In a program line J is a length: `X10 I5 J-5`.
        let jogs_beside = !has_end && meaning.while_open.acts;
        let enters = meaning.buffer.is_some() || jogs_beside && meaning.while_open.enters;
        if !has_end && (meaning.opens() || self.in_buffer && enters) {
            // `pmacd` does not stop the jogs of a sequence's lines with the client.
            let why = "a line that opens, closes or enters a program buffer has no jog in it; send each on a line of its own";
            return Err(Failure::unsent(NOT_NOW, why));
        }
        if meaning.opens() || self.in_buffer && !jogs_beside {
            return self.send_in_sequence(line, &meaning);
        }
        if meaning.is_close && self.ask(Connection::info)?.open_buffer.is_some_and(|open| open.sequence) {
            // `pmacd` lets every client close any buffer. Here each client closes only his own.
            return Err(Failure::unsent(IN_USE, "the program buffer that is open is somebody else's"));
        }
        let timeout = meaning.deadline(deadlines::PLAIN);
        let begun = Instant::now();
        // This client's own buffer is a sequence. No other open buffer is his, not even one that this program's user
        // opened by hand.
        let send_as = SendAs {
            into_buffer: Some(false),
            while_connected: Some(!has_end),
            silence_ms: (!has_end).then_some(SILENCE_MS),
            ..SendAs::default()
        };
        let sent = self.ask(|connection| connection.send_as(line, timeout, send_as));
        // Dropping the connection ends its jogs.
        self.has_jogs |= !has_end && self.connection.is_some();
        match sent {
            Err(CommandError::Refused(
                error @ (CallError::TimedOut { .. } | CallError::Interrupted { .. }),
            )) if meaning.resets => {
                match error {
                    // The call ended before the time-out: the board has taken the line, and need not answer a reset.
                    CallError::TimedOut { lines } if begun.elapsed() < timeout => Ok(lines),
                    error => Err(Failure::Unanswered(error.to_string())),
                }
            }
            sent => Ok(sent?),
        }
    }

    fn send_in_sequence(&mut self, line: &str, meaning: &Meaning) -> Result<Vec<String>, Failure> {
        // A new sequence in the middle of the program would send the program lines as commands.
        self.renew_buffer()?;
        let was_open = self.in_buffer;
        let timeout = meaning.deadline(deadlines::PLAIN);
        let options = LinesOptions { kind: SEQUENCE, timeout, keep_going: true };
        let mut told = None;
        let goes_on = self.ask(|connection| {
            connection.lines(options).run(&[line], |reply| {
                told = Some(reply.clone());
                true
            })
        });
        let goes_on = match goes_on {
            Err(CommandError::Refused(CallError::Refused { reason })) if !was_open => {
                return Err(Failure::unsent(IN_USE, reason));
            }
            goes_on => goes_on?,
        };
        let reply = told.unwrap_or_default();
        let closes = meaning.buffer == Some(Effect::Closes);
        self.in_buffer = goes_on && if reply.failure.is_some() { was_open } else { !closes };
        if goes_on && !self.in_buffer {
            // The end of the sequence closes a buffer that a refused line has opened.
            let options = LinesOptions { kind: SEQUENCE, timeout, keep_going: true };
            self.ask(|connection| connection.lines(options).finish())?;
        }
        match reply.failure {
            None if goes_on => Ok(reply.lines),
            None => Err(Failure::Gone("the sequence ended before the line was answered".to_owned())),
            Some(failure) if failure.outcome == LineOutcome::Refused => {
                let code = failure.code.unwrap_or(UNKNOWN);
                Err(Failure::Refused { code, lines: reply.lines, why: None, is_sent: true })
            }
            Some(failure) if failure.outcome == LineOutcome::NotSent => {
                let code = match (was_open, self.in_buffer) {
                    (false, _) => IN_USE,
                    (true, true) => NOT_NOW,
                    (true, false) => NO_BUFFER,
                };
                Err(Failure::unsent(code, failure.message))
            }
            Some(failure) => Err(Failure::Gone(failure.message)),
        }
    }

    /// Whether a motor may jog that `pmacd` stops when the client is gone.
    #[must_use]
    pub const fn has_jogs(&self) -> bool {
        self.has_jogs
    }

    /// The time until the next [`Self::renew`]; `None`: never.
    #[must_use]
    pub fn renews_in(&self) -> Option<Duration> {
        if self.has_jogs { Some(RENEW_JOGS) } else { self.in_buffer.then_some(RENEW_BUFFER) }
    }

    /// Tells `pmacd` that the client is alive, if the client has an open buffer or jogging motors.
    ///
    /// # Errors
    /// [`NO_BUFFER`] when the client has lost the buffer.
    pub fn renew(&mut self) -> Result<(), Failure> {
        if self.has_jogs && self.renewed.elapsed() >= RENEW_JOGS {
            // Without an answer the connection is dropped, and `pmacd` ends its jogs.
            self.has_jogs = self.ask(Connection::jog_renew).is_ok_and(|motors| !motors.is_empty());
            self.renewed = Instant::now();
        }
        self.renew_buffer()
    }

    fn renew_buffer(&mut self) -> Result<(), Failure> {
        if !self.in_buffer {
            return Ok(());
        }
        self.ask(Connection::sequence_renew).map_err(|error| {
            self.in_buffer = false;
            Failure::unsent(NO_BUFFER, format!("the program buffer is open no more: {error}"))
        })
    }

    /// Sends a control character, and returns the lines of its reply.
    ///
    /// # Errors
    /// [`Failure`].
    pub fn control(&mut self, character: u8) -> Result<Vec<String>, Failure> {
        Ok(self.ask(|connection| connection.control(character))?)
    }

    /// The board's family.
    ///
    /// # Errors
    /// [`Failure`].
    pub fn family(&mut self) -> Result<&'static Family, Failure> {
        let family = self.ask(Connection::info)?.family;
        Family::by_name(&family).map_err(|error| Failure::unsent(NOT_NOW, error.to_string()))
    }

    /// Reads `count` bytes of the DPRAM. Refuses the words of command lines and responses: other clients' lines pass
    /// there, too, and may be passwords.
    ///
    /// # Errors
    /// [`Failure`].
    pub fn read(&mut self, first: u16, count: usize) -> Result<Vec<u8>, Failure> {
        let skipped = usize::from(first & 1);
        let words = (skipped + count).div_ceil(2);
        let family = self.family()?;
        if family.ascii.has_text_in(HostOffset::new(u32::from(first & !1)), words) {
            return Err(Failure::unsent(NO_RIGHT, "command lines and responses lie there, of others, too"));
        }
        let mut bytes = Vec::with_capacity(2 * words);
        while bytes.len() < 2 * words {
            let offset = u32::from(first & !1) + u32::try_from(bytes.len()).unwrap_or(u32::MAX);
            let part = (words - bytes.len() / 2).min(READ_MAX);
            let (_, read) = self.ask(|connection| connection.read(HostOffset::new(offset), part))?;
            bytes.extend(read.into_iter().flat_map(u16::to_le_bytes));
        }
        Ok(bytes.into_iter().skip(skipped).take(count).collect())
    }

    /// Writes bytes of the DPRAM, each with the mask of the bits to change. `pmacd` refuses words that a function owns.
    ///
    /// # Errors
    /// [`Failure`]. After [`Failure::Gone`] a part of the words may be written.
    pub fn write(&mut self, first: u16, bytes: &[(u8, u8)]) -> Result<(), Failure> {
        let mut padded = vec![(0, 0); usize::from(first & 1)];
        padded.extend_from_slice(bytes);
        let words: Vec<(u16, u16)> = padded
            .chunks(2)
            .map(|pair| {
                let (high, high_mask) = pair.get(1).copied().unwrap_or((0, 0));
                let (low, low_mask) = pair.first().copied().unwrap_or((0, 0));
                (u16::from_le_bytes([low, high]), u16::from_le_bytes([low_mask, high_mask]))
            })
            .collect();
        let mut offset = u32::from(first & !1);
        for (index, part) in words.chunks(READ_MAX).enumerate() {
            let written = self.ask(|connection| connection.write(HostOffset::new(offset), part, false));
            match written.map_err(Failure::from) {
                Err(Failure::Refused { why, .. }) if index > 0 => {
                    let why = why.unwrap_or_default();
                    return Err(Failure::Gone(format!(
                        "a part of the bytes is written, the rest not: {why}"
                    )));
                }
                written => written?,
            }
            offset += u32::try_from(2 * part.len()).unwrap_or(u32::MAX);
        }
        Ok(())
    }
}
