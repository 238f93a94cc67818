//! What becomes of a call: the part of the server that begins calls, asks the board what a job needs to be so first,
//! and stops what must not outlive its caller.

use std::time::{Duration, Instant};

use log::{error, info, warn};

use super::{GRACE, Service, outcome_reply};
use crate::daemon::shared::job::Job;
use crate::daemon::shared::queue::{Command, LINE_MAX, Outcome, Text, Ticket};
use crate::daemon::socket::connection::{Answer, Pending, Then, Waiting};
use crate::daemon::socket::fair_queue::Turn;
use crate::daemon::socket::jobs::{self, JobCall};
use crate::daemon::socket::methods::{Action, Ask, parse_call};
use crate::daemon::socket::policy::{Peer, Role};
use crate::function::panel::PanelRequest;
use crate::function::variable_read::VariableEntry;
use crate::protocol::board::WatchReply;
use crate::protocol::{Call, CallError, Enabled, Function, Reply, answer, control};

/// How long the board may take to say whether a job makes sense.
const GUARD_TIMEOUT: Duration = Duration::from_millis(500);
/// How long a watch may wait for its turn to ask.
const WATCH_TIMEOUT: Duration = Duration::from_secs(1);
/// Holds the stops that the board did not take, until they are requested again.
const NOBODY: u64 = u64::MAX;
/// How long until then.
const STOP_AGAIN: Duration = Duration::from_secs(1);
/// How long, at the end, the bus thread may take to have room for the last stop.
const LAST_STOP: Duration = Duration::from_millis(500);
/// How long the board may take to stop a jog whose holder is gone.
const STOP_TIMEOUT: Duration = Duration::from_secs(5);

impl Service {
    /// Begins a call: answers it, or has the board asked.
    pub(super) fn begin(&mut self, id: u64, call: &Call, now: Instant) {
        let Some(client) = self.clients.get_mut(&id) else { return };
        let oneway = call.oneway == Some(true);
        // What was asked by somebody who has gone without waiting for the answer is not begun any more.
        if !oneway && !client.hears() {
            return;
        }
        let action = parse_call(call, client.role, &self.backend.info);
        let reply = match action.and_then(|action| self.act(id, action, oneway, now)) {
            Ok(None) => return,
            Ok(Some(reply)) => reply,
            Err(error) => {
                if let (false, Some(client)) = (matches!(error, CallError::Busy), self.clients.get(&id)) {
                    let Peer { uid, pid, .. } = client.peer;
                    let what = format_args!("refused {:?} of uid {uid} pid {pid}: {error}", call.method);
                    self.audit.tell(uid, what, now);
                }
                Reply::of_error(&error)
            }
        };
        if let (false, Some(client)) = (oneway, self.clients.get_mut(&id)) {
            client.reply(&reply, now);
        }
    }

    /// Does what a call asks for; tells the reply if there is one at once.
    fn act(
        &mut self,
        id: u64,
        action: Action,
        oneway: bool,
        now: Instant,
    ) -> Result<Option<Reply>, CallError> {
        match action {
            Action::Reply(reply) => return Ok(Some(reply)),
            Action::Ask(ask) => self.ask(id, ask, oneway, now),
            Action::Watch(entries) => {
                let enabling = self.backend.info.enabling();
                if jobs::VARIABLES_ENABLED.is_open(enabling, self.answers(), self.may_ask()) {
                    let question = Text::of(&jobs::VARIABLES_ENABLED.variable);
                    self.ask_first(id, question, Then::Watch(entries), now + WATCH_TIMEOUT, oneway);
                } else {
                    self.watch(id, entries, now)?;
                }
            }
            Action::Stream => {
                if let Some(client) = self.clients.get_mut(&id) {
                    client.waiting = Waiting::Messages(0);
                }
            }
            Action::Renew => {
                let reason = "there is no held jog of this connection (any more)".to_owned();
                let held = self.leases.renew(id, now);
                return if held { Ok(Some(Reply::done())) } else { Err(CallError::Refused { reason }) };
            }
        }
        Ok(None)
    }

    /// Whether the board answers command lines now.
    fn answers(&self) -> bool {
        self.backend.info.is_enabled(Enabled::ASCII)
    }

    /// Whether command lines are used at all.
    fn may_ask(&self) -> bool {
        self.backend.info.settings().functions.has(Function::Ascii)
    }

    fn ask(&mut self, id: u64, ask: Ask, oneway: bool, now: Instant) {
        let (ticket, deadline) = (self.new_ticket(), now + ask.timeout());
        let (command, audit) = match ask {
            Ask::Send { line, .. } => {
                (Command::Send { ticket, line, deadline, question: false }, Some(format!("sends {line:?}")))
            }
            Ask::Control { character } => {
                let audit = format!("sends {}", control::name(character));
                (Command::Control { ticket, character, deadline }, Some(audit))
            }
            Ask::Read { first, count } => (Command::ReadWords { ticket, first, count }, None),
            Ask::Job(call) => return self.ask_job(id, call, oneway, now),
        };
        self.wait_for_board(
            id,
            Turn { ticket, command, audit },
            Pending::new(ticket, oneway, deadline + GRACE),
        );
    }

    /// Has the bus thread do a job, or asks the board first whether that makes sense. Where the board cannot be asked, the job has
    /// to show; where command lines are switched off, what the job needs is with its caller.
    fn ask_job(&mut self, id: u64, mut call: JobCall, oneway: bool, now: Instant) {
        let deadline = now + call.timeout;
        if let Some(guard) = call.guard {
            let is_known = (guard.known)(self.backend.info.enabling()) == Some(true);
            let has_question = call.time_base.is_some() && self.answers();
            if has_question || guard.is_open(self.backend.info.enabling(), self.answers(), self.may_ask()) {
                let question = Text::of(&call.question(guard));
                return self.ask_first(id, question, Then::Job(call), deadline, oneway);
            }
            call.guard = None;
            if !is_known {
                call.note_unasked(guard);
            }
        }
        self.do_job(id, call, oneway, deadline);
    }

    /// Has the bus thread do a job, whatever the board says.
    fn do_job(&mut self, id: u64, call: JobCall, oneway: bool, deadline: Instant) {
        let JobCall { job, notes, lease, audit, .. } = call;
        let ticket = self.new_ticket();
        if let Some(stop) = lease {
            // From now on: a client that is gone before the board has taken the jog is gone all the same.
            self.leases.begin(id, stop, deadline);
        }
        let stops = match (&job, lease) {
            (Job::Panel(request), None) => request.stops(),
            _ => 0,
        };
        let answer = notes.map_or(Answer::Done, Answer::Notes);
        let command = Command::Job { ticket, job: Box::new(job), deadline };
        let pending = Pending { stops, answer, ..Pending::new(ticket, oneway, deadline + GRACE) };
        self.wait_for_board(id, Turn { ticket, command, audit }, pending);
    }

    /// Asks the board `question`; `then` begins if its answer is what its guard wants.
    fn ask_first(&mut self, id: u64, question: Text<LINE_MAX>, then: Then, deadline: Instant, oneway: bool) {
        let ticket = self.new_ticket();
        // The time to answer runs from when it is handed over.
        let command = Command::Send { ticket, line: question, deadline, question: true };
        let pending = Pending { then: Some(then), ..Pending::new(ticket, oneway, deadline + GRACE) };
        self.wait_for_board(id, Turn { ticket, command, audit: None }, pending);
    }

    fn wait_for_board(&mut self, id: u64, turn: Turn, pending: Pending) {
        let Some(client) = self.clients.get_mut(&id) else { return };
        self.owners.insert(turn.ticket, id);
        self.queue.wait(client.peer.uid, turn);
        client.waiting = Waiting::Board(pending);
    }

    /// Hands the bus thread what it has room for.
    pub(super) fn hand_out(&mut self, now: Instant) {
        let mut refused = Vec::new();
        while let Some(Turn { ticket, mut command, audit }) = self.queue.next() {
            if let Command::Send { question: true, deadline, .. } = &mut command {
                // How long it waited here says nothing about the board.
                *deadline = now + GUARD_TIMEOUT;
            }
            let client = self.owners.get(&ticket).and_then(|id| self.clients.get(id));
            let wanted = client.filter(|client| match &client.waiting {
                // As in `begin`: what nobody waits for any more is not begun, and not what has waited too long.
                Waiting::Board(pending) => {
                    (pending.oneway || client.hears()) && now + GRACE < pending.deadline
                }
                _ => false,
            });
            let Some(Peer { uid, pid, .. }) = wanted.map(|client| client.peer) else {
                refused.push(ticket);
                continue;
            };
            if self.backend.commands.try_send(command).is_err() {
                refused.push(ticket);
            } else if let Some(what) = audit {
                info!(target: "audit", "uid {uid} pid {pid} {what}");
            }
        }
        for ticket in refused {
            self.queue.over(ticket);
            self.answer(ticket, Err(CallError::Busy), now);
        }
    }

    fn new_ticket(&mut self) -> Ticket {
        self.next_ticket += 1;
        Ticket(self.next_ticket)
    }

    /// Begins a watch, of which only a change of the table concerns the bus thread. The reply comes when the table is the board's.
    fn watch(&mut self, id: u64, entries: Vec<VariableEntry>, now: Instant) -> Result<(), CallError> {
        let Some(client) = self.clients.get_mut(&id) else { return Ok(()) };
        let observer = (client.role == Role::Observe).then_some(client.peer.uid);
        let table = self
            .watches
            .watch(id, entries, observer)
            .map_err(|none_left| CallError::Refused { reason: none_left.to_string() })?;
        client.waiting = Waiting::Watch;
        if let Some(table) = table {
            self.tell_watched(&[id], table, now);
        }
        Ok(())
    }

    /// Tells clients that the registers they watch are in the board's table number `table`.
    pub(super) fn tell_watched(&mut self, clients: &[u64], table: u32, now: Instant) {
        for id in clients {
            let reply = Reply::with(&WatchReply { watched: self.watches.count_of(*id), table });
            if let (Some(client), Ok(reply)) = (self.clients.get_mut(id), reply) {
                client.reply(&Reply { continues: Some(true), ..reply }, now);
            }
        }
    }

    /// Tells clients that the board did not take the table with their registers. They watch nothing.
    pub(super) fn refuse_watches(&mut self, clients: &[u64], outcome: Outcome, now: Instant) {
        for id in clients {
            let Some(client) = self.clients.get_mut(id) else { continue };
            client.waiting = Waiting::Nothing;
            let error = match outcome_reply(outcome, Vec::new(), false) {
                Err(error) => error,
                Ok(_) => CallError::Busy,
            };
            client.reply(&Reply::of_error(&error), now);
            self.advance(*id, now);
        }
    }

    /// The board has answered the question that something waited for.
    pub(super) fn guarded(
        &mut self,
        ticket: Ticket,
        then: Then,
        lines: &[String],
        outcome: Outcome,
        now: Instant,
    ) {
        let Some(id) = self.owners.remove(&ticket) else { return };
        let Some(client) = self.clients.get_mut(&id) else { return };
        let Waiting::Board(Pending { oneway, .. }) = std::mem::replace(&mut client.waiting, Waiting::Nothing)
        else {
            return;
        };
        let mut answers = lines.iter().map(|line| answer::text(line));
        let found = answers.next().filter(|_| outcome == Outcome::Done);
        // A board that cannot be asked (any more) may still do it; if not, the job says so.
        let result = match then {
            Then::Watch(entries) => {
                jobs::VARIABLES_ENABLED.check(found).and_then(|()| self.watch(id, entries, now))
            }
            Then::Job(mut call) => {
                let guard = call.guard.take();
                match (guard, call.time_base) {
                    (Some(guard), _) if outcome != Outcome::Done && !guard.is_required => {
                        call.note_unasked(guard)
                    }
                    (_, Some(number)) => call.note_time_base(number, answers.next()),
                    _ => {}
                }
                let checked = guard.map_or(Ok(()), |guard| guard.check(found));
                checked.map(|()| {
                    let deadline = now + call.timeout;
                    self.do_job(id, call, oneway, deadline);
                })
            }
        };
        if let Err(error) = result {
            if let (false, Some(client)) = (oneway, self.clients.get_mut(&id)) {
                client.reply(&Reply::of_error(&error), now);
            }
            self.advance(id, now);
        }
    }

    /// Tells the bus thread which registers are watched, when that has changed. A full queue is tried again.
    pub(super) fn tell_subscriptions(&mut self, now: Instant) {
        let Some(table) = self.watches.update(now) else { return };
        let ticket = self.new_ticket();
        let command =
            Command::Job { ticket, job: Box::new(Job::WatchVariables(table)), deadline: now + STOP_TIMEOUT };
        if self.backend.commands.try_send(command).is_ok() {
            self.watches.sent(ticket);
        }
    }

    /// The request with `ticket` is over: one that had to stop a jog and was not taken comes again.
    pub(super) fn after_stop(&mut self, ticket: Ticket, outcome: Outcome, now: Instant) {
        let Some(stop) = self.leases.stop_over(ticket) else { return };
        if outcome != Outcome::Done {
            error!(
                target: "audit",
                "the board did not take the stop of a held jog (mask {:#04x}); asking again", stop.mask
            );
            self.leases.begin(NOBODY, stop, now + STOP_AGAIN);
        }
    }

    /// Requests the stop of every jog whose holder is gone or silent, or of all that are held: all in one request. False when
    /// there was no room for it.
    pub(super) fn end_leases(&mut self, now: Instant, all: bool) -> bool {
        if !all && !self.leases.may_stop() {
            return true;
        }
        let clients = &self.clients;
        let is_gone = |id: u64| all || id != NOBODY && clients.get(&id).is_none_or(|client| !client.hears());
        let mut ended = Vec::new();
        while let Some(end) = self.leases.ended(now, is_gone) {
            ended.push(end);
        }
        if ended.is_empty() {
            return true;
        }
        let stops = ended.iter().map(|(_, stop)| stop);
        let stop = stops.fold(PanelRequest::default(), |sum, stop| sum.together_with(stop));
        let ticket = self.new_ticket();
        let command = Command::Job { ticket, job: Box::new(Job::Panel(stop)), deadline: now + STOP_TIMEOUT };
        let is_sent = self.backend.commands.try_send(command).is_ok();
        for (id, stop) in ended {
            if is_sent {
                let mask = stop.mask;
                warn!(target: "audit", "a held jog is stopped (mask {mask:#04x}): its holder is gone or silent");
            } else {
                // The queue is full; the stop must not be forgotten.
                self.leases.begin(id, stop, now);
            }
        }
        if is_sent {
            self.leases.stopping(ticket, stop);
        }
        is_sent
    }

    /// At the end nobody will be there to hold a jog. A full queue empties soon, if the bus thread can tell what it has done.
    pub(super) fn end_all_leases(&mut self) {
        let deadline = Instant::now() + LAST_STOP;
        while !self.end_leases(Instant::now(), true) && Instant::now() < deadline {
            while self.backend.events.try_receive().is_some() {}
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}
