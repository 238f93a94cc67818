//! The running sequences, each with its owner and the end of the owner's lease.

use std::collections::BTreeMap;
use std::fmt;
use std::time::Instant;

use nix::unistd::Uid;

use crate::daemon::scripts::{Batch, Ending, GatherCall, Resource, RotaryCall, Script};
use crate::daemon::shared::caller::Caller;
use crate::daemon::shared::leases::SEQUENCE_LEASE;
use crate::daemon::shared::peer::Peer;
use crate::daemon::shared::queue::{REASON_MAX, Text};
use crate::language::LineEnds;
use crate::map::Systems;
use crate::protocol::{CallError, Reply};

/// A client's call to a sequence, or to begin a sequence.
#[derive(Debug)]
pub enum SequenceCall {
    /// Renew the lease: the owner is still there.
    Renew,
    /// Send these lines.
    Lines(Batch),
    /// Gather.
    Gather(GatherCall),
    /// End the gather of the caller, or of the user with this number.
    GatherStop {
        /// The user.
        uid: Option<u32>,
    },
    /// Stream into a rotary buffer.
    Rotary(RotaryCall),
    /// No more lines follow in the rotary buffer with this index.
    RotaryFinish(usize),
    /// End the stream into the rotary buffer with this index.
    RotaryStop(usize),
}

/// The owner of a sequence.
#[derive(Debug, Clone, Copy)]
pub(super) struct Owner {
    /// The connection.
    pub client: u64,
    /// The process at the other end of the connection.
    pub peer: Peer,
    /// When the sequence began.
    pub since: Instant,
}

/// The event that a sequence waits for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Waits {
    /// The bus thread's step.
    Board,
    /// The board's answer to the question for its servo counter, asked then.
    Check(Instant),
    /// This moment.
    Until(Instant),
    /// The owner's next call.
    Owner,
}

impl Waits {
    /// Whether the bus thread has a step to do.
    pub(super) const fn is_board(self) -> bool {
        matches!(self, Self::Board | Self::Check(_))
    }
}

/// A sequence that runs.
#[derive(Debug)]
pub(super) struct Running {
    /// The script that gives the steps.
    pub script: Script,
    /// The owner.
    pub owner: Owner,
    /// The owner's call that waits for an answer.
    pub call: Option<Caller>,
    /// The event that the sequence waits for.
    pub waits: Waits,
    /// When the owner spoke last.
    heard: Instant,
    /// Why the sequence ends, once it is ending.
    pub ending: Option<Ending>,
    /// Other callers that wait for the end.
    pub waiters: Vec<Caller>,
    /// The owner and the waiters have heard of the end, which goes on.
    pub is_told: bool,
}

impl Running {
    /// Whether a line that `ends` these ends the sequence's work.
    pub(super) fn is_ended_by(&self, ends: &LineEnds) -> bool {
        match self.script.resource() {
            Resource::Gather => ends.gather,
            Resource::Rotary(_) => ends.buffer || ends.systems.and(ends.rotary).meets(self.script.feeds()),
            Resource::Lines => ends.buffer,
        }
    }

    /// When the lease ends. It runs only while the daemon waits for the owner.
    fn lapses(&self) -> Option<Instant> {
        (self.ending.is_none() && self.call.is_none()).then(|| self.heard + SEQUENCE_LEASE)
    }
}

/// The text for another user about a resource in use.
struct InUse<'a>(&'a Running, Instant);

impl fmt::Display for InUse<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(Running { script, owner: Owner { peer, since, .. }, ending, .. }, now) = self;
        let seconds = now.saturating_duration_since(*since).as_secs();
        let resource = script.resource();
        write!(
            f,
            "{resource}: uid {} (pid {}) has run a {} for {seconds} s",
            peer.uid,
            peer.pid,
            script.name()
        )?;
        if let Some(why) = ending {
            write!(f, ", which pmacd is ending ({why})")?;
        }
        match script.unfinished() {
            Some(unfinished) => write!(f, "; {unfinished}"),
            None => Ok(()),
        }
    }
}

/// Every sequence, by a number that the daemon never uses again.
#[derive(Debug, Default)]
pub(super) struct Sequences {
    running: BTreeMap<u64, Running>,
    next: u64,
    /// The results of sequences that ended without a call of the owner, each kept for its connection until the owner
    /// asks.
    results: Vec<(u64, Resource, Result<Reply, CallError>)>,
}

impl Sequences {
    /// Takes a sequence in, and returns its number.
    ///
    /// # Errors
    /// Names the owner of the resource in use.
    pub(super) fn begin(&mut self, script: Script, caller: Caller, now: Instant) -> Result<u64, CallError> {
        let resource = script.resource();
        let feeds = script.feeds();
        let excludes = |other: &Script| other.resource() == resource || other.feeds().meets(feeds);
        if let Some(other) = self.running.values().find(|other| excludes(&other.script)) {
            let reason = format!("{}; nothing was sent, try again when it is over", InUse(other, now));
            return Err(CallError::Refused { reason });
        }
        let owner = Owner { client: caller.client, peer: caller.peer, since: now };
        let number = self.next;
        self.next += 1;
        let running = Running {
            script,
            owner,
            call: Some(caller),
            waits: Waits::Owner,
            heard: now,
            ending: None,
            waiters: Vec::new(),
            is_told: false,
        };
        self.running.insert(number, running);
        Ok(number)
    }

    /// Sequence `number`, if it runs.
    pub(super) fn get(&self, number: u64) -> Option<&Running> {
        self.running.get(&number)
    }

    /// Sequence `number`, if it runs.
    pub(super) fn get_mut(&mut self, number: u64) -> Option<&mut Running> {
        self.running.get_mut(&number)
    }

    /// The number of the sequence that `client` has on `resource`, unless it is ending.
    pub(super) fn of_client(&self, client: u64, resource: Resource) -> Option<u64> {
        let mut all = self.running.iter();
        let is_it = |running: &Running| {
            running.owner.client == client
                && running.script.resource() == resource
                && running.ending.is_none()
        };
        all.find(|(_, running)| is_it(running)).map(|(&number, _)| number)
    }

    /// The sequence on `resource`, with its number.
    pub(super) fn on(&self, resource: Resource) -> Option<(u64, &Running)> {
        let mut all = self.running.iter();
        all.find(|(_, running)| running.script.resource() == resource)
            .map(|(&number, running)| (number, running))
    }

    /// The numbers of the sequences that feed programs of `systems`, unless they are ending.
    pub(super) fn that_feed(&self, systems: Systems) -> Vec<u64> {
        let feeds = |running: &Running| running.ending.is_none() && running.script.feeds().meets(systems);
        self.running.iter().filter(|(_, running)| feeds(running)).map(|(&number, _)| number).collect()
    }

    /// The coordinate systems whose programs sequences feed.
    pub(super) fn fed(&self) -> Systems {
        self.running.values().fold(Systems::NONE, |fed, running| fed.and(running.script.feeds()))
    }

    /// Whether a sequence is ending that feeds a program of `systems`.
    pub(super) fn is_ending_feed(&self, systems: Systems) -> bool {
        let mut all = self.running.values();
        all.any(|running| running.ending.is_some() && running.script.feeds().meets(systems))
    }

    /// The work that ending sequences still have to do on the board.
    pub(super) fn unfinished(&self) -> Vec<String> {
        self.running.values().filter_map(|running| running.script.unfinished()).collect()
    }

    /// The sequences that other users than `uid` run.
    pub(super) fn of_others(&self, uid: Uid) -> impl Iterator<Item = String> {
        let others = self.running.values().filter(move |running| running.owner.peer.uid != uid);
        others.map(|Running { script, owner: Owner { peer, .. }, .. }| {
            format!("the {} of uid {} (pid {})", script.name(), peer.uid, peer.pid)
        })
    }

    /// The refusal for another user that would end the sequence without naming its user.
    pub(super) fn not_yours(running: &Running, now: Instant) -> CallError {
        let uid = running.owner.peer.uid;
        CallError::refused(format!(
            "{}; to end it, name its user: pmacctl gather --stop --of {uid}",
            InUse(running, now)
        ))
    }

    /// Keeps the result of a sequence of `client` until the client asks.
    pub(super) fn keep_result(&mut self, client: u64, resource: Resource, result: Result<Reply, CallError>) {
        self.results.retain(|(other, kept, _)| (*other, *kept) != (client, resource));
        self.results.push((client, resource, result));
    }

    /// The result kept for `client`.
    pub(super) fn take_result(
        &mut self,
        client: u64,
        resource: Resource,
    ) -> Option<Result<Reply, CallError>> {
        let index = self.results.iter().position(|(other, kept, _)| (*other, *kept) == (client, resource))?;
        Some(self.results.swap_remove(index).2)
    }

    /// Whether `client` owns a sequence, or has not yet heard how its sequence ended.
    pub(super) fn is_of(&self, client: u64) -> bool {
        self.running.values().any(|running| running.owner.client == client)
            || self.results.iter().any(|(of, ..)| *of == client)
    }

    /// `client` is gone: drops the results kept for it.
    pub(super) fn forget(&mut self, client: u64) {
        self.results.retain(|(other, ..)| *other != client);
    }

    /// Renews the leases of `client`; returns how many sequences it has.
    pub(super) fn renew(&mut self, client: u64, now: Instant) -> usize {
        let own = self.running.values_mut().filter(|running| running.owner.client == client);
        own.map(|running| running.heard = now).count()
    }

    /// From now on sequences send only the lines of their ends.
    pub(super) fn drop_lines(&mut self, reason: Text<REASON_MAX>) {
        self.running.values_mut().for_each(|running| running.script.drop_lines(reason));
    }

    /// Removes a sequence that is over.
    pub(super) fn over(&mut self, number: u64) -> Option<Running> {
        self.running.remove(&number)
    }

    /// The sequences that have to end now, each with the reason: the owner is gone (not `hears`) or was silent for too
    /// long, or the daemon is stopping.
    pub(super) fn lapsed(
        &self,
        now: Instant,
        hears: impl Fn(u64) -> bool,
        stopping: bool,
    ) -> Vec<(u64, Ending)> {
        let ends = |running: &Running| match running.ending {
            Some(_) => None,
            None if stopping => Some(Ending::Stopping),
            None if !hears(running.owner.client) => Some(Ending::OwnerGone),
            None => running.lapses().is_some_and(|end| end <= now).then_some(Ending::OwnerSilent),
        };
        self.running.iter().filter_map(|(&number, running)| Some((number, ends(running)?))).collect()
    }

    /// The sequences whose wait is over.
    pub(super) fn due(&self, now: Instant) -> Vec<u64> {
        let is_due = |running: &Running| matches!(running.waits, Waits::Until(moment) if moment <= now);
        self.running.iter().filter(|(_, running)| is_due(running)).map(|(&number, _)| number).collect()
    }

    /// When the next wait or lease is over.
    pub(super) fn next_moment(&self) -> Option<Instant> {
        let waiting = self.running.values().filter_map(|running| match running.waits {
            Waits::Until(moment) => Some(moment),
            _ => None,
        });
        waiting.chain(self.first_lapse()).min()
    }

    /// When the first lease ends.
    pub(super) fn first_lapse(&self) -> Option<Instant> {
        self.running.values().filter_map(Running::lapses).min()
    }

    /// How many sequences run.
    pub(super) fn count(&self) -> usize {
        self.running.len()
    }
}
