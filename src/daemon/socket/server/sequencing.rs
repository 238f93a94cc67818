//! Drives the sequences: has the bus thread do their steps, answers their owners, and brings about their ends.

use std::time::{Duration, Instant};

use log::info;

use super::Service;
use crate::daemon::shared::queue::{Command, Outcome};
use crate::daemon::socket::audit::without_password;
use crate::daemon::socket::call_table::{Caller, Ended, Then};
use crate::daemon::socket::connection::{HIGH_WATER, Waiting};
use crate::daemon::socket::policy::Peer;
use crate::daemon::socket::sequences::{
    Done, END_STEP, Lines, Resource, Sequence, SequenceCall, Step, Waits,
};
use crate::function::rotary::RotaryState;
use crate::protocol::{CallError, Reply};

/// How long a sequence waits for its owner to fetch what it has been told.
const UNFETCHED: Duration = Duration::from_millis(20);
/// How long, at the daemon's end, all ends together may take.
pub(super) const LAST_STEPS: Duration = END_STEP;

/// The owner's call, and what it is answered.
type Answer = (Caller, Result<Reply, CallError>);

impl Service {
    /// Begins a sequence, or passes a call on to the one that the caller has. The reply, if there is one at once.
    pub(super) fn sequence_call(
        &mut self,
        caller: Caller,
        call: SequenceCall,
        now: Instant,
    ) -> Result<Option<Reply>, CallError> {
        match call {
            SequenceCall::Renew => match self.sequences.renew(caller.client, now) {
                0 => Err(CallError::Refused {
                    reason: "this connection has no sequence (any more)".to_owned(),
                }),
                _ => Ok(Some(Reply::done())),
            },
            SequenceCall::Lines(batch) => match self.sequences.of_client(caller.client, Resource::Lines) {
                Some(number) => self.ask_sequence(number, caller, SequenceCall::Lines(batch), now),
                None => self.begin_sequence(caller, Box::new(Lines::new(batch)), now),
            },
        }
    }

    /// Begins `machine` for `caller`. The reply, if there is one at once.
    pub(super) fn begin_sequence(
        &mut self,
        caller: Caller,
        machine: Box<dyn Sequence>,
        now: Instant,
    ) -> Result<Option<Reply>, CallError> {
        let name = machine.name().to_owned();
        let number = self.sequences.begin(machine, caller, now)?;
        let Peer { uid, pid, .. } = caller.peer;
        info!(target: "audit", "uid {uid} pid {pid} begins a {name}");
        self.reply_of(number, caller, now)
    }

    /// Passes the owner's `call` on to sequence `number`. The reply, if there is one at once.
    pub(super) fn ask_sequence(
        &mut self,
        number: u64,
        caller: Caller,
        call: SequenceCall,
        now: Instant,
    ) -> Result<Option<Reply>, CallError> {
        let Some(running) = self.sequences.get_mut(number) else { return Err(CallError::Busy) };
        running.machine.asked(call, now)?;
        running.call = Some(caller);
        if running.waits == Waits::Board {
            // What is under way is finished first.
            self.wait_for_sequence(caller);
            return Ok(None);
        }
        self.reply_of(number, caller, now)
    }

    fn reply_of(&mut self, number: u64, caller: Caller, now: Instant) -> Result<Option<Reply>, CallError> {
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

    /// Takes the steps of sequence `number`, until one takes time. What its owner's call is answered, if it is now.
    fn drive(&mut self, number: u64, mut done: Option<Done>, now: Instant) -> Option<Answer> {
        loop {
            let running = self.sequences.get_mut(number)?;
            let owner = running.owner;
            if done.is_none()
                && self.clients.get(owner.client).is_some_and(|client| client.unsent() > HIGH_WATER)
            {
                running.waits = Waits::Until(now + UNFETCHED);
                return None;
            }
            match running.machine.next(done.take(), now) {
                Step::Line { line, timeout } => {
                    running.waits = Waits::Board;
                    let audit =
                        Some(format!("({}) sends {:?}", running.machine.name(), without_password(&line)));
                    let deadline = now + timeout;
                    self.calls.ask(step_of(owner.peer), deadline, Then::Sequence(number), audit, |ticket| {
                        Command::Send { ticket, line, deadline, question: false }
                    });
                    return None;
                }
                Step::Job { job, timeout } => {
                    running.waits = Waits::Board;
                    let deadline = now + timeout;
                    self.calls.ask(step_of(owner.peer), deadline, Then::Sequence(number), None, |ticket| {
                        Command::Job { ticket, job, deadline }
                    });
                    return None;
                }
                Step::Wait(moment) => {
                    running.waits = Waits::Until(moment);
                    return None;
                }
                Step::Tell(reply) => {
                    if running.call.is_some_and(|caller| !caller.oneway) {
                        self.clients.reply(owner.client, &Reply { continues: Some(true), ..reply }, now);
                    }
                }
                Step::Answer(reply) => {
                    running.waits = Waits::Owner;
                    let call = running.call.take();
                    self.sequences.renew(owner.client, now);
                    return call.map(|caller| (caller, reply));
                }
                Step::Over(reply) => {
                    let running = self.sequences.over(number)?;
                    let (name, Peer { uid, pid, .. }) = (running.machine.name(), owner.peer);
                    match (&running.ending, &reply) {
                        (Some(why), _) => {
                            info!(target: "audit", "the {name} of uid {uid} pid {pid} has been ended: {why}");
                        }
                        (None, Err(error)) => {
                            info!(target: "audit", "the {name} of uid {uid} pid {pid} failed: {error}");
                        }
                        (None, Ok(_)) => info!(target: "audit", "the {name} of uid {uid} pid {pid} is over"),
                    }
                    return running.call.map(|caller| (caller, reply));
                }
            }
        }
    }

    /// Goes on with sequence `number`, and answers its owner's call if that is over.
    fn go_on(&mut self, number: u64, done: Option<Done>, now: Instant) {
        if let Some((caller, reply)) = self.drive(number, done, now) {
            self.answer(caller, reply, now);
        }
    }

    /// The bus thread has done a step of sequence `number`, or not.
    pub(super) fn step_done(
        &mut self,
        number: u64,
        ended: Ended,
        outcome: Outcome,
        rotary: Option<RotaryState>,
        now: Instant,
    ) {
        let result = super::calls::reply_lines(outcome, ended.lines, ended.is_overlong);
        self.go_on(number, Some(Done { outcome, result, rotary }), now);
    }

    /// Goes on with the sequences that have waited for this moment, and ends those whose owner is gone or silent.
    pub(super) fn tend_sequences(&mut self, now: Instant) {
        let clients = &self.clients;
        let lapsed = self.sequences.lapsed(now, |client| clients.hears(client), self.stopping);
        for (number, why) in lapsed {
            let Some(running) = self.sequences.get_mut(number) else { continue };
            let (name, Peer { uid, pid, .. }) = (running.machine.name(), running.owner.peer);
            info!(target: "audit", "ends the {name} of uid {uid} pid {pid}: {why}");
            running.ending = Some(why);
            running.machine.end(why);
            let is_gone = !self.clients.hears(running.owner.client);
            if let Some(caller) = running.call.take_if(|_| is_gone)
                && let Some(client) = self.clients.get_mut(caller.client)
            {
                client.wait_for(Waiting::Nothing);
            }
            if running.waits != Waits::Board {
                self.go_on(number, None, now);
            }
        }
        for number in self.sequences.due(now) {
            self.go_on(number, None, now);
        }
    }

    /// The daemon stops: every sequence ends, and no call is begun any more. [`Self::has_sequences`] tells when they have.
    pub(super) fn stop_sequences(&mut self, now: Instant) {
        self.stopping = true;
        self.tend_sequences(now);
        self.hand_out(now);
    }

    /// Whether sequences run.
    pub(super) fn has_sequences(&self) -> bool {
        self.sequences.count() > 0
    }
}

/// Who asks for the steps of a sequence of `owner`: its user, whose turn they take; but they are done whether it hears or not.
fn step_of(owner: Peer) -> Caller {
    Caller { client: u64::MAX, peer: owner, oneway: true }
}
