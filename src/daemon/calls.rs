//! What becomes of a call: the part of the server that begins calls, asks the board what a job needs to be so first,
//! and stops what must not outlive its caller.

use std::time::{Duration, Instant};

use log::{error, info, warn};
use serde_json::json;

use super::connection::{Answer, Pending, Waiting};
use super::dispatch::{Action, Ask, understand};
use super::job::Job;
use super::jobs::JobCall;
use super::policy::{Peer, Role};
use super::queue::{Command, Outcome, Text, Ticket};
use super::serve::{GRACE, Service};
use super::turns::Turn;
use crate::function::panel::PanelRequest;
use crate::function::variable_read::VariableEntry;
use crate::protocol::{Call, CallError, Enabled, Function, Reply, control};

/// How long the board may take to say whether a job makes sense.
const GUARD_TIMEOUT: Duration = Duration::from_millis(500);
/// Holds the stops that the board did not take, until they are requested again.
const NOBODY: u64 = u64::MAX;
/// How long until then.
const STOP_AGAIN: Duration = Duration::from_secs(1);
/// How long, at the end, the bus thread may take to have room for the last stop.
const LAST_STOP: Duration = Duration::from_millis(500);
/// How long the board may take to stop a jog whose holder is gone.
const STOP_TIMEOUT: Duration = Duration::from_secs(5);

impl Service {
    pub(super) fn begin(&mut self, id: u64, call: &Call, now: Instant) {
        let Some(client) = self.clients.get_mut(&id) else { return };
        let oneway = call.oneway == Some(true);
        // What was asked by somebody who has gone without waiting for the answer is not begun any more.
        if !oneway && !client.hears() {
            return;
        }
        let mut action = understand(call, client.role, &self.backend.info);
        match action {
            Ok(Action::Ask(ask)) => match self.ask(id, ask, oneway, now) {
                Ok(()) => return,
                Err(error) => action = Err(error),
            },
            Ok(Action::Renew) => {
                let held = self.leases.renew(id, now);
                let reason = "there is no held jog of this connection (any more)".to_owned();
                action =
                    if held { Ok(Action::Reply(Reply::done())) } else { Err(CallError::Refused { reason }) };
            }
            _ => {}
        }
        let Some(client) = self.clients.get_mut(&id) else { return };
        let reply = match action {
            Ok(Action::Reply(reply)) => reply,
            Ok(Action::Stream) => {
                client.waiting = Waiting::Messages(0);
                return;
            }
            Ok(Action::Ask(_) | Action::Renew) => return,
            Err(error) => {
                if !matches!(error, CallError::Busy) {
                    let Peer { uid, pid, .. } = client.peer;
                    let what = format_args!("refused {:?} of uid {uid} pid {pid}: {error}", call.method);
                    self.refusals.tell(uid, what, now);
                }
                error.to_reply()
            }
        };
        if !oneway {
            client.reply(&reply, now);
        }
    }

    fn ask(&mut self, id: u64, ask: Ask, oneway: bool, now: Instant) -> Result<(), CallError> {
        let asks_first = self.backend.info.is_enabled(Enabled::ASCII);
        let may_ask = self.backend.info.settings().functions.has(Function::Ascii);
        let ask = match ask {
            Ask::Job(JobCall { job: Job::WatchVariables(entries), guard, .. })
                if guard.is_none() || !asks_first =>
            {
                return self.watch(id, entries, now);
            }
            ask => ask,
        };
        let deadline = now + ask.timeout();
        let ticket = self.new_ticket();
        let Some(client) = self.clients.get_mut(&id) else { return Ok(()) };
        let uid = client.peer.uid;
        let (mut then, mut audit, mut stops, mut answer) = (None, None, 0, Answer::Lines);
        let command = match ask {
            Ask::Send { line, .. } => {
                audit = Some(format!("sends {line:?}"));
                Command::Send { ticket, line, deadline, question: false }
            }
            Ask::Control { character } => {
                audit = Some(format!("sends {}", control::name(character)));
                Command::Control { ticket, character, deadline }
            }
            Ask::Read { first, count } => Command::ReadWords { ticket, first, count },
            Ask::Job(mut call) => match call.guard.filter(|guard| asks_first || guard.is_required && may_ask)
            {
                // First ask the board whether the job makes sense; where it cannot be asked, the job has to show. Where
                // command lines are switched off, what the job needs is with its caller.
                Some(guard) => {
                    let line = Text::new(call.question(guard).as_bytes()).unwrap_or_default();
                    then = Some(call);
                    Command::Send { ticket, line, deadline: now + GUARD_TIMEOUT, question: true }
                }
                None => {
                    if let Some(guard) = call.guard.take() {
                        call.note_unasked(guard);
                    }
                    audit = call.audit.take();
                    answer = call.notes.take().map_or(Answer::Done, Answer::Notes);
                    if let Some(stop) = call.lease {
                        // From now on: a client that is gone before the board has taken the jog is gone all the same.
                        self.leases.begin(id, stop, deadline);
                    }
                    if let (Job::Panel(request), None) = (&call.job, call.lease) {
                        stops = request.stops();
                    }
                    Command::Job { ticket, job: Box::new(call.job), deadline }
                }
            },
        };
        self.turns.wait(uid, Turn { ticket, command, audit });
        self.owners.insert(ticket, id);
        let deadline = deadline + GRACE;
        client.waiting = Waiting::Board(Pending {
            ticket,
            oneway,
            deadline,
            lines: Vec::new(),
            length: 0,
            then,
            stops,
            answer,
        });
        Ok(())
    }

    /// Hands the bus thread what it has room for.
    pub(super) fn hand_out(&mut self, now: Instant) {
        let mut refused = Vec::new();
        while let Some(Turn { ticket, mut command, audit }) = self.turns.next() {
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
            self.turns.over(ticket);
            self.answer(ticket, Err(CallError::Busy), now);
        }
    }

    fn new_ticket(&mut self) -> Ticket {
        self.next_ticket += 1;
        Ticket(self.next_ticket)
    }

    /// Begins a watch, of which only a change of the table concerns the bus thread.
    fn watch(&mut self, id: u64, entries: Vec<VariableEntry>, now: Instant) -> Result<(), CallError> {
        let watched = json!({ "watched": entries.len() });
        let Some(client) = self.clients.get(&id) else { return Ok(()) };
        let observer = (client.role == Role::Observe).then_some(client.peer.uid);
        self.subscriptions
            .watch(id, entries, observer)
            .map_err(|none_left| CallError::Refused { reason: none_left.to_string() })?;
        if let Some(client) = self.clients.get_mut(&id) {
            client.waiting = Waiting::Watch;
            client.reply(&Reply { continues: Some(true), ..Reply::with(&watched)? }, now);
        }
        Ok(())
    }

    /// The board has answered the question a job waited for.
    pub(super) fn guarded(
        &mut self,
        ticket: Ticket,
        mut call: JobCall,
        lines: &[String],
        outcome: Outcome,
        now: Instant,
    ) {
        let Some(id) = self.owners.remove(&ticket) else { return };
        let Some(client) = self.clients.get_mut(&id) else { return };
        let Waiting::Board(pending) = std::mem::replace(&mut client.waiting, Waiting::Nothing) else {
            return;
        };
        let mut answers = lines.iter().map(|line| line.rsplit('=').next().unwrap_or(line).trim());
        let answer = answers.next();
        match (call.guard, call.time_base) {
            (Some(guard), _) if outcome != Outcome::Done && !guard.is_required => call.note_unasked(guard),
            (_, Some(number)) => call.note_time_base(number, answers.next()),
            _ => {}
        }
        let result = match (call.guard.take(), answer) {
            (Some(guard), Some(value)) if outcome == Outcome::Done && value != guard.value => {
                let reason = format!(
                    "{} is {value}, and {} needs {}; send {}={} first",
                    guard.variable, guard.purpose, guard.value, guard.variable, guard.value
                );
                Err(CallError::Refused { reason })
            }
            (Some(guard), answer) if guard.is_required && (outcome != Outcome::Done || answer.is_none()) => {
                Err(guard.unanswered())
            }
            // A board that cannot be asked (any more) may still do it; if not, the job says so.
            _ => self.ask(id, Ask::Job(call), pending.oneway, now),
        };
        let Some(client) = self.clients.get_mut(&id) else { return };
        if let Err(error) = result {
            if !pending.oneway {
                client.reply(&error.to_reply(), now);
            }
            self.advance(id, now);
        }
    }

    /// Tells the bus thread which registers are watched, when that has changed. A full queue is tried again.
    pub(super) fn tell_subscriptions(&mut self, now: Instant) {
        let Some(table) = self.subscriptions.news(now) else { return };
        let ticket = self.new_ticket();
        let command =
            Command::Job { ticket, job: Box::new(Job::WatchVariables(table)), deadline: now + STOP_TIMEOUT };
        if self.backend.commands.try_send(command).is_ok() {
            self.subscriptions.told(ticket);
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
