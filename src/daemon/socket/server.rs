//! The command socket's server: one thread, one poll over the listener, the clients, the bus thread's events and stop.
//!
//! It never waits for a client and never holds up the bus thread: whatever a client does, or does not do, costs at most
//! its own bounded buffers. Each connection has one call under way at a time, so replies keep the order of the calls;
//! a ticket brings every event of the bus thread back to the call it belongs to. Nobody is served first for asking
//! most: a connection begins a few calls a round, its user is served for a share of
//! the round (`time_quota`), and commands for the board take turns (`fair_queue`).

mod admission;
mod calls;
pub mod stepper;

use std::collections::{BTreeMap, HashMap};
use std::io;
use std::os::fd::AsFd;
use std::path::PathBuf;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use log::{error, info};
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::eventfd::{EfdFlags, EventFd};

use self::admission::Admission;
use super::audit::AuditLimit;
use super::connection::{Answer, Client, Pending, Waiting};
use super::fair_queue::FairQueue;
use super::leases::Leases;
use super::listener::{ListenError, Listener};
use super::policy::{Peer, Policy, PolicyError, Roles};
use super::time_quota::TimeQuotas;
use super::watches::Watches;
use crate::daemon::shared::info::Info;
use crate::daemon::shared::queue::{Command, Event, Outcome, Receive, Sender, Ticket, Unsolicited};
use crate::map::errors::meaning;
use crate::protocol::board::RotaryStateReply;
use crate::protocol::board::{NotesReply, ReadReply, SendReply};
use crate::protocol::{Call, CallError, Message, Reply};

/// How much longer than asked the bus thread may take before it is not believed to answer at all: more than a port takes to
/// be silent again after it gave up on a line (1 s), less than a client waits for the daemon (2 s).
pub(super) const GRACE: Duration = Duration::from_millis(1500);
/// Calls a connection may begin before others have their turn.
const CALLS_A_TURN: usize = 8;
/// The longest reply of the board that is collected, in bytes.
const COLLECT_MAX: usize = 1024 * 1024;

/// The settings of the command socket.
#[derive(Debug, Clone)]
pub struct ServeOptions {
    /// Where it lies: `/run/pmacd/pmac0.sock`.
    pub path: PathBuf,
    /// Who may connect, as file mode bits.
    pub mode: u32,
    /// The group of the file, when it is not the daemon's own.
    pub group: Option<String>,
    /// The groups that raise a user's role.
    pub roles: Roles,
    /// The most connections at a time; fewer where the limit of open files is lower.
    pub max_clients: usize,
    /// The most connections of one user. Root and the daemon's user are exempt from this limit but, like everyone, not from the reserve:
    /// the last eighth is for users who hold fewer than four, and half of it for those who may operate.
    pub max_clients_per_user: usize,
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
            patience: Duration::from_secs(10),
        }
    }

    /// Puts the socket in its place. A separate step, so that it can happen before privileges are given up.
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
    /// A group in the settings is not to be had.
    #[error(transparent)]
    Policy(#[from] PolicyError),
    /// The system gave no descriptor or no thread.
    #[error("starting the command socket's thread: {0}")]
    Io(#[from] io::Error),
}

/// What the server stands between: the queues of the bus thread, and what `GetInfo` answers.
pub struct Backend {
    /// To the bus thread.
    pub commands: Sender<Command>,
    /// From the bus thread. It must deliver the events of a ticket in order and without gaps, [`Outcome`] last; what
    /// it cannot deliver at once it has to keep.
    pub events: Receive<Event>,
    /// What `GetInfo` answers; kept up to date by [`Event::Info`].
    pub info: Info,
}

/// The running server. Stops when told to, or when dropped.
pub struct Server {
    stop: Arc<EventFd>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Ends every connection, removes the socket, and waits for the thread (which waits for nobody).
    pub fn stop(mut self) {
        self.end();
    }

    fn end(&mut self) {
        if let Some(thread) = self.thread.take() {
            let _ = self.stop.write(1);
            if thread.join().is_err() {
                error!("the command socket's thread panicked");
            }
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.end();
    }
}

/// Starts to serve the board on `listener`.
///
/// # Errors
/// [`ServeError`] when a group is unknown or the system gives no thread.
pub fn serve(options: &ServeOptions, listener: Listener, backend: Backend) -> Result<Server, ServeError> {
    let flags = EfdFlags::EFD_NONBLOCK | EfdFlags::EFD_CLOEXEC;
    let stop = Arc::new(EventFd::from_value_and_flags(0, flags).map_err(io::Error::from)?);
    let service = Service::new(options, listener, backend)?;
    let waker = Arc::clone(&stop);
    let thread = std::thread::Builder::new().name("socket".to_owned()).spawn(move || service.run(&waker))?;
    Ok(Server { stop, thread: Some(thread) })
}

struct Service {
    options: ServeOptions,
    policy: Policy,
    listener: Listener,
    admission: Admission,
    backend: Backend,
    clients: BTreeMap<u64, Client>,
    /// Whose call each ticket is.
    owners: HashMap<Ticket, u64>,
    quotas: TimeQuotas,
    /// The calls that the bus thread has not answered, as it gets them.
    queue: FairQueue,
    audit: AuditLimit,
    leases: Leases,
    watches: Watches,
    next_client: u64,
    next_ticket: u64,
}

impl Service {
    pub(super) fn new(
        options: &ServeOptions,
        listener: Listener,
        backend: Backend,
    ) -> Result<Self, PolicyError> {
        Ok(Self {
            policy: Policy::new(&options.roles)?,
            admission: Admission::new(options),
            options: options.clone(),
            listener,
            watches: Watches::new(backend.info.settings().plan.variable_read_entries as usize),
            backend,
            clients: BTreeMap::new(),
            owners: HashMap::new(),
            quotas: TimeQuotas::default(),
            queue: FairQueue::default(),
            audit: AuditLimit::default(),
            leases: Leases::default(),
            next_client: 0,
            next_ticket: 0,
        })
    }

    fn run(mut self, stop: &EventFd) {
        loop {
            let ready = match self.wait(stop, self.timeout()) {
                Ok(ready) => ready,
                Err(nix::Error::EINTR) => continue,
                Err(errno) => {
                    error!("the command socket stops: poll: {errno}");
                    break;
                }
            };
            if ready.stop {
                break;
            }
            self.round(ready, Instant::now());
        }
        self.end_all_leases();
        self.end(Instant::now());
    }

    /// Does all there is to be done now.
    pub(super) fn round(&mut self, ready: Ready, now: Instant) {
        if ready.events {
            self.backend.events.clear();
        }
        // Woken or not: the lines of a reply come without a wake, and may have to be told before its end.
        while let Some(event) = self.backend.events.try_receive() {
            self.on_event(event, now);
        }
        self.serve_ready(ready.clients, now);
        if ready.listener {
            self.accept(now);
        }
        self.expire(now);
        self.end_leases(now, false);
        let (owners, watches) = (&mut self.owners, &mut self.watches);
        let before = self.clients.len();
        self.clients.retain(|id, client| {
            let stays = !client.is_finished();
            if !stays {
                watches.forget(*id);
            }
            if let (false, Waiting::Board(pending)) = (stays, &client.waiting) {
                owners.remove(&pending.ticket);
            }
            stays
        });
        if self.clients.len() < before {
            // There is a descriptor again.
            self.admission.pause = None;
        }
        self.tell_subscriptions(now);
        self.hand_out(now);
    }

    pub(super) fn end(&mut self, now: Instant) {
        // Nobody will be there to hold a jog; the bus thread still does this before it ends.
        self.end_leases(now, true);
        self.farewell(now);
    }

    /// How long nothing need be done unless something happens.
    fn timeout(&self) -> PollTimeout {
        match self.next_deadline() {
            _ if self.queue.has_next() || self.clients.values().any(|client| client.has_more) => {
                PollTimeout::ZERO
            }
            None => PollTimeout::NONE,
            Some(deadline) => {
                let left = deadline.saturating_duration_since(Instant::now()) + Duration::from_millis(1);
                PollTimeout::try_from(left).unwrap_or(PollTimeout::MAX)
            }
        }
    }

    pub(super) fn wait(&self, stop: &EventFd, timeout: PollTimeout) -> nix::Result<Ready> {
        let mut ids = Vec::with_capacity(self.clients.len());
        let mut fds = vec![
            PollFd::new(stop.as_fd(), PollFlags::POLLIN),
            PollFd::new(self.backend.events.descriptor(), PollFlags::POLLIN),
            PollFd::new(
                self.listener.as_fd(),
                if self.admission.pause.is_none() { PollFlags::POLLIN } else { PollFlags::empty() },
            ),
        ];
        for (&id, client) in &self.clients {
            if let Some(flags) = client.interest() {
                ids.push(id);
                fds.push(PollFd::new(client.as_fd(), flags));
            }
        }
        // Who did not come to the end of his calls is served again, whether more arrives or not.
        let mut clients: BTreeMap<u64, PollFlags> = (self.clients.iter())
            .filter(|(_, client)| client.has_more)
            .map(|(&id, _)| (id, PollFlags::empty()))
            .collect();
        poll(&mut fds, timeout)?;
        let flags = |fd: &PollFd<'_>| fd.revents().unwrap_or(PollFlags::POLLERR);
        let is_ready = |index: usize| fds.get(index).is_some_and(|fd| flags(fd).contains(PollFlags::POLLIN));
        let polled = ids.iter().zip(&fds[3..]).map(|(&id, fd)| (id, flags(fd)));
        clients.extend(polled.filter(|(_, flags)| !flags.is_empty()));
        let clients = clients.into_iter().collect();
        Ok(Ready { stop: is_ready(0), events: is_ready(1), listener: is_ready(2), clients })
    }

    fn next_deadline(&self) -> Option<Instant> {
        let clients = self.clients.values().flat_map(|client| {
            let pending = match &client.waiting {
                Waiting::Board(pending) => Some(pending.deadline),
                Waiting::Nothing | Waiting::Messages(_) | Waiting::Watch => None,
            };
            [pending, client.patience_ends(self.options.patience)]
        });
        let others =
            [self.admission.pause, self.leases.next_end(), self.audit.next_end(), self.watches.next_try()];
        clients.chain(others).flatten().min()
    }

    /// Serves ready clients within each user's time quota; the rest stay ready for the next round.
    fn serve_ready(&mut self, mut ready: Vec<(u64, PollFlags)>, now: Instant) {
        self.quotas.begin_round();
        let user = |clients: &BTreeMap<u64, Client>, id| clients.get(&id).map(|client| client.peer.uid);
        ready.sort_by_key(|(id, _)| {
            user(&self.clients, *id).is_some_and(|user| self.quotas.comes_later(user, *id))
        });
        let mut began = Instant::now();
        for (id, flags) in ready {
            let Some(user) = user(&self.clients, id) else { continue };
            if self.quotas.has_time(user, id) {
                self.on_ready(id, flags, now);
                let ended = Instant::now();
                self.quotas.used(user, ended - began);
                began = ended;
            }
        }
    }

    fn on_ready(&mut self, id: u64, flags: PollFlags, now: Instant) {
        let Some(client) = self.clients.get_mut(&id) else { return };
        client.receive(now);
        if flags.intersects(PollFlags::POLLHUP | PollFlags::POLLERR | PollFlags::POLLNVAL) {
            client.hang_up();
        }
        if flags.contains(PollFlags::POLLOUT) {
            client.flush(now);
        }
        self.advance(id, now);
    }

    /// Begins the client's calls, one after the other, until one has to wait or others are to have their turn.
    pub(super) fn advance(&mut self, id: u64, now: Instant) {
        for _ in 0..CALLS_A_TURN {
            let Some(client) = self.clients.get_mut(&id) else { return };
            client.has_more = false;
            let message = match client.next_call(now) {
                Ok(None) => return,
                Ok(Some(message)) => message,
                Err(too_long) => {
                    client.reply(&Reply::of_error(&malformed(&too_long)), now);
                    return client.close();
                }
            };
            match serde_json::from_slice::<Call>(&message) {
                Ok(call) => self.begin(id, &call, now),
                Err(error) => {
                    client.reply(&Reply::of_error(&malformed(&error)), now);
                    return client.close();
                }
            }
        }
        if let Some(client) = self.clients.get_mut(&id) {
            client.has_more = true;
        }
    }

    fn on_event(&mut self, event: Event, now: Instant) {
        match event {
            Event::Line(ticket, text) => {
                if let Some(pending) = self.pending(ticket) {
                    pending.length += text.as_bytes().len() + 1;
                    if pending.length <= COLLECT_MAX {
                        pending.lines.push(text.to_latin1());
                    }
                }
            }
            Event::Done(ticket, outcome) => {
                self.queue.over(ticket);
                let refused = self.watches.failed(ticket, outcome, now);
                self.refuse_watches(&refused, outcome, now);
                self.after_stop(ticket, outcome, now);
                let Some(pending) = self.pending(ticket) else { return };
                let lines = std::mem::take(&mut pending.lines);
                let stops = pending.stops;
                if let Some(then) = pending.then.take() {
                    return self.guarded(ticket, then, &lines, outcome, now);
                }
                let reply = match (&pending.answer, outcome) {
                    (Answer::Done, Outcome::Done) => Ok(Reply::done()),
                    (Answer::Notes(notes), Outcome::Done) => {
                        Reply::with(&NotesReply { notes: notes.clone() })
                    }
                    _ => outcome_reply(outcome, lines, pending.length > COLLECT_MAX),
                };
                if let (Outcome::Refused(reason), Some(id)) = (outcome, self.owners.get(&ticket))
                    && let Some(client) = self.clients.get(id)
                {
                    // What was asked has been logged; that it was not done must be too.
                    let Peer { uid, pid, .. } = client.peer;
                    info!(target: "audit", "refused that of uid {uid} pid {pid}: {reason:?}");
                }
                if let Some(&id) = self.owners.get(&ticket) {
                    // A held jog has begun: its holder's time runs from here.
                    self.leases.renew(id, now);
                    if outcome == Outcome::Done {
                        self.leases.stopped(id, stops);
                    }
                }
                self.answer(ticket, reply, now);
            }
            Event::Words { ticket, time_ns, words, count } => {
                self.queue.over(ticket);
                let words = words.iter().copied().take(count).collect();
                self.answer(ticket, Reply::with(&ReadReply { time_ns, words }), now);
            }
            Event::Rotary(ticket, state) => {
                self.queue.over(ticket);
                let reply = RotaryStateReply {
                    ahead_commands: state.ahead_commands,
                    ahead_lines: state.ahead_lines,
                    sent_lines: state.sent_lines,
                    busy: state.busy,
                    error: state.error,
                    underruns: state.underruns,
                };
                self.answer(ticket, Reply::with(&reply), now);
            }
            Event::Watching(ticket, table) => {
                self.queue.over(ticket);
                let clients = self.watches.taken(ticket, table);
                self.tell_watched(&clients, table, now);
            }
            Event::Info(status) => self.backend.info.take(status),
            Event::Unsolicited(text) => self.broadcast(&text, now),
        }
    }

    pub(super) fn pending(&mut self, ticket: Ticket) -> Option<&mut Pending> {
        match &mut self.clients.get_mut(self.owners.get(&ticket)?)?.waiting {
            Waiting::Board(pending) if pending.ticket == ticket => Some(pending),
            _ => None,
        }
    }

    pub(super) fn answer(&mut self, ticket: Ticket, reply: Result<Reply, CallError>, now: Instant) {
        let Some(id) = self.owners.remove(&ticket) else { return };
        let Some(client) = self.clients.get_mut(&id) else { return };
        if let Waiting::Board(pending) = std::mem::replace(&mut client.waiting, Waiting::Nothing)
            && !pending.oneway
        {
            client.reply(&reply.unwrap_or_else(|error| Reply::of_error(&error)), now);
        }
        self.advance(id, now);
    }

    fn broadcast(&mut self, text: &Unsolicited, now: Instant) {
        for client in self.clients.values_mut() {
            let keeps_up = client.keeps_up();
            let Waiting::Messages(lost) = &mut client.waiting else { continue };
            if !keeps_up {
                *lost += 1;
                continue;
            }
            let message = Message {
                time_ns: text.time_ns,
                kind: text.kind,
                text: text.text.to_latin1(),
                lost: std::mem::take(lost),
            };
            if let Ok(reply) = Reply::with(&message) {
                client.reply(&Reply { continues: Some(true), ..reply }, now);
            }
        }
    }

    /// Acts on every deadline that has passed.
    fn expire(&mut self, now: Instant) {
        if self.admission.pause.is_some_and(|until| until <= now) {
            self.admission.pause = None;
        }
        self.audit.sum_up(now);
        let mut unanswered = Vec::new();
        for client in self.clients.values_mut() {
            if client.patience_ends(self.options.patience).is_some_and(|end| end <= now) {
                let Peer { uid, pid, .. } = client.peer;
                let what = format_args!("dropped a connection of uid {uid} pid {pid}: stopped half-way");
                self.audit.tell(uid, what, now);
                client.hang_up();
                client.close();
            }
            if let Waiting::Board(pending) = &mut client.waiting
                && pending.deadline <= now
            {
                unanswered.push((pending.ticket, std::mem::take(&mut pending.lines)));
            }
        }
        for (ticket, lines) in unanswered {
            let never_begun = self.queue.take_back(ticket);
            let error = if never_begun { CallError::Busy } else { CallError::TimedOut { lines } };
            self.answer(ticket, Err(error), now);
        }
    }

    /// Tells those who wait that nothing more will come; does not wait for them to hear it.
    fn farewell(&mut self, now: Instant) {
        self.audit.end();
        let reason = "pmacd is stopping".to_owned();
        let reply = Reply::of_error(&CallError::Unavailable { reason });
        for client in self.clients.values_mut() {
            match &client.waiting {
                Waiting::Board(Pending { oneway: true, .. }) | Waiting::Nothing => {}
                Waiting::Board(_) | Waiting::Messages(_) | Waiting::Watch => client.reply(&reply, now),
            }
        }
    }
}

/// Who has something to be done.
pub(super) struct Ready {
    stop: bool,
    events: bool,
    listener: bool,
    clients: Vec<(u64, PollFlags)>,
}

fn malformed(why: &dyn std::fmt::Display) -> CallError {
    CallError::invalid("message", why)
}

/// What a call is answered whose command ended so.
pub(super) fn outcome_reply(
    outcome: Outcome,
    lines: Vec<String>,
    overlong: bool,
) -> Result<Reply, CallError> {
    match outcome {
        Outcome::Done if overlong => Err(CallError::Unavailable {
            reason: format!("the board's reply is longer than {COLLECT_MAX} bytes"),
        }),
        Outcome::Done => Reply::with(&SendReply { lines }),
        Outcome::Error(code) => {
            let meaning = meaning(code).unwrap_or("an error number without a documented meaning").to_owned();
            Err(CallError::Board { code, meaning, lines })
        }
        Outcome::TimedOut => Err(CallError::TimedOut { lines }),
        Outcome::Unavailable => Err(CallError::Unavailable {
            reason: "the port for command lines is off (DPRAM ASCII: I58=0) or the board does not answer"
                .to_owned(),
        }),
        Outcome::Busy => Err(CallError::Busy),
        Outcome::OutOfRange => Err(CallError::OutOfRange),
        Outcome::Refused(reason) => {
            Err(CallError::Refused { reason: String::from_utf8_lossy(reason.as_bytes()).into_owned() })
        }
    }
}
