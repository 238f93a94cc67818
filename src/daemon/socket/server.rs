//! The command socket's server: one thread, one poll over the listener, the clients, the bus thread's events and stop.
//!
//! The server never waits for a client and never holds up the bus thread: whatever a client does costs at most that
//! client's own bounded buffers. Each connection has one call under way at a time, so replies keep the order of the
//! calls. A ticket brings every event of the bus thread back to its call. Asking often gives no client precedence: a
//! connection begins a few calls a round, its user gets a share of the round (`time_quota`), and commands for the board
//! take turns (`fair_queue`).

mod calls;
mod ending;
mod first_starts;
mod jobs;
mod motion;
mod ordering;
mod panel_off;
mod replies;
mod sequencing;
mod starting;
pub mod stepper;
mod stopping;
mod who_may_order;

use std::collections::BTreeMap;
use std::io;
use std::os::fd::AsFd;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use log::error;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::eventfd::{EfdFlags, EventFd};

use super::admission::Admission;
use super::audit::AuditLimit;
use super::call_table::{CallTable, Ended, Then};
use super::clients::Clients;
use super::listener::Listener;
use super::notes::Notes;
use super::options::{ServeError, ServeOptions};
use super::policy::{Characters, Peer, PolicyError};
use super::program_errors::ProgramErrors;
use super::sequences::Sequences;
use super::tracing::Tracing;
use super::watches::Watches;
use crate::daemon::motion::ledger::Ledger;
use crate::daemon::motion::leftovers::Leftovers;
use crate::daemon::motion::resets::Resets;
use crate::daemon::motion::sent_stops::SentStops;
use crate::daemon::motion::stops::Stops;
use crate::daemon::scripts::{Entry, Found};
use crate::daemon::shared::info::{Info, Pulse, WatchedThread};
use crate::daemon::shared::queue::{Command, Event, Outcome, Receive, Sender, Ticket};
use crate::device::Trace;
use crate::map::Motors;
use crate::protocol::board::{ReadReply, RotaryStateReply};
use crate::protocol::{Call, CallError, Enabled, Reply};

/// How many calls a connection may begin before other connections have their turn.
const CALLS_A_TURN: usize = 8;
/// The longest wait. The watchdog looks for rounds twice in its limit, which is two seconds in the unit.
const LONGEST_WAIT: Duration = Duration::from_millis(250);

/// The server's links to the bus thread, and the answer to `GetInfo`.
pub struct Backend {
    /// Commands to the bus thread.
    pub commands: Sender<Command>,
    /// Events from the bus thread. The bus thread must deliver the events of a ticket in order and without gaps,
    /// [`Event::Done`] last; it keeps events that find no room.
    pub events: Receive<Event>,
    /// The answer to `GetInfo`; [`Event::Info`] keeps it up to date.
    pub info: Info,
    /// The bus thread's accesses to the board, recorded while a client traces them.
    pub trace: Arc<Trace>,
}

/// The running server. [`Server::stop`] or a drop stops it.
pub struct Server {
    stop: Arc<EventFd>,
    thread: Option<JoinHandle<Motors>>,
}

impl Server {
    /// Stops held jogs, ends every connection, removes the socket, and waits for the thread, whose waits are bounded.
    /// Returns the motors of held jogs that may still move.
    #[must_use]
    pub fn stop(mut self) -> Motors {
        self.end()
    }

    fn end(&mut self) -> Motors {
        let Some(thread) = self.thread.take() else { return Motors::NONE };
        let _ = self.stop.write(1);
        thread.join().unwrap_or_else(|_| {
            error!("the command socket's thread panicked");
            Motors::NONE
        })
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
/// [`ServeError`] when a group is unknown, or the system gives no descriptors or no thread.
pub fn serve(options: &ServeOptions, listener: Listener, backend: Backend) -> Result<Server, ServeError> {
    let flags = EfdFlags::EFD_NONBLOCK | EfdFlags::EFD_CLOEXEC;
    let stop = Arc::new(EventFd::from_value_and_flags(0, flags).map_err(io::Error::from)?);
    let service = Service::new(options, listener, backend)?;
    let waker = Arc::clone(&stop);
    let thread = std::thread::Builder::new().name("socket".to_owned()).spawn(move || service.run(&waker))?;
    Ok(Server { stop, thread: Some(thread) })
}

/// The server's parts; each part owns the state for its decisions.
struct Service {
    admission: Admission,
    clients: Clients,
    calls: CallTable,
    ledger: Ledger,
    stops: Stops,
    sequences: Sequences,
    rotary_entry: Entry,
    leftovers: Leftovers,
    resets: Resets,
    sent_stops: SentStops,
    notes: Notes,
    watches: Watches,
    tracing: Tracing,
    audit: AuditLimit,
    program_errors: ProgramErrors,
    events: Receive<Event>,
    info: Info,
    pulse: Arc<Pulse>,
    /// When the daemon began to stop; the server begins nothing after that.
    stopping: Option<Instant>,
    /// Since when, at the daemon's end, no hold and no stop is left.
    stood_since: Option<Instant>,
    /// The control characters that operators may send.
    characters: Characters,
}

impl Service {
    fn new(options: &ServeOptions, listener: Listener, backend: Backend) -> Result<Self, PolicyError> {
        let Backend { commands, events, info, trace } = backend;
        Ok(Self {
            admission: Admission::new(options, listener)?,
            clients: Clients::new(options.patience),
            calls: CallTable::new(commands),
            ledger: Ledger::default(),
            stops: Stops::new(options.stop_all_after),
            sequences: Sequences::default(),
            rotary_entry: Entry::default(),
            leftovers: Leftovers::default(),
            resets: Resets::default(),
            sent_stops: SentStops::default(),
            notes: Notes::default(),
            watches: Watches::new(info.settings().plan.variable_read_entries as usize),
            tracing: Tracing::new(trace),
            audit: AuditLimit::default(),
            program_errors: ProgramErrors::default(),
            events,
            pulse: info.pulse(),
            info,
            stopping: None,
            stood_since: None,
            characters: options.roles.operate_characters,
        })
    }

    fn run(mut self, stop: &EventFd) -> Motors {
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
        self.come_to_end(stop);
        self.end(Instant::now())
    }

    /// Does all work that is due now.
    fn round(&mut self, ready: Ready, now: Instant) {
        self.pulse.count_round(WatchedThread::Socket);
        if ready.events {
            self.events.clear();
        }
        // Even without a wake: the bus thread queues the lines of a reply without waking this thread, and a client may
        // have to hear them before the reply ends.
        while let Some(event) = self.events.try_receive() {
            self.on_event(event, now);
        }
        self.serve_ready(ready.clients, now);
        if ready.listener {
            let (admission, clients, holds, audit) = self.entrance();
            admission.accept(clients, holds, audit, now);
        }
        self.expire(now);
        self.tend_sequences(now);
        let gone = self.clients.remove_finished();
        for client in &gone {
            self.watches.forget(*client);
            self.calls.forget(*client);
            self.ledger.forget(*client);
            self.sequences.forget(*client);
            self.tracing.forget(*client);
        }
        self.tend_motion(now);
        if !gone.is_empty() {
            self.admission.resume();
        }
        self.send_watch_table(now);
        self.hand_out(now);
    }

    /// The parts that decide which connection gets a place; the closure tells whether something ends with a connection.
    fn entrance(&mut self) -> (&mut Admission, &mut Clients, impl Fn(u64) -> bool, &mut AuditLimit) {
        let Self { admission, clients, ledger, sequences, tracing, audit, .. } = self;
        let holds = |client| ledger.is_of(client) || sequences.is_of(client) || tracing.is_of(client);
        (admission, clients, holds, audit)
    }

    /// How long the server may sleep if nothing happens.
    fn timeout(&self) -> Duration {
        if self.calls.has_next() || self.clients.has_more() {
            return Duration::ZERO;
        }
        let deadlines = [
            self.calls.next_deadline(),
            self.clients.next_deadline(),
            self.admission.next_deadline(),
            self.ledger.next_moment(),
            self.stops.next_moment(),
            self.sequences.next_moment(),
            self.audit.next_end(),
            self.watches.next_try(),
            self.tracing.next_end(),
        ];
        let deadline = deadlines.into_iter().flatten().min();
        let left =
            |deadline: Instant| deadline.saturating_duration_since(Instant::now()) + Duration::from_millis(1);
        deadline.map_or(LONGEST_WAIT, left).min(LONGEST_WAIT)
    }

    fn wait(&self, stop: &EventFd, timeout: Duration) -> nix::Result<Ready> {
        let timeout = PollTimeout::try_from(timeout).unwrap_or(PollTimeout::MAX);
        let mut polled = Vec::with_capacity(2 * self.clients.count());
        let mut fds = vec![
            PollFd::new(stop.as_fd(), PollFlags::POLLIN),
            PollFd::new(self.events.descriptor(), PollFlags::POLLIN),
            self.admission.interest(),
        ];
        // A client with calls left over gets its turn again even if no more data arrive.
        let mut clients: BTreeMap<u64, PollFlags> = BTreeMap::new();
        for (id, client) in self.clients.iter() {
            if let Some(flags) = client.interest() {
                polled.push((id, None));
                fds.push(PollFd::new(client.as_fd(), flags));
                if let Some(process) = client.process() {
                    polled.push((id, Some(PollFlags::POLLHUP)));
                    fds.push(PollFd::new(process, PollFlags::POLLIN));
                }
            }
            if client.has_more() {
                clients.insert(id, PollFlags::empty());
            }
        }
        poll(&mut fds, timeout)?;
        let flags = |fd: &PollFd<'_>| fd.revents().unwrap_or(PollFlags::POLLERR);
        let is_ready = |index: usize| fds.get(index).is_some_and(|fd| flags(fd).contains(PollFlags::POLLIN));
        for (&(id, meaning), fd) in polled.iter().zip(&fds[3..]).filter(|(_, fd)| !flags(fd).is_empty()) {
            *clients.entry(id).or_insert(PollFlags::empty()) |= meaning.unwrap_or(flags(fd));
        }
        let clients = clients.into_iter().collect();
        Ok(Ready { stop: is_ready(0), events: is_ready(1), listener: is_ready(2), clients })
    }

    /// Serves ready clients within each user's time quota; the rest stay ready for the next round.
    fn serve_ready(&mut self, mut ready: Vec<(u64, PollFlags)>, now: Instant) {
        self.clients.begin_round(&mut ready, now);
        let mut began = Instant::now();
        for (id, flags) in ready {
            if self.clients.has_time(id) {
                self.on_ready(id, flags, now);
                let ended = Instant::now();
                self.clients.used(id, ended - began);
                began = ended;
            } else if let Some(client) = self.clients.get_mut(id) {
                // The connection has already read the client's data: the poll does not report them again.
                client.yields();
            }
        }
    }

    fn on_ready(&mut self, id: u64, flags: PollFlags, now: Instant) {
        let Some(client) = self.clients.get_mut(id) else { return };
        if flags.intersects(PollFlags::POLLHUP | PollFlags::POLLERR | PollFlags::POLLNVAL) {
            client.hang_up();
        }
        if flags.contains(PollFlags::POLLOUT) {
            client.flush(now);
        }
        self.advance(id, now);
    }

    /// Begins the client's calls, one after the other, until a call has to wait or other clients shall have their turn.
    fn advance(&mut self, id: u64, now: Instant) {
        for _ in 0..CALLS_A_TURN {
            let Some(client) = self.clients.get_mut(id) else { return };
            let malformed = match client.next_call(now) {
                Ok(None) => return,
                Ok(Some(message)) => match serde_json::from_slice::<Call>(&message) {
                    Ok(call) => {
                        self.begin(id, &call, now);
                        continue;
                    }
                    Err(error) => CallError::invalid("message", error),
                },
                Err(too_long) => CallError::invalid("message", too_long),
            };
            client.reply(&Reply::of_error(&malformed), now);
            return client.close();
        }
        if let Some(client) = self.clients.get_mut(id) {
            client.yields();
        }
    }

    fn on_event(&mut self, event: Event, now: Instant) {
        match event {
            Event::Line(ticket, text) => self.calls.add_line(ticket, &text),
            Event::Done(ticket, outcome) => {
                let refused = self.watches.failed(ticket, outcome, now);
                self.refuse_watches(&refused, outcome, now);
                if let Some(number) = self.stops.at_panel(ticket) {
                    self.stop_step(number, &[], outcome, now);
                }
                if let Some(ended) = self.calls.end(ticket, outcome) {
                    self.on_end(ended, now);
                }
            }
            Event::Words { ticket, time_ns, words, count } => {
                let words: Vec<u16> = words.iter().copied().take(count).collect();
                let reply = |found: Found| Reply::with(&ReadReply { time_ns, words: found.words });
                self.on_found(ticket, Found { words, ..Found::default() }, reply, now);
            }
            Event::Rotary(ticket, state) => {
                let reply = |_: Found| {
                    Reply::with(&RotaryStateReply {
                        ahead_commands: state.ahead_commands,
                        ahead_lines: state.ahead_lines,
                        sent_lines: state.sent_lines,
                        busy: state.busy,
                        error: state.error,
                        underruns: state.underruns,
                    })
                };
                self.on_found(ticket, Found { rotary: Some(state), ..Found::default() }, reply, now);
            }
            Event::Watching(ticket, table) => {
                let clients = self.watches.taken(ticket, table);
                self.tell_watched(&clients, table, now);
            }
            Event::Info(status) => {
                self.resets.bus_sees(status.resets, status.enabled.contains(Enabled::SERVO), now);
                let panel = self.info.enabling().panel;
                let opened = self.info.take(status);
                self.ledger.see(self.info.motion(), opened, now);
                if panel != Some(false) && self.info.enabling().panel == Some(false) {
                    self.panel_ended(None, now);
                }
            }
            Event::Unsolicited(text) => {
                self.program_errors.see(&text, now);
                self.clients.pass_on(&text, now);
            }
        }
    }

    /// The bus thread has `found` this for `ticket`: a sequence gets the findings, a client gets the `reply`.
    fn on_found(
        &mut self,
        ticket: Ticket,
        found: Found,
        reply: impl FnOnce(Found) -> Result<Reply, CallError>,
        now: Instant,
    ) {
        match self.calls.end(ticket, Outcome::Done) {
            Some(Ended { then: Then::Sequence(number, effect), heard, .. }) => {
                self.step_done((number, effect), heard, found, now)
            }
            Some(ended) => self.answer(ended.heard.caller, reply(found), now),
            None => {}
        }
    }

    /// Acts on every deadline that has passed.
    fn expire(&mut self, now: Instant) {
        self.admission.expire(now);
        self.audit.sum_up(now);
        self.tracing.expire(now);
        for Peer { uid, pid, .. } in self.clients.drop_stalled(now) {
            let what = format_args!("dropped a connection of uid {uid} pid {pid}: stopped half-way");
            self.audit.tell(uid, what, now);
        }
        for ended in self.calls.expire(self.info.holds_port(), now) {
            self.on_end(ended, now);
        }
    }
}

/// The descriptors that are ready.
struct Ready {
    stop: bool,
    events: bool,
    listener: bool,
    clients: Vec<(u64, PollFlags)>,
}
