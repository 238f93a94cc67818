//! Drives the sequences: has the bus thread do their steps, answers their owners, and ends them.

use std::time::{Duration, Instant};

use log::info;

use super::Service;
use super::replies::Answered;
use crate::daemon::motion::effect::LineEffect;
use crate::daemon::motion::resets;
use crate::daemon::scripts::{
    Asked, Batch, Done, Ending, Found, Request, Resource, Script, Step, gather, lines, rotary, stop_gather,
};
use crate::daemon::shared::open_buffer::Writer;
use crate::daemon::shared::queue::{Command, Line, Origin, Outcome, Text};
use crate::daemon::socket::audit;
use crate::daemon::socket::call_table::{Caller, Then};
use crate::daemon::socket::connection::{HIGH_WATER, Waiting};
use crate::daemon::socket::heard::Heard;
use crate::daemon::socket::policy::Peer;
use crate::daemon::socket::sequences::{Running, SequenceCall, Sequences, Waits};
use crate::language::LineEnds;
use crate::language::password::without_password;
use crate::map::Systems;
use crate::protocol::{CallError, Reply};

/// How long a sequence waits for its owner to fetch its replies.
const UNFETCHED: Duration = Duration::from_millis(20);

/// The owner's call, and the answer to it.
type OwnersAnswer = (Caller, Result<Reply, CallError>);

impl Service {
    /// Begins a sequence, or passes a call on to the caller's sequence. Returns the reply, if it is known at once.
    pub(super) fn sequence_call(&mut self, caller: Caller, call: SequenceCall, now: Instant) -> Answered {
        match call {
            SequenceCall::Renew => match self.sequences.renew(caller.client, now) {
                0 => Err(CallError::refused("this connection has no sequence (any more)".to_owned())),
                _ => Ok(Some(Reply::done())),
            },
            SequenceCall::Lines(batch) => {
                if !batch.confirmed() {
                    batch.all_lines().try_for_each(|line| self.spares_others(caller, line))?;
                }
                match self.sequences.of_client(caller.client, Resource::Lines) {
                    Some(number) => self.ask_sequence(number, caller, Asked::Lines(batch), now),
                    None if batch.only_ends() => self.finish_lines(caller, batch, now),
                    None => self.begin_sequence(caller, lines(batch), now),
                }
            }
            SequenceCall::Gather(call) => match self.sequences.of_client(caller.client, Resource::Gather) {
                Some(_) => Err(CallError::refused("this connection gathers already; GatherStop ends that")),
                None => self.begin_sequence(caller, gather(call, caller.peer), now),
            },
            SequenceCall::GatherStop { uid } => self.stop_gather(caller, uid, now),
            SequenceCall::Rotary(call) => {
                let stream = rotary(call, self.rotary_entry.clone());
                match self.sequences.of_client(caller.client, stream.resource()) {
                    Some(_) => {
                        Err(CallError::refused("this connection streams already; RotaryStop ends that"))
                    }
                    None => self.begin_sequence(caller, stream, now),
                }
            }
            SequenceCall::RotaryFinish(buffer) => {
                let number = self.own_stream(caller, buffer)?;
                self.ask_sequence(number, caller, Asked::Finish, now)
            }
            SequenceCall::RotaryStop(buffer) => {
                let resource = Resource::Rotary(buffer);
                match self.sequences.on(resource) {
                    Some((number, running)) if running.owner.client == caller.client => {
                        match running.ending {
                            None => self.ask_sequence(number, caller, Asked::Stop, now),
                            Some(_) => self.wait_for_end(number, caller),
                        }
                    }
                    _ => match self.sequences.take_result(caller.client, resource) {
                        Some(result) => result.map(Some),
                        None => {
                            Err(CallError::refused("this connection has no stream into this rotary buffer"))
                        }
                    },
                }
            }
        }
    }

    /// Answers with the result of the caller's sequence of lines if that has ended already, or waits for its end.
    fn finish_lines(&mut self, caller: Caller, batch: Batch, now: Instant) -> Answered {
        if let Some(result) = self.sequences.take_result(caller.client, Resource::Lines) {
            return result.map(Some);
        }
        match self.sequences.on(Resource::Lines) {
            Some((number, running)) if running.owner.client == caller.client && !running.is_told => {
                self.wait_for_end(number, caller)
            }
            _ => self.begin_sequence(caller, lines(batch), now),
        }
    }

    /// The number of the caller's stream into rotary buffer `buffer`.
    ///
    /// # Errors
    /// The caller has no such stream (any more).
    pub(super) fn own_stream(&self, caller: Caller, buffer: usize) -> Result<u64, CallError> {
        let own = self.sequences.of_client(caller.client, Resource::Rotary(buffer));
        own.ok_or_else(|| {
            CallError::refused(
                "this connection has no stream into this rotary buffer (any more): RotaryStart begins one",
            )
        })
    }

    /// Ends the gather of the caller's user, the gather of the user `uid`, or a gather without an owner.
    fn stop_gather(&mut self, caller: Caller, uid: Option<u32>, now: Instant) -> Answered {
        let Some((number, running)) = self.sequences.on(Resource::Gather) else {
            if let Some(result) = self.sequences.take_result(caller.client, Resource::Gather) {
                return result.map(Some);
            }
            let family = self.info.family();
            return self.begin_sequence(caller, stop_gather(family, caller.peer), now);
        };
        let owner = running.owner;
        if owner.client == caller.client && running.ending.is_none() {
            return self.ask_sequence(number, caller, Asked::Stop, now);
        }
        if owner.peer.uid.as_raw() != uid.unwrap_or(caller.peer.uid.as_raw()) {
            return Err(Sequences::not_yours(running, now));
        }
        let waits = self.wait_for_end(number, caller);
        self.end_sequence(number, Ending::EndedBy(caller.peer), now);
        waits
    }

    /// `caller` waits for the end of sequence `number`, as the owner does.
    fn wait_for_end(&mut self, number: u64, caller: Caller) -> Answered {
        if let Some(running) = self.sequences.get_mut(number) {
            running.waiters.push(caller);
        }
        self.wait_for_sequence(caller);
        Ok(None)
    }

    /// A client has stopped every motor: ends every stream that feeds a program.
    pub(super) fn end_streams(&mut self, by: Peer, character: u8, now: Instant) {
        self.leftovers.aborted(Systems::ALL);
        for number in self.sequences.that_feed(Systems::ALL) {
            self.end_sequence(number, Ending::AllStopped(by, character), now);
        }
    }

    /// A client has closed the open buffer: the board takes no more lines of a stream. The daemon ends every stream at
    /// once, before a client opens another buffer.
    pub(super) fn end_closed_streams(&mut self, by: Peer, now: Instant) {
        for number in self.sequences.that_feed(Systems::ALL) {
            self.end_sequence(number, Ending::Closed(by), now);
        }
    }

    /// A client has aborted the coordinate systems in `systems`: ends the streams that feed their programs.
    pub(super) fn end_streams_of(&mut self, systems: Systems, by: Peer, now: Instant) {
        self.leftovers.aborted(systems);
        for number in self.sequences.that_feed(systems) {
            self.end_sequence(number, Ending::Aborted(by), now);
        }
    }

    /// Begins `script` for `caller`. Returns the reply, if it is known at once.
    pub(super) fn begin_sequence(&mut self, caller: Caller, script: Script, now: Instant) -> Answered {
        let name = script.name().to_owned();
        let number = self.sequences.begin(script, caller, now)?;
        let Peer { uid, pid, .. } = caller.peer;
        info!(target: "audit", "uid {uid} pid {pid} begins a {name}");
        self.reply_of(number, caller, now)
    }

    /// Passes the owner's request on to sequence `number`. Returns the reply, if it is known at once.
    pub(super) fn ask_sequence(
        &mut self,
        number: u64,
        caller: Caller,
        asked: Asked,
        now: Instant,
    ) -> Answered {
        let Some(running) = self.sequences.get_mut(number) else { return Err(CallError::Busy) };
        running.script.ask(asked)?;
        running.call = Some(caller);
        if running.waits.is_board() {
            // The bus thread finishes the step under way first.
            self.wait_for_sequence(caller);
            return Ok(None);
        }
        self.reply_of(number, caller, now)
    }

    fn reply_of(&mut self, number: u64, caller: Caller, now: Instant) -> Answered {
        match self.drive(number, None, now) {
            Some((_, reply)) => reply.map(Some),
            None => {
                self.wait_for_sequence(caller);
                Ok(None)
            }
        }
    }

    fn wait_for_sequence(&mut self, caller: Caller) {
        if let Some(client) = self.clients.get_mut(caller.client) {
            client.wait_for(Waiting::Board);
        }
    }

    /// Takes the steps of sequence `number`, until a step takes time. Returns the answer to the owner's call, if it is
    /// known now.
    fn drive(&mut self, number: u64, mut done: Option<Done>, now: Instant) -> Option<OwnersAnswer> {
        loop {
            let running = self.sequences.get_mut(number)?;
            let owner = running.owner;
            if done.is_none()
                && self.clients.get(owner.client).is_some_and(|client| client.unsent() > HIGH_WATER)
            {
                running.waits = Waits::Until(now + UNFETCHED);
                return None;
            }
            match running.script.next(done.take(), now) {
                Step::Board(request, timeout) => {
                    // A refused line is a step that is done.
                    done = Some(self.hand_step(number, request, now + timeout, now)?);
                }
                Step::Wait(moment) => {
                    running.waits = Waits::Until(moment);
                    return None;
                }
                Step::Rest => {
                    running.waits = Waits::Owner;
                    return None;
                }
                Step::Tell(reply) => {
                    if running.call.is_some_and(|caller| !caller.oneway) {
                        self.clients.reply(owner.client, &Reply { continues: Some(true), ..reply }, now);
                    }
                }
                Step::Answer(reply) => {
                    // A stream has cleared the lines left before it, or runs them as its own.
                    self.leftovers.forget(running.script.feeds());
                    running.waits = Waits::Until(now);
                    let call = running.call.take();
                    self.sequences.renew(owner.client, now);
                    return call.map(|caller| (caller, reply));
                }
                Step::AnswerEnd(reply) => {
                    running.is_told = true;
                    running.waits = Waits::Until(now);
                    let (call, waiters) = (running.call.take(), std::mem::take(&mut running.waiters));
                    for waiter in waiters {
                        self.answer(waiter, reply.clone(), now);
                    }
                    return call.map(|caller| (caller, reply));
                }
                Step::Over(reply) => return self.sequence_over(number, reply, now),
            }
        }
    }

    /// Hands the bus thread a step of sequence `number`. Returns the outcome if the step is a line that the daemon
    /// refuses to send.
    fn hand_step(&mut self, number: u64, request: Request, deadline: Instant, now: Instant) -> Option<Done> {
        let running = self.sequences.get(number)?;
        let (peer, client, is_ending) = (running.owner.peer, running.owner.client, running.ending.is_some());
        let (is_inside, is_stream) = (running.script.is_inside(), !running.script.feeds().is_empty());
        let (mut effect, mut audit) = (LineEffect::default(), None);
        if let Request::Line(line) = &request {
            let sends = format!("({}) sends {:?}", running.script.name(), without_password(line));
            audit = audit::entry(peer, sends, line.meaning.only_asks_for_variables);
            if !is_stream {
                match self.may_send(client, line, false) {
                    Ok(found) => effect = found,
                    Err(refused) => {
                        let why = Outcome::Refused(Text::of(&refused));
                        return Some(self.done(number, why, Err(refused), Found::default()));
                    }
                }
            }
        }
        let running = self.sequences.get_mut(number)?;
        running.waits = if matches!(request, Request::Check) { Waits::Check(now) } else { Waits::Board };
        let (account, uid) = (peer.account(), peer.uid.as_raw());
        self.calls.ask(step_of(peer), deadline, Then::Sequence(number, effect), audit, |ticket| {
            // The bus thread does not send a question while a client has a program buffer open: the line would enter
            // that buffer.
            let (line, stays, inside) = match request {
                Request::Line(line) => (line, is_ending, is_inside),
                Request::Ask(line) => (line, false, false),
                Request::Check => (Line::of(resets::QUESTION), false, false),
                Request::Job(job) => return Command::Job { ticket, job, deadline },
                Request::Control(character) => {
                    return Command::Control { ticket, uid, drops_lines: false, character, deadline };
                }
                Request::Read { first, count } => return Command::ReadWords { ticket, first, count },
            };
            let origin = Origin::of(uid, &line, stays);
            let number = if is_stream { Writer::STREAMS } else { number };
            let writer = Writer::Sequence { number, account, inside };
            Command::Send { ticket, line, origin, deadline, writer }
        });
        None
    }

    /// Sequence `number` is over, with this `reply`. Returns the answer to the owner's call, if one waits.
    fn sequence_over(
        &mut self,
        number: u64,
        reply: Result<Reply, CallError>,
        now: Instant,
    ) -> Option<OwnersAnswer> {
        let Running { script, owner, ending, call, waiters, is_told, .. } = self.sequences.over(number)?;
        if let Some(lines) = script.leaves() {
            self.leftovers.set(script.feeds(), lines);
        }
        let (name, Peer { uid, pid, .. }) = (script.name(), owner.peer);
        match (&ending, &reply) {
            (Some(why), _) => {
                info!(target: "audit", "the {name} of uid {uid} pid {pid} has been ended: {why}");
            }
            (None, Err(error)) => {
                info!(target: "audit", "the {name} of uid {uid} pid {pid} failed: {error}");
            }
            (None, Ok(_)) => info!(target: "audit", "the {name} of uid {uid} pid {pid} is over"),
        }
        if call.is_none() && !is_told && self.clients.get(owner.client).is_some() {
            self.sequences.keep_result(owner.client, script.resource(), reply.clone());
        }
        for waiter in waiters {
            self.answer(waiter, reply.clone(), now);
        }
        call.map(|caller| (caller, reply))
    }

    /// Goes on with sequence `number`, and answers the owner's call once the answer is known.
    fn go_on(&mut self, number: u64, done: Option<Done>, now: Instant) {
        if let Some((caller, reply)) = self.drive(number, done, now) {
            self.answer(caller, reply, now);
        }
    }

    /// The bus thread has finished a step of sequence `number`, or has failed to.
    pub(super) fn step_done(
        &mut self,
        (number, effect): (u64, LineEffect),
        heard: Heard,
        found: Found,
        now: Instant,
    ) {
        let outcome = heard.outcome;
        let Some(running) = self.sequences.get(number) else { return };
        let (waits, by) = (running.waits, running.owner.peer.account());
        if let (Waits::Check(asked), Outcome::Done) = (waits, outcome) {
            self.see_counter(&heard.lines, asked, now);
        }
        if outcome == Outcome::Done {
            self.line_done(effect, by, now);
        }
        let done = self.done(number, outcome, heard.lines(now), found);
        self.go_on(number, Some(done), now);
    }

    /// The outcome of its step, for sequence `number`.
    fn done(
        &self,
        number: u64,
        outcome: Outcome,
        result: Result<Vec<String>, CallError>,
        found: Found,
    ) -> Done {
        let (resets, doubts) = (self.resets.count(), self.resets.doubts());
        let Found { rotary, words } = found;
        let running = self.sequences.get(number);
        let ended_by = running.and_then(|running| {
            let ends = |ends: &LineEnds| running.is_ended_by(ends);
            self.sent_stops.that_ended(number, running.owner.since, ends, self.info.family())
        });
        let (gathers, programs_run) = (self.info.gathers(), self.info.programs_run());
        Done { outcome, result, resets, doubts, rotary, words, gathers, programs_run, ended_by }
    }

    /// Goes on with the sequences whose wait is over, and ends the sequences whose owner is gone or silent.
    pub(super) fn tend_sequences(&mut self, now: Instant) {
        let clients = &self.clients;
        let lapsed = self.sequences.lapsed(now, |client| clients.hears(client), self.stopping.is_some());
        for (number, why) in lapsed {
            self.end_sequence(number, why, now);
        }
        for number in self.sequences.due(now) {
            self.go_on(number, None, now);
        }
    }

    /// Begins the end of sequence `number`, unless the sequence is ending already.
    fn end_sequence(&mut self, number: u64, why: Ending, now: Instant) {
        let Some(running) = self.sequences.get_mut(number).filter(|running| running.ending.is_none()) else {
            return;
        };
        let (name, Peer { uid, pid, .. }) = (running.script.name(), running.owner.peer);
        info!(target: "audit", "ends the {name} of uid {uid} pid {pid}: {why}");
        running.ending = Some(why);
        running.script.end(why);
        let is_gone = !self.clients.hears(running.owner.client);
        if let Some(caller) = running.call.take_if(|_| is_gone)
            && let Some(client) = self.clients.get_mut(caller.client)
        {
            client.wait_for(Waiting::Nothing);
        }
        if !running.waits.is_board() {
            self.go_on(number, None, now);
        }
    }

    /// The daemon stops: ends every sequence, and lets no call begin anything. [`Self::has_sequences`] tells when all
    /// have ended.
    pub(super) fn stop_sequences(&mut self, now: Instant) {
        self.stopping = Some(now);
        self.tend_sequences(now);
        self.hand_out(now);
    }

    /// Whether sequences run.
    pub(super) fn has_sequences(&self) -> bool {
        self.sequences.count() > 0
    }
}

/// The caller for the steps of a sequence of `owner`. The steps take the turn of the owner's user; the bus thread does
/// them even if the owner has gone.
fn step_of(owner: Peer) -> Caller {
    Caller { client: Caller::NOBODY, peer: owner, oneway: true }
}
