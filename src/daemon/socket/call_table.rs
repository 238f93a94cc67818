//! The calls that wait for the board: whose each is, when its command has its turn, and what has come of its reply.

use std::collections::HashMap;
use std::time::{Duration, Instant};

use super::fair_queue::{FairQueue, Turn};
use super::first_start::FirstStart;
use super::jobs::{Guard, JobCall};
use super::jog_to::JogTo;
use crate::daemon::motion::effect::{CommandEffect, LineEffect};
pub(super) use crate::daemon::shared::caller::Caller;
use crate::daemon::shared::job::Job;
use crate::daemon::shared::open_buffer::Writer;
use crate::daemon::shared::queue::{Command, GivenUp, Outcome, Sender, Ticket, at_once};
use crate::function::line_port::ResponseText;
use crate::function::variable_read::VariableEntry;
use crate::map::Motors;
use crate::protocol::{CallError, control};

/// How much longer than asked the bus thread may take for what it was given before it is not believed to answer at all: more
/// than a port takes to be silent again after it gave up on a line (1 s), less than a client waits for the daemon (2 s).
const GRACE: Duration = Duration::from_millis(1500);
/// How long the board may take to answer a question of the daemon's own.
const QUESTION_TIMEOUT: Duration = Duration::from_millis(500);
/// The longest reply of the board that is collected, in bytes.
pub(super) const COLLECT_MAX: usize = 1024 * 1024;

/// What follows when the board has done what was asked of it.
#[derive(Debug)]
pub(super) enum Then {
    /// The caller gets the lines of the board's reply.
    ReplyLines,
    /// The caller gets them, too, and the line has this effect.
    ReplyToLine(LineEffect),
    /// The caller hears that it is done. If it is refused, the board is asked whether what it needs is still so.
    ReplyDone(Option<Guard>),
    /// The caller hears that the jog he holds has begun.
    ReplyHeld,
    /// The caller hears this, and what the board says of the guard.
    Reason(Guard, CallError),
    /// The caller gets remarks.
    ReplyNotes(Vec<String>),
    /// A job begins, if the board's answer is what its guard wants.
    Job(JobCall),
    /// The board is asked what the job, which is done, needs to have an effect.
    Question(JobCall, Guard),
    /// The caller gets the job's remarks, among them what the board's answer comes to.
    Notes(JobCall),
    /// A watch on these registers begins, if the board copies any.
    Watch(Vec<VariableEntry>),
    /// The stop of this number goes on.
    Stop(u64),
    /// This jog goes on, until then: the board was asked what is addressed.
    JogTo(JogTo, Instant),
    /// This start goes on: the board was asked what lies in rotary buffers.
    FirstStart(Box<FirstStart>),
    /// The caller hears how many resets were found; the board was asked then for its servo counter.
    Resets(Instant),
    /// The sequence of this number goes on.
    Sequence(u64),
    /// The caller is refused what was to begin: all motion was stopped meanwhile.
    Refuse(String),
}

impl Then {
    /// Whether it follows something that is done already.
    const fn is_remark(&self) -> bool {
        matches!(self, Self::Notes(_))
    }
}

/// A call that the board has not answered yet.
#[derive(Debug)]
struct Pending {
    caller: Caller,
    /// How long its caller waits.
    deadline: Instant,
    /// The bus thread has its command, and so has the last word on it.
    is_handed: bool,
    /// The board's reply so far, and its length in bytes.
    lines: Vec<String>,
    length: usize,
    then: Then,
    /// What its command does.
    effect: CommandEffect,
    /// Whether the log is told when its command is handed over.
    is_logged: bool,
}

impl Pending {
    fn new(caller: Caller, deadline: Instant, then: Then, command: &Command) -> Self {
        let mut effect = CommandEffect::of(command);
        if matches!(then, Then::ReplyHeld) {
            // Its motors stand in the ledger as held.
            effect.jogs = Motors::NONE;
        }
        Self {
            caller,
            deadline,
            is_handed: false,
            lines: Vec::new(),
            length: 0,
            then,
            effect,
            is_logged: false,
        }
    }

    /// Whether the daemon sends it by itself, to stop something.
    fn is_own_stop(&self) -> bool {
        matches!(self.then, Then::Stop(_)) && self.caller.client == Caller::NOBODY
    }

    /// When its caller is answered without the bus thread: at his own deadline if that never got the command, so that nothing
    /// was sent.
    fn given_up_at(&self) -> Instant {
        if self.is_handed { self.deadline + GRACE } else { self.deadline }
    }
}

/// A call that the bus thread has answered.
#[derive(Debug)]
pub(super) struct Ended {
    /// Whose it was.
    pub caller: Caller,
    /// The lines of the board's reply.
    pub lines: Vec<String>,
    /// The reply was longer than [`COLLECT_MAX`], and is not whole.
    pub is_overlong: bool,
    /// What follows.
    pub then: Then,
    /// What its command does, if the board has carried it out.
    pub effect: CommandEffect,
    /// Whether the log says that it was asked for.
    pub is_logged: bool,
}

/// Every call that waits for the board.
pub(super) struct CallTable {
    commands: Sender<Command>,
    /// The commands that the bus thread has not answered, as it gets them.
    queue: FairQueue,
    pending: HashMap<Ticket, Pending>,
    next_ticket: u64,
}

impl CallTable {
    /// Nobody's calls; `commands` lead to the bus thread.
    pub(super) fn new(commands: Sender<Command>) -> Self {
        Self { commands, queue: FairQueue::default(), pending: HashMap::new(), next_ticket: 0 }
    }

    fn new_ticket(&mut self) -> Ticket {
        self.next_ticket += 1;
        Ticket(self.next_ticket)
    }

    /// The command that `command` makes of its ticket waits for its turn, until `deadline`. The log gets `audit` when it
    /// is handed over.
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

    /// Has the bus thread do `job` for the daemon itself, past those who wait. `None` when its queue is full.
    pub(super) fn send_now(&mut self, job: Job, deadline: Instant) -> Option<Ticket> {
        let ticket = self.new_ticket();
        let command = Command::Job { ticket, job: Box::new(job), deadline };
        self.commands.try_send(command).is_ok().then_some(ticket)
    }

    /// Has the bus thread carry out a command of the daemon's own, past those who wait; `then` follows. False, and nothing
    /// follows, when enough of them are under way.
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

    /// Hands the bus thread what it has room for. The calls whose commands were not handed over: of those whose time is
    /// up, or who are gone (not `hears`), wanted a reply, and did not stop anything; each with how it ended. Lines wait for what `holds` the port.
    /// What is handed over and can move a machine is told to `log`.
    pub(super) fn hand_out(
        &mut self,
        holds: Option<GivenUp>,
        now: Instant,
        hears: impl Fn(u64) -> bool,
        mut log: impl FnMut(Caller, &str),
    ) -> Vec<(Ended, Outcome)> {
        let mut refused = Vec::new();
        while let Some(turn) = self.queue.next() {
            let outcome = not_begun(turn.is_for_port(), holds, now);
            let Turn { ticket, mut command, audit } = turn;
            if let Command::Send { writer: Writer::Question, deadline, .. } = &mut command
                && self.is_own_question(ticket)
            {
                // How long it waited here says nothing about the board.
                *deadline = now + QUESTION_TIMEOUT;
            }
            let stops_all =
                matches!(command, Command::Control { character, .. } if control::stops(character));
            let pending = self.pending.get_mut(&ticket).filter(|pending| {
                let Caller { client, oneway, .. } = pending.caller;
                // A stop goes though nobody waits for its answer.
                let is_stop = stops_all || matches!(pending.then, Then::Stop(_));
                (oneway || is_stop || hears(client)) && now < pending.deadline
            });
            match pending {
                Some(pending) if self.commands.try_send(command).is_ok() => {
                    pending.is_handed = true;
                    let caller = pending.caller;
                    if let Some(what) = audit {
                        log(caller, &what);
                    }
                }
                _ => refused.extend(self.end(ticket).map(|ended| (ended, outcome))),
            }
        }
        refused
    }

    /// One more line of the board's reply has come.
    pub(super) fn add_line(&mut self, ticket: Ticket, text: &ResponseText) {
        let Some(pending) = self.pending.get_mut(&ticket) else { return };
        pending.length += text.as_bytes().len() + 1;
        if pending.length <= COLLECT_MAX {
            pending.lines.push(text.to_latin1());
        }
    }

    /// The bus thread has answered: the call, unless its caller has been answered already.
    pub(super) fn end(&mut self, ticket: Ticket) -> Option<Ended> {
        self.queue.over(ticket);
        let Pending { caller, lines, length, then, effect, is_logged, .. } = self.pending.remove(&ticket)?;
        Some(Ended { caller, lines, is_overlong: length > COLLECT_MAX, then, effect, is_logged })
    }

    /// The sequence whose step `ticket` is.
    pub(super) fn sequence_of(&self, ticket: Ticket) -> Option<u64> {
        match self.pending.get(&ticket)?.then {
            Then::Sequence(number) => Some(number),
            _ => None,
        }
    }

    /// Whether `ticket` is a question that the daemon asks for a call's sake.
    fn is_own_question(&self, ticket: Ticket) -> bool {
        let is_callers = |then: &Then| {
            matches!(then, Then::Sequence(_) | Then::ReplyLines | Then::ReplyToLine(_) | Then::ReplyDone(_))
        };
        self.pending.get(&ticket).is_some_and(|pending| !is_callers(&pending.then))
    }

    /// Takes out the calls whose time is over, each with how it ended. Lines wait for what `holds` the port.
    pub(super) fn expire(&mut self, holds: Option<GivenUp>, now: Instant) -> Vec<(Ended, Outcome)> {
        let queue = &mut self.queue;
        let late = self.pending.extract_if(|_, pending| pending.given_up_at() <= now);
        late.map(|(ticket, Pending { caller, lines, then, effect, is_logged, .. })| {
            let outcome = match queue.take_back(ticket) {
                Some(turn) => not_begun(turn.is_for_port(), holds, now),
                None => Outcome::TimedOut,
            };
            (Ended { caller, lines, is_overlong: false, then, effect, is_logged }, outcome)
        })
        .collect()
    }

    /// Takes every line and request of the panel back that waits for its turn, whosever it is, but for what stops.
    ///
    /// What was to begin behind a question is refused for this `reason` when that is answered.
    pub(super) fn drop_what_waits(&mut self, reason: &str) -> Vec<Ended> {
        for pending in self.pending.values_mut() {
            let begins = match &pending.then {
                Then::Job(call) => !call.stops,
                Then::JogTo(..) | Then::FirstStart(_) => true,
                _ => false,
            };
            if begins {
                pending.then = Then::Refuse(reason.to_owned());
            }
        }
        let stays = |ticket: &Ticket| {
            self.pending
                .get(ticket)
                .is_some_and(|pending| matches!(pending.then, Then::Stop(_) | Then::ReplyHeld))
        };
        let mut waiting = self.queue.droppable();
        waiting.retain(|ticket| !stays(ticket));
        let dropped =
            waiting.into_iter().filter(|ticket| self.queue.take_back(*ticket).is_some()).collect::<Vec<_>>();
        dropped.into_iter().filter_map(|ticket| self.end(ticket)).collect()
    }

    /// Whether `client` waits for something of which nothing has been handed over.
    pub(super) fn is_unsent(&self, client: u64) -> bool {
        let mut calls = self.pending.iter().filter(|(_, pending)| pending.caller.client == client);
        calls.any(|(ticket, pending)| self.queue.waits(*ticket) && !pending.then.is_remark())
    }

    /// Takes back the held jog that `client` has asked for, if it was not handed over; whose it was.
    pub(super) fn take_back_hold(&mut self, client: u64) -> Option<Caller> {
        let mut holds = self.pending.iter().filter(|(_, pending)| matches!(pending.then, Then::ReplyHeld));
        let (&ticket, _) = holds.find(|(_, pending)| pending.caller.client == client)?;
        self.queue.take_back(ticket)?;
        self.pending.remove(&ticket).map(|pending| pending.caller)
    }

    /// `client` is gone: nobody waits for its call. A stop goes on.
    pub(super) fn forget(&mut self, client: u64) {
        self.pending
            .retain(|_, pending| pending.caller.client != client || matches!(pending.then, Then::Stop(_)));
    }

    /// Whether `client` waits for the board and wants no reply.
    pub(super) fn is_oneway(&self, client: u64) -> bool {
        let mut callers = self.pending.values().map(|pending| pending.caller);
        callers.any(|caller| caller.client == client && caller.oneway)
    }

    /// When the first call is given up.
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

/// How a command ends that was not handed over. The bare "busy" is for what waited for no command that `holds` the port.
fn not_begun(is_for_port: bool, holds: Option<GivenUp>, now: Instant) -> Outcome {
    holds.filter(|_| is_for_port).map_or(Outcome::Busy, |holds| Outcome::Refused(holds.reason(now)))
}
