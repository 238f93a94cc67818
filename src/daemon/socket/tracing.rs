//! Gives the trace of the daemon's bus accesses to one client at a time, as long as that client takes them.

use std::sync::Arc;
use std::time::Instant;

use super::call_table::Caller;
use super::policy::Peer;
use crate::daemon::shared::leases::TRACE_LEASE;
use crate::device::Trace;
use crate::protocol::CallError;
use crate::protocol::board::TraceReply;

/// The most accesses in one reply.
const ACCESSES_A_REPLY: usize = 4096;

/// The trace, and the client that owns it.
pub(super) struct Tracing {
    trace: Arc<Trace>,
    owner: Option<Owner>,
    /// The client whose trace ended because it made no call, until it has heard of the end.
    silent: Option<u64>,
}

struct Owner {
    client: u64,
    peer: Peer,
    until: Instant,
    /// How many earlier accesses the daemon has dropped.
    dropped: u64,
}

impl Tracing {
    /// A trace that no client has.
    pub(super) fn new(trace: Arc<Trace>) -> Self {
        Self { trace, owner: None, silent: None }
    }

    /// Whether a call of the client would begin a trace.
    pub(super) fn is_free(&self) -> bool {
        self.owner.is_none()
    }

    /// The accesses since the caller's last call. The first call begins the trace; at its `end`, the daemon hands over
    /// the accesses left, and an empty reply is the last.
    ///
    /// # Errors
    /// Another client has the trace, or the caller's own has ended meanwhile.
    pub(super) fn take(&mut self, caller: Caller, end: bool, now: Instant) -> Result<TraceReply, CallError> {
        if self.silent.take_if(|client| *client == caller.client).is_some() {
            // If the trace began again without a word, it would hide how many accesses are missing.
            let reason = format!(
                "the trace has ended: nothing was asked for {} s, and the accesses since are not in it",
                TRACE_LEASE.as_secs()
            );
            return Err(CallError::refused(reason));
        }
        let owner = match &mut self.owner {
            Some(owner) if owner.client != caller.client => {
                let Peer { uid, pid, .. } = owner.peer;
                let reason = format!(
                    "uid {uid} (pid {pid}) traces the bus accesses, which one client can do at a time"
                );
                return Err(CallError::refused(reason));
            }
            Some(owner) => owner,
            None if end => return Ok(TraceReply::default()),
            none => {
                self.trace.begin();
                let Caller { client, peer, .. } = caller;
                none.insert(Owner { client, peer, until: now, dropped: self.trace.dropped() })
            }
        };
        owner.until = now + TRACE_LEASE;
        if end {
            self.trace.end();
        }
        let mut last_ns = 0;
        let accesses: Vec<u64> = self
            .trace
            .take(ACCESSES_A_REPLY)
            .iter()
            .flat_map(|access| {
                let after_ns = access.time_ns.saturating_sub(last_ns);
                last_ns = access.time_ns;
                let place = access.offset.bytes();
                [after_ns, access.kind.number().into(), place.into(), access.value.into()]
            })
            .collect();
        let dropped = self.trace.dropped() - owner.dropped;
        if end && accesses.is_empty() {
            self.owner = None;
        }
        Ok(TraceReply { accesses, dropped })
    }

    /// Whether `client` traces.
    pub(super) fn is_of(&self, client: u64) -> bool {
        self.owner.as_ref().is_some_and(|owner| owner.client == client)
    }

    /// `client` is gone.
    pub(super) fn forget(&mut self, client: u64) {
        self.silent.take_if(|silent| *silent == client);
        self.end_if(|owner| owner.client == client);
    }

    /// Ends the trace of a client that no longer takes the accesses.
    pub(super) fn expire(&mut self, now: Instant) {
        if let Some(owner) = self.end_if(|owner| owner.until <= now) {
            self.silent = Some(owner.client);
        }
    }

    fn end_if(&mut self, is_over: impl FnOnce(&mut Owner) -> bool) -> Option<Owner> {
        self.owner.take_if(is_over).inspect(|_| self.trace.end())
    }

    /// When the trace ends if its client makes no call.
    pub(super) fn next_end(&self) -> Option<Instant> {
        self.owner.as_ref().map(|owner| owner.until)
    }
}
