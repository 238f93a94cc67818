//! One client of the command socket: its buffers, its wait, and whether it is still connected.
//!
//! Nothing here blocks. Every buffer is bounded, and the server drops a client that stops half-way for too long.

use std::borrow::Cow;
use std::io::{self, Read, Write};
use std::net::Shutdown;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use nix::poll::PollFlags;
use nix::sys::socket::{MsgFlags, recv};
use serde::Deserialize;

use super::policy::{Peer, Role};
use crate::daemon::shared::queue::{REASON_MAX, Text, Unsolicited};
use crate::protocol::program_words::ASKS_FIRST;
use crate::protocol::{BOARD, CALL_MAX, CallError, Inbox, Message, Reply, frame::TooLong, message::encode};

/// The server begins no further call while this much output waits, in bytes.
pub(super) const HIGH_WATER: usize = 64 * 1024;
/// The longest call of an observer, in bytes. A watch of all 128 registers needs about 2 KiB.
const OBSERVER_CALL_MAX: usize = 8 * 1024;
/// How many unread bytes of a client the server looks at. If more are unread, all of them count as sent before the stop
/// until the server has read everything.
const UNREAD_MAX: usize = 256 * 1024;
/// The server counts unsolicited texts as lost while this much output waits, in bytes.
const STREAM_HIGH_WATER: usize = 256 * 1024;

/// The methods that may stop the machine, or keep a jog held.
const URGENT: [&str; 6] = ["SendControl", "Panel", "PanelHold", "PanelRenew", "JogRenew", "FeedOverride"];

/// The method of a call.
#[derive(Deserialize)]
struct Named<'a> {
    #[serde(borrow)]
    method: Cow<'a, str>,
}

/// Whether `call` is to one of these methods, whatever its parameters.
fn is_urgent(call: &[u8]) -> bool {
    let method = serde_json::from_slice(call).map(|Named { method }| method);
    let name = method.as_deref().ok().and_then(|method| method.strip_prefix(BOARD)?.strip_prefix('.'));
    name.is_some_and(|name| URGENT.contains(&name))
}

/// The event that a client waits for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Waiting {
    /// Nothing: the client's next call can begin.
    Nothing,
    /// The board, whose answer `CallTable` awaits.
    Board,
    /// Unsolicited texts, with the number of texts lost since the client got the last.
    Messages(u64),
    /// Nothing more: the client watches variables as long as it stays.
    Watch,
}

/// One connection.
#[derive(Debug)]
pub(super) struct Client {
    stream: UnixStream,
    peer: Peer,
    /// Readable once the process that connected has ended.
    process: Option<OwnedFd>,
    role: Role,
    waiting: Waiting,
    /// The client has had its turn, and may have more calls to begin.
    has_more: bool,
    /// The time of the last call; before the first call ([`Self::has_spoken`]), the time of the client's arrival.
    heard: Instant,
    /// The client has made a call.
    has_spoken: bool,
    inbox: Inbox,
    outbox: Vec<u8>,
    half_sent_since: Option<Instant>,
    stalled_since: Option<Instant>,
    /// The client will send no more.
    input_ended: bool,
    /// The client will read no more either.
    hung_up: bool,
    /// The connection ends as soon as the server has sent its output.
    closing: bool,
    /// The server has told the client to ask again, as the daemon does not use the function yet.
    asks_again: bool,
    /// A stop of all motion came after this many of the client's bytes, for this reason.
    outdated: Option<(usize, Text<REASON_MAX>)>,
    /// More bytes than that are unread, an unknown number.
    outdated_unread: bool,
    /// The reason, if the client sent the last call before the stop.
    call_outdated: Option<Text<REASON_MAX>>,
}

impl Client {
    pub(super) fn new(stream: UnixStream, peer: Peer, role: Role, now: Instant) -> Self {
        Self {
            stream,
            peer,
            process: None,
            role,
            waiting: Waiting::Nothing,
            has_more: false,
            heard: now,
            has_spoken: false,
            inbox: Inbox::new(if role == Role::Observe { OBSERVER_CALL_MAX } else { CALL_MAX }),
            outbox: Vec::new(),
            half_sent_since: None,
            stalled_since: None,
            input_ended: false,
            hung_up: false,
            closing: false,
            asks_again: false,
            outdated: None,
            outdated_unread: false,
            call_outdated: None,
        }
    }

    /// The same connection, which ends with the process of this descriptor ([`super::peer_process`]).
    pub(super) fn of_process(self, process: Option<OwnedFd>) -> Self {
        Self { process, ..self }
    }

    /// The descriptor that becomes readable once the process that connected has ended.
    pub(super) fn process(&self) -> Option<BorrowedFd<'_>> {
        self.process.as_ref().map(OwnedFd::as_fd)
    }

    /// A stop of all motion is under way, for this `reason`: no call that the client has sent up to now, read or not,
    /// begins anything.
    pub(super) fn outdate(&mut self, reason: Text<REASON_MAX>) {
        let mut unread = vec![0; UNREAD_MAX];
        let flags = MsgFlags::MSG_PEEK | MsgFlags::MSG_DONTWAIT;
        let unread = recv(self.stream.as_raw_fd(), &mut unread, flags).unwrap_or_default();
        let sent = self.inbox.held().len() + unread;
        self.outdated = (sent > 0).then_some((sent, reason));
        self.outdated_unread = unread == UNREAD_MAX;
    }

    /// Why the last call taken begins nothing: the client sent it before a stop of all motion.
    pub(super) fn call_outdated(&self) -> Option<Text<REASON_MAX>> {
        self.call_outdated
    }

    /// Whether the refusal `error` is worth a line of the log. A refusal repeated while the client waits for a function
    /// is not.
    pub(super) fn is_worth_telling(&mut self, error: &CallError) -> bool {
        let waits = matches!(error, CallError::Refused { reason } if reason.contains(ASKS_FIRST));
        let asked = std::mem::replace(&mut self.asks_again, waits);
        !(matches!(error, CallError::Busy) || asked && waits)
    }

    /// The client got a reply that is no refusal.
    pub(super) fn was_served(&mut self) {
        self.asks_again = false;
    }

    /// The process at the other end.
    pub(super) fn peer(&self) -> Peer {
        self.peer
    }

    /// The client's rights.
    pub(super) fn role(&self) -> Role {
        self.role
    }

    /// From now on the client waits for this event.
    pub(super) fn wait_for(&mut self, what: Waiting) {
        self.waiting = what;
    }

    /// Whether the client waits for anything.
    pub(super) fn waits(&self) -> bool {
        self.waiting != Waiting::Nothing
    }

    /// Whether the client waits for the board.
    pub(super) fn waits_for_board(&self) -> bool {
        self.waiting == Waiting::Board
    }

    /// Whether the client's next call may stop the machine, or keep a jog held: the server serves such a client before
    /// all others.
    pub(super) fn is_urgent(&self) -> bool {
        let call = || self.inbox.held().split(|byte| *byte == 0).next().unwrap_or_default();
        self.role >= Role::Stop && !self.waits() && is_urgent(call())
    }

    /// Whether the client has had its turn, and may have more calls to begin.
    pub(super) fn has_more(&self) -> bool {
        self.has_more
    }

    /// Ends the client's turn.
    pub(super) fn yields(&mut self) {
        self.has_more = true;
    }

    /// The events to poll for; `None` after a hang-up.
    pub(super) fn interest(&self) -> Option<PollFlags> {
        let mut flags = PollFlags::empty();
        flags.set(PollFlags::POLLIN, !self.input_ended && !self.closing && !self.inbox.is_full());
        flags.set(PollFlags::POLLOUT, !self.outbox.is_empty());
        // The poll would report a hang-up again and again.
        (!self.hung_up).then_some(flags)
    }

    /// Reads the bytes that have arrived, as far as the inbox has room.
    pub(super) fn receive(&mut self, now: Instant) {
        let mut chunk = [0; 8192];
        while !self.input_ended && !self.closing && !self.inbox.is_full() {
            match self.stream.read(&mut chunk) {
                Ok(0) => self.input_ended = true,
                Ok(count) => {
                    self.inbox.push(&chunk[..count]);
                    if count < chunk.len() {
                        self.outdated_unread = false;
                    }
                    if count < chunk.len() && !self.hung_up {
                        // The server has read all bytes. The poll reports later ones.
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
        let half_sent = !self.waits() && self.inbox.is_half_sent();
        self.half_sent_since = half_sent.then(|| self.half_sent_since.unwrap_or(now));
    }

    /// The other end is gone: replies go nowhere. Its bytes are still readable. A forked process that has its
    /// descriptor can send no more.
    pub(super) fn hang_up(&mut self) {
        // The shutdown fails if no process has the other descriptor any more.
        let _ = self.stream.shutdown(Shutdown::Both);
        self.hung_up = true;
        self.outbox.clear();
        self.stalled_since = None;
    }

    /// Whether replies still reach the client.
    pub(super) fn hears(&self) -> bool {
        !self.hung_up
    }

    /// The next call, if the client has sent one and it may begin now.
    ///
    /// # Errors
    /// [`TooLong`] when a message has outgrown the limit: the server cannot follow the stream further.
    pub(super) fn next_call(&mut self, now: Instant) -> Result<Option<Vec<u8>>, TooLong> {
        self.has_more = false;
        if self.closing || self.waits() || self.outbox.len() > HIGH_WATER {
            return Ok(None);
        }
        if self.hung_up {
            self.receive(now);
        }
        let held = self.inbox.held().len();
        let call = self.inbox.next_message();
        let taken = held - self.inbox.held().len();
        self.call_outdated = self.outdated.map(|(_, reason)| reason);
        let is_left = |(sent, _): &(usize, _)| *sent > taken || self.outdated_unread;
        self.outdated = self.outdated.filter(is_left).map(|(sent, why)| (sent.saturating_sub(taken), why));
        if matches!(call, Ok(Some(_))) {
            (self.heard, self.has_spoken) = (now, true);
        }
        // The clock of a half-sent message starts anew with each message.
        self.half_sent_since = None;
        self.note_half_sent(now);
        call
    }

    /// Queues `reply` and sends as much as the socket takes.
    pub(super) fn reply(&mut self, reply: &Reply, now: Instant) {
        if self.hears() {
            self.outbox.extend_from_slice(&encode(reply));
            self.flush(now);
        }
    }

    /// Passes an unsolicited text on, if the client streams them; counts the text as lost while too much output waits.
    pub(super) fn pass_on(&mut self, text: &Unsolicited, now: Instant) {
        let Waiting::Messages(lost) = &mut self.waiting else { return };
        if self.outbox.len() > STREAM_HIGH_WATER {
            *lost += 1;
            return;
        }
        let message = Message {
            time_ns: text.time_ns,
            kind: text.kind,
            text: text.text.to_latin1(),
            lost: std::mem::take(lost),
        };
        if let Ok(reply) = Reply::with(&message) {
            self.reply(&Reply { continues: Some(true), ..reply }, now);
        }
    }

    /// How many bytes wait for the client to fetch them.
    pub(super) fn unsent(&self) -> usize {
        self.outbox.len()
    }

    /// Sends as much as the socket takes.
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
            // Frees the memory of a long reply.
            self.outbox = Vec::new();
        }
        self.stalled_since = match self.stalled_since {
            _ if self.outbox.is_empty() => None,
            Some(since) if sent == 0 => Some(since),
            _ => Some(now),
        };
    }

    /// Ends the connection as soon as the server has sent its output.
    pub(super) fn close(&mut self) {
        self.closing = true;
        self.half_sent_since = None;
    }

    /// Whether the connection can be removed.
    pub(super) fn is_finished(&self) -> bool {
        let unheard = self.hung_up || self.outbox.is_empty();
        match self.waiting {
            _ if self.closing => unheard,
            // The bus thread still has to answer the client's command.
            Waiting::Board => false,
            Waiting::Messages(_) => self.hung_up,
            Waiting::Watch => self.hung_up || self.input_ended,
            Waiting::Nothing if self.has_more => false,
            Waiting::Nothing => self.hung_up || (self.input_ended && self.outbox.is_empty()),
        }
    }

    /// Whether the client has made no call since its arrival, at least `patience` ago.
    pub(super) fn is_silent(&self, now: Instant, patience: Duration) -> bool {
        !self.has_spoken && now.duration_since(self.heard) >= patience
    }

    /// Whether the client has made a call, and the time of its last call or arrival. The client whose place is needed
    /// least sorts first.
    pub(super) fn last_heard(&self) -> (bool, Instant) {
        (self.has_spoken, self.heard)
    }

    /// Whether nothing of the client is under way: it waits for nothing, and the server has answered all its calls and
    /// sent all answers.
    pub(super) fn is_idle(&self) -> bool {
        let nothing_here = self.inbox.held().is_empty() && self.outbox.is_empty() && !self.has_more;
        let flags = MsgFlags::MSG_PEEK | MsgFlags::MSG_DONTWAIT;
        let has_unread = || recv(self.stream.as_raw_fd(), &mut [0], flags).is_ok_and(|count| count > 0);
        !self.waits() && nothing_here && !has_unread()
    }

    /// When to drop the client if nothing happens: it has left a message half sent, or output unfetched, for
    /// `patience`.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_waits_for_a_function_is_told_of_once() {
        let (stream, _other) = UnixStream::pair().unwrap();
        let peer = Peer { uid: 0.into(), gid: 0.into(), pid: 1 };
        let mut client = Client::new(stream, peer, Role::Engineer, Instant::now());
        let refused = |reason: &str| CallError::Refused { reason: reason.to_owned() };
        let waits = |read: u32| refused(&format!("not used yet: {ASKS_FIRST} ({read} of 8192 read)"));
        let told = [waits(0), waits(50), waits(100), refused("another"), waits(150), CallError::Busy];
        assert_eq!(
            told.map(|error| client.is_worth_telling(&error)),
            [true, false, false, true, true, false]
        );
    }

    #[test]
    fn what_is_urgent_is_known_by_the_name_of_the_method_alone() {
        let call = |method: &str, line: &str| {
            let parameters = serde_json::json!({"line": line});
            serde_json::json!({"parameters": parameters, "method": format!("{BOARD}.{method}")}).to_string()
        };
        for method in URGENT {
            assert!(is_urgent(call(method, "").as_bytes()), "{method}");
            assert!(is_urgent(call(method, "").replace("Board", "\\u0042oard").as_bytes()), "{method}");
            assert!(
                !is_urgent(call("Send", &format!(".{method}\"")).as_bytes()),
                "a line that names {method}"
            );
            assert!(!is_urgent(format!("{{\"method\":\"{BOARD}.{method}\"").as_bytes()), "not whole");
        }
        assert!(!is_urgent(call("PanelX", "").as_bytes()) && !is_urgent(b"") && !is_urgent(b"[1]"));
    }
}
