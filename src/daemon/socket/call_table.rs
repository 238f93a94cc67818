//! The calls that wait for the board: each with its caller, the turn of its command, and the lines of the board's reply
//! so far.

use std::collections::HashMap;
use std::time::{Duration, Instant};

use super::call_step::{CallStep, CommandPart};
use super::fair_queue::{FairQueue, Turn};
use super::heard::{COLLECT_MAX, Heard};
use crate::daemon::motion::effect::{CommandEffect, LineEffect};
pub(super) use crate::daemon::shared::caller::Caller;
use crate::daemon::shared::job::Job;
use crate::daemon::shared::queue::{
    Command, GivenUp, Line, Outcome, REASON_MAX, Sender, Text, Ticket, at_once,
};
use crate::function::line_port::ResponseText;
use crate::map::Motors;
use crate::protocol::control;

/// Whether `line` addresses a motor or a coordinate system.
fn addresses(line: &Line) -> bool {
    let named = |pair: &[u8]| matches!(pair[0], b'#' | b'&') && (pair[1].is_ascii_digit() || pair[1] == b' ');
    line.as_bytes().windows(2).any(named)
}

/// How much longer than a call's deadline the server waits for the bus thread: more than a port takes to be silent
/// again after it gave up on a line (1 s), less than a client waits for the daemon (2 s).
const GRACE: Duration = Duration::from_millis(1500);
/// How long the board may take to answer a question that the daemon asks for a call's sake.
const QUESTION_TIMEOUT: Duration = Duration::from_millis(500);
/// The continuation after the bus thread has finished a command, or has failed to.
#[derive(Debug)]
pub(super) enum Then {
    /// A call goes on.
    Call(CallStep),
    /// The stop of this number goes on.
    Stop(u64),
    /// The sequence of this number goes on. The line of its step has this effect.
    Sequence(u64, LineEffect),
}

/// A call that the board has not answered yet.
#[derive(Debug)]
struct Pending {
    caller: Caller,
    /// Until when the caller waits.
    deadline: Instant,
    /// The bus thread has the command, and so decides its outcome.
    is_handed: bool,
    /// The board's reply so far, and its length in bytes.
    lines: Vec<String>,
    length: usize,
    then: Then,
    /// Why nothing may begin after this question: a client has stopped a motion.
    dropped: Option<Text<REASON_MAX>>,
    /// The command's effect.
    effect: CommandEffect,
    /// Whether the log gets an entry when the bus thread gets the command.
    is_logged: bool,
}

impl Pending {
    fn new(caller: Caller, deadline: Instant, then: Then, command: &Command) -> Self {
        let mut pending = Self {
            caller,
            deadline,
            is_handed: false,
            lines: Vec::new(),
            length: 0,
            then,
            dropped: None,
            effect: CommandEffect::of(command),
            is_logged: false,
        };
        if pending.part() == CommandPart::Hold {
            // The ledger already has the motors as held.
            pending.effect.jogs = Motors::NONE;
        }
        pending
    }

    /// The command's part in its call.
    fn part(&self) -> CommandPart {
        match &self.then {
            Then::Call(step) => step.part(),
            Then::Stop(_) | Then::Sequence(..) => CommandPart::Deed,
        }
    }

    /// Ends the call with `outcome`. `is_given_up`: the bus thread has not answered.
    fn end(self, outcome: Outcome, is_given_up: bool) -> Ended {
        let Self { caller, deadline, lines, length, then, effect, is_logged, .. } = self;
        let outcome = self.dropped.map_or(outcome, Outcome::Dropped);
        let is_overlong = length > COLLECT_MAX;
        let heard = Heard { caller, deadline, outcome, lines, is_overlong, is_given_up, is_logged };
        Ended { then, effect, heard }
    }

    /// Whether the command is a stop of the daemon's own.
    fn is_own_stop(&self) -> bool {
        matches!(self.then, Then::Stop(_)) && self.caller.client == Caller::NOBODY
    }

    /// When the server answers the caller without the bus thread: at the caller's own deadline if the bus thread never
    /// got the command, and so has sent nothing.
    fn given_up_at(&self) -> Instant {
        if self.is_handed { self.deadline + GRACE } else { self.deadline }
    }
}

/// A command that has ended.
#[derive(Debug)]
pub(super) struct Ended {
    /// The continuation.
    pub then: Then,
    /// The command's effect, if the board has carried it out.
    pub effect: CommandEffect,
    /// The command's outcome.
    pub heard: Heard,
}

/// Every call that waits for the board.
pub(super) struct CallTable {
    commands: Sender<Command>,
    /// The commands that the bus thread has not answered, in the order in which it gets them.
    queue: FairQueue,
    pending: HashMap<Ticket, Pending>,
    next_ticket: u64,
}

impl CallTable {
    /// An empty table; `commands` leads to the bus thread.
    pub(super) fn new(commands: Sender<Command>) -> Self {
        Self { commands, queue: FairQueue::default(), pending: HashMap::new(), next_ticket: 0 }
    }

    fn new_ticket(&mut self) -> Ticket {
        self.next_ticket += 1;
        Ticket(self.next_ticket)
    }

    /// Queues the command that `command` makes from its ticket; it waits for its turn until `deadline`. The log gets
    /// `audit` when the bus thread gets the command.
    pub(super) fn ask(
        &mut self,
        caller: Caller,
        deadline: Instant,
        then: Then,
        audit: Option<String>,
        command: impl FnOnce(Ticket) -> Command,
    ) {
        let ticket = self.new_ticket();
        let command = command(ticket);
        let pending = Pending::new(caller, deadline, then, &command);
        self.pending.insert(ticket, Pending { is_logged: audit.is_some(), ..pending });
        self.queue.wait(caller.peer.uid, Turn { ticket, command, audit });
    }

    /// Has the bus thread do `job` for the daemon itself, ahead of waiting commands. `None` when the queue is full.
    pub(super) fn send_now(&mut self, job: Job, deadline: Instant) -> Option<Ticket> {
        let ticket = self.new_ticket();
        let command = Command::Job { ticket, job: Box::new(job), deadline };
        self.commands.try_send(command).is_ok().then_some(ticket)
    }

    /// Has the bus thread carry out a command of the daemon's own, ahead of waiting commands; `then` follows. Returns
    /// false, and nothing follows, when too many such commands are under way or the queue is full.
    pub(super) fn send_own(
        &mut self,
        caller: Caller,
        deadline: Instant,
        then: Then,
        command: impl FnOnce(Ticket) -> Command,
    ) -> bool {
        let own = self.pending.values().filter(|pending| pending.is_own_stop()).count();
        let ticket = self.new_ticket();
        let command = command(ticket);
        let pending = Pending::new(caller, deadline, then, &command);
        if own >= at_once::STOPS || self.commands.try_send(command).is_err() {
            return false;
        }
        self.pending.insert(ticket, Pending { is_handed: true, ..pending });
        true
    }

    /// Hands the bus thread as many commands as it has room for. Returns the calls whose commands the bus thread did
    /// not get: their time is up, or their clients are gone (not `hears`), wanted a reply and asked for no stop. Lines
    /// wait for the command that `holds` the port. `log` hears of every command that can move a machine.
    pub(super) fn hand_out(
        &mut self,
        holds: Option<GivenUp>,
        now: Instant,
        hears: impl Fn(u64) -> bool,
        mut log: impl FnMut(Caller, &str),
    ) -> Vec<Ended> {
        let mut refused = Vec::new();
        while let Some(turn) = self.queue.next() {
            let outcome = not_begun(turn.is_for_port(), holds, now);
            let Turn { ticket, mut command, audit } = turn;
            let stops_all =
                matches!(command, Command::Control { character, .. } if control::stops(character));
            self.see_address(ticket, &command);
            let pending = self.pending.get_mut(&ticket).filter(|pending| {
                let Caller { client, oneway, .. } = pending.caller;
                // A stop goes out even if no client waits for its answer.
                let is_stop = stops_all || matches!(pending.then, Then::Stop(_));
                let may_go = pending.dropped.is_none() || pending.part() != CommandPart::Deed;
                may_go && (oneway || is_stop || hears(client)) && now < pending.deadline
            });
            if let (Some(pending), Command::Send { deadline, .. }) = (&pending, &mut command)
                && pending.part().is_own_question()
            {
                // The wait here says nothing about the board.
                *deadline = now + QUESTION_TIMEOUT;
            }
            match pending {
                Some(pending) if self.commands.try_send(command).is_ok() => {
                    pending.is_handed = true;
                    let caller = pending.caller;
                    if let Some(what) = audit {
                        log(caller, &what);
                    }
                }
                _ => {
                    self.queue.over(ticket);
                    refused.extend(self.pending.remove(&ticket).map(|pending| pending.end(outcome, true)));
                }
            }
        }
        refused
    }

    /// Adds a line of the board's reply.
    pub(super) fn add_line(&mut self, ticket: Ticket, text: &ResponseText) {
        let Some(pending) = self.pending.get_mut(&ticket) else { return };
        pending.length += text.as_bytes().len() + 1;
        if pending.length <= COLLECT_MAX {
            pending.lines.push(text.to_latin1());
        }
    }

    /// The bus thread has answered: takes out the call, unless its caller already has an answer.
    pub(super) fn end(&mut self, ticket: Ticket, outcome: Outcome) -> Option<Ended> {
        self.queue.over(ticket);
        self.pending.remove(&ticket).map(|pending| pending.end(outcome, false))
    }

    /// Takes out the calls whose time is over, each with its outcome. Lines wait for the command that `holds` the port.
    pub(super) fn expire(&mut self, holds: Option<GivenUp>, now: Instant) -> Vec<Ended> {
        let queue = &mut self.queue;
        let late = self.pending.extract_if(|_, pending| pending.given_up_at() <= now);
        late.map(|(ticket, pending)| {
            let outcome = match queue.take_back(ticket) {
                Some(turn) => not_begun(turn.is_for_port(), holds, now),
                None => Outcome::TimedOut,
            };
            pending.end(outcome, true)
        })
        .collect()
    }

    /// Takes back every line and every request of the panel that waits for its turn, of every client, but no stop.
    ///
    /// If a question under way was to begin something, the daemon refuses the call for this `reason` when the question
    /// ends.
    pub(super) fn drop_what_waits(&mut self, reason: Text<REASON_MAX>) -> Vec<Ended> {
        for pending in self.pending.values_mut().filter(|pending| pending.part() == CommandPart::Before) {
            pending.dropped = Some(reason);
        }
        let stays = |ticket: &Ticket| {
            self.pending.get(ticket).is_some_and(|pending| matches!(pending.then, Then::Stop(_)))
        };
        let mut waiting = self.queue.droppable();
        waiting.retain(|ticket| !stays(ticket));
        let dropped =
            waiting.into_iter().filter(|ticket| self.queue.take_back(*ticket).is_some()).collect::<Vec<_>>();
        dropped.into_iter().filter_map(|ticket| self.end(ticket, Outcome::Dropped(reason))).collect()
    }

    /// A client stops a motion: refuses for this `reason` the starts that still ask the board something, or whose line
    /// the bus thread has not got. Behind the stop they would start what the stop should have stopped.
    pub(super) fn drop_starts(&mut self, reason: Text<REASON_MAX>) {
        for pending in self.pending.values_mut() {
            if let Then::Call(step) = &pending.then
                && step.starts(pending.is_handed)
            {
                pending.dropped = Some(reason);
            }
        }
    }

    /// The bus thread gets `command`: if it changes the address, the answers to questions of orders are old.
    fn see_address(&mut self, ticket: Ticket, command: &Command) {
        let Command::Send { line, .. } = command else { return };
        let of = self.pending.get(&ticket).map(|pending| &pending.then);
        // The lines of orders and stops put the address back.
        if !addresses(line) || !matches!(of, Some(Then::Call(CallStep::Reply(_)) | Then::Sequence(..))) {
            return;
        }
        for pending in self.pending.values_mut().filter(|pending| pending.is_handed) {
            if let Then::Call(CallStep::Order { is_old, .. }) = &mut pending.then {
                *is_old = true;
            }
        }
    }

    /// Whether `client` waits for a call of which the bus thread has got nothing.
    pub(super) fn is_unsent(&self, client: u64) -> bool {
        let mut calls = self.pending.iter().filter(|(_, pending)| pending.caller.client == client);
        calls.any(|(ticket, pending)| self.queue.waits(*ticket) && pending.part() != CommandPart::Behind)
    }

    /// Takes back the held jog of `client`, if the bus thread has not got it; returns the caller.
    pub(super) fn take_back_hold(&mut self, client: u64) -> Option<Caller> {
        let mut holds = self.pending.iter().filter(|(_, pending)| pending.part() == CommandPart::Hold);
        let (&ticket, _) = holds.find(|(_, pending)| pending.caller.client == client)?;
        self.queue.take_back(ticket)?;
        self.pending.remove(&ticket).map(|pending| pending.caller)
    }

    /// `client` is gone: drops its calls. A stop goes on.
    pub(super) fn forget(&mut self, client: u64) {
        self.pending
            .retain(|_, pending| pending.caller.client != client || matches!(pending.then, Then::Stop(_)));
    }

    /// Whether `client` waits for the board and wants no reply.
    pub(super) fn is_oneway(&self, client: u64) -> bool {
        let mut callers = self.pending.values().map(|pending| pending.caller);
        callers.any(|caller| caller.client == client && caller.oneway)
    }

    /// When the server gives up the first call.
    pub(super) fn next_deadline(&self) -> Option<Instant> {
        self.pending.values().map(Pending::given_up_at).min()
    }

    /// Whether [`Self::hand_out`] has something to hand over.
    pub(super) fn has_next(&self) -> bool {
        self.queue.has_next()
    }

    /// Calls that wait for the board.
    pub(super) fn count(&self) -> usize {
        self.pending.len()
    }

    /// Commands that wait for their turn or are with the bus thread.
    pub(super) fn commands(&self) -> usize {
        self.queue.count()
    }
}

/// The outcome of a command that the bus thread did not get: a bare "busy", unless it waited for the command that
/// `holds` the port.
fn not_begun(is_for_port: bool, holds: Option<GivenUp>, now: Instant) -> Outcome {
    holds.filter(|_| is_for_port).map_or(Outcome::Busy, |holds| Outcome::Refused(holds.reason(now)))
}
