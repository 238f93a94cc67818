//! One client of the command socket: its buffers, what it waits for, and when it has gone.
//!
//! Nothing here waits. Every buffer is bounded, and a client that stops half-way is found by the clock.

use std::io::{self, Read, Write};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use nix::poll::PollFlags;

use super::jobs::JobCall;
use super::policy::{Peer, Role};
use crate::daemon::shared::queue::Ticket;
use crate::function::variable_read::VariableEntry;
use crate::protocol::{CALL_MAX, Inbox, Reply, frame::TooLong, message::encode};

/// No further call is begun while this much output waits, in bytes.
const HIGH_WATER: usize = 64 * 1024;
/// The longest call of an observer, in bytes. A watch of all 128 registers needs about 2 KiB.
const OBSERVER_CALL_MAX: usize = 8 * 1024;
/// Unsolicited texts are counted as lost while this much output waits, in bytes.
const STREAM_HIGH_WATER: usize = 256 * 1024;

/// A call that the board has not answered yet.
#[derive(Debug)]
pub(super) struct Pending {
    pub(super) ticket: Ticket,
    /// Nobody wants the reply.
    pub(super) oneway: bool,
    /// When to stop believing that the bus thread will answer.
    pub(super) deadline: Instant,
    /// The reply so far.
    pub(super) lines: Vec<String>,
    /// Its length in bytes.
    pub(super) length: usize,
    /// What waits for this answer, and begins if it is what its guard wants.
    pub(super) then: Option<Then>,
    /// The motors whose jog is over for this client when the board has taken the job.
    pub(super) stops: u8,
    /// What it answers when all goes well.
    pub(super) answer: Answer,
}

impl Pending {
    /// The call of `ticket`, whose lines are its answer.
    pub(super) fn new(ticket: Ticket, oneway: bool, deadline: Instant) -> Self {
        let (lines, answer) = (Vec::new(), Answer::Lines);
        Self { ticket, oneway, deadline, lines, length: 0, then: None, stops: 0, answer }
    }
}

/// What waits for the board's answer to a question.
#[derive(Debug)]
pub(super) enum Then {
    /// A job.
    Job(JobCall),
    /// A watch on these registers.
    Watch(Vec<VariableEntry>),
}

/// What a call answers when all goes well.
#[derive(Debug, Clone)]
pub(super) enum Answer {
    /// The lines of the board's reply.
    Lines,
    /// Nothing but that it is done.
    Done,
    /// Remarks.
    Notes(Vec<String>),
}

/// What a client waits for.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "one a connection, and most connections wait for the board")]
pub(super) enum Waiting {
    /// Nothing: its next call can begin.
    Nothing,
    /// The board.
    Board(Pending),
    /// Unsolicited texts, of which so many were dropped since the last one it got.
    Messages(u64),
    /// Nothing more: it watches variables as long as it stays.
    Watch,
}

/// One connection.
#[derive(Debug)]
pub(super) struct Client {
    stream: UnixStream,
    pub(super) peer: Peer,
    pub(super) role: Role,
    pub(super) waiting: Waiting,
    /// It has had its turn, and may have more calls to begin.
    pub(super) has_more: bool,
    connected: Instant,
    /// It has asked something.
    has_spoken: bool,
    inbox: Inbox,
    outbox: Vec<u8>,
    half_sent_since: Option<Instant>,
    stalled_since: Option<Instant>,
    /// It will send no more.
    input_ended: bool,
    /// It will read no more either.
    hung_up: bool,
    /// It is to go as soon as its output is out.
    closing: bool,
}

impl Client {
    pub(super) fn new(stream: UnixStream, peer: Peer, role: Role, now: Instant) -> Self {
        Self {
            stream,
            peer,
            role,
            waiting: Waiting::Nothing,
            has_more: false,
            connected: now,
            has_spoken: false,
            inbox: Inbox::new(if role == Role::Observe { OBSERVER_CALL_MAX } else { CALL_MAX }),
            outbox: Vec::new(),
            half_sent_since: None,
            stalled_since: None,
            input_ended: false,
            hung_up: false,
            closing: false,
        }
    }

    /// What to poll for; `None` when the poll has nothing more to tell.
    pub(super) fn interest(&self) -> Option<PollFlags> {
        let mut flags = PollFlags::empty();
        flags.set(PollFlags::POLLIN, !self.input_ended && !self.closing && !self.inbox.is_full());
        flags.set(PollFlags::POLLOUT, !self.outbox.is_empty());
        // A hang-up is reported whether asked for or not, again and again.
        (!self.hung_up).then_some(flags)
    }

    /// Takes in what has arrived, as far as there is room.
    pub(super) fn receive(&mut self, now: Instant) {
        let mut chunk = [0; 8192];
        while !self.input_ended && !self.closing && !self.inbox.is_full() {
            match self.stream.read(&mut chunk) {
                Ok(0) => self.input_ended = true,
                Ok(count) => {
                    self.inbox.push(&chunk[..count]);
                    if count < chunk.len() && !self.hung_up {
                        // That was all; the poll tells of more.
                        break;
                    }
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
                Err(_) => {
                    self.input_ended = true;
                    self.hang_up();
                }
            }
        }
        self.note_half_sent(now);
    }

    fn note_half_sent(&mut self, now: Instant) {
        let half_sent = matches!(self.waiting, Waiting::Nothing) && self.inbox.is_half_sent();
        self.half_sent_since = half_sent.then(|| self.half_sent_since.unwrap_or(now));
    }

    /// Notes that nobody is there to hear a reply.
    pub(super) fn hang_up(&mut self) {
        self.hung_up = true;
        self.outbox.clear();
        self.stalled_since = None;
    }

    /// Whether replies reach anybody.
    pub(super) fn hears(&self) -> bool {
        !self.hung_up
    }

    /// The next call, when one is there and may begin now.
    ///
    /// # Errors
    /// [`TooLong`] when the stream cannot be followed further.
    pub(super) fn next_call(&mut self, now: Instant) -> Result<Option<Vec<u8>>, TooLong> {
        if self.closing || !matches!(self.waiting, Waiting::Nothing) || self.outbox.len() > HIGH_WATER {
            return Ok(None);
        }
        if self.hung_up {
            self.receive(now);
        }
        let call = self.inbox.next_message();
        self.has_spoken |= matches!(call, Ok(Some(_)));
        // The clock of a half-sent message starts anew with each message.
        self.half_sent_since = None;
        self.note_half_sent(now);
        call
    }

    /// Puts `reply` behind what is already to be sent, and sends what goes.
    pub(super) fn reply(&mut self, reply: &Reply, now: Instant) {
        if self.hears() {
            self.outbox.extend_from_slice(&encode(reply));
            self.flush(now);
        }
    }

    /// Whether one more unsolicited text may be put behind what is already to be sent.
    pub(super) fn keeps_up(&self) -> bool {
        self.outbox.len() <= STREAM_HIGH_WATER
    }

    /// Bytes that wait to be fetched.
    pub(super) fn unsent(&self) -> usize {
        self.outbox.len()
    }

    /// Sends what goes.
    pub(super) fn flush(&mut self, now: Instant) {
        let mut sent = 0;
        while sent < self.outbox.len() {
            match self.stream.write(&self.outbox[sent..]) {
                Ok(count) => sent += count,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
                Err(_) => return self.hang_up(),
            }
        }
        self.outbox.drain(..sent);
        if self.outbox.is_empty() && self.outbox.capacity() > HIGH_WATER {
            // What one long reply took is not kept for the next one.
            self.outbox = Vec::new();
        }
        self.stalled_since = match self.stalled_since {
            _ if self.outbox.is_empty() => None,
            Some(since) if sent == 0 => Some(since),
            _ => Some(now),
        };
    }

    /// Lets it go as soon as its output is out.
    pub(super) fn close(&mut self) {
        self.closing = true;
        self.half_sent_since = None;
    }

    /// Whether nothing is left to be done for it.
    pub(super) fn is_finished(&self) -> bool {
        let unheard = self.hung_up || self.outbox.is_empty();
        match self.waiting {
            _ if self.closing => unheard,
            // Its command is under way; the reply is the end of it.
            Waiting::Board(_) => false,
            Waiting::Messages(_) => self.hung_up,
            Waiting::Watch => self.hung_up || self.input_ended,
            Waiting::Nothing if self.has_more => false,
            Waiting::Nothing => self.hung_up || (self.input_ended && self.outbox.is_empty()),
        }
    }

    /// Whether it has not asked anything since it came, for `patience` at least.
    pub(super) fn is_silent(&self, now: Instant, patience: Duration) -> bool {
        !self.has_spoken && now.duration_since(self.connected) >= patience
    }

    /// When it is to be dropped if nothing happens: a message half sent, or output not fetched, for `patience`.
    pub(super) fn patience_ends(&self, patience: Duration) -> Option<Instant> {
        let stalled = self.stalled_since.filter(|_| !matches!(self.waiting, Waiting::Messages(_)));
        let since = [self.half_sent_since, stalled].into_iter().flatten().min()?;
        since.checked_add(patience)
    }
}

impl AsFd for Client {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.stream.as_fd()
    }
}
