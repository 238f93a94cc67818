//! Leases on jogs: a motor jogs only while the client that holds it says so.
//!
//! `PanelHold` starts a jog; the same connection has to renew it within [`LEASE`], again and again. When it does not,
//! or is gone, the stop is requested.

use std::collections::HashMap;
use std::time::{Duration, Instant};

use log::{error, warn};

use crate::daemon::shared::queue::{Outcome, Ticket, at_once};

/// How long a client may be silent.
pub(super) const LEASE: Duration = Duration::from_millis(200);
/// Holds the stops that the board did not take, until they are requested again.
const NOBODY: u64 = u64::MAX;
/// How long until then.
const STOP_AGAIN: Duration = Duration::from_secs(1);
/// Stops that the bus thread has at a time. What ends meanwhile waits and becomes one more.
const STOPS_AT_ONCE: usize = at_once::STOPS;

#[derive(Debug)]
struct Lease {
    /// The motors that jog: bit 0 is motor 1.
    motors: u32,
    until: Instant,
}

/// Every lease there is, by client, and the stops that the board has not taken yet.
#[derive(Debug, Default)]
pub(super) struct Leases {
    held: HashMap<u64, Lease>,
    stopping: HashMap<Ticket, u32>,
}

impl Leases {
    /// `client` holds a jog of the motors in the mask `motors`. One it held before is added to it.
    /// It runs until `begun` at first, when the board must have taken the jog, and after that from renewal to renewal.
    pub(super) fn begin(&mut self, client: u64, motors: u32, begun: Instant) {
        let lease = self.held.entry(client).or_insert(Lease { motors: 0, until: begun });
        lease.until = lease.until.max(begun);
        lease.motors |= motors;
    }

    /// `client` is still there; false when it holds nothing.
    pub(super) fn renew(&mut self, client: u64, now: Instant) -> bool {
        let lease = self.held.get_mut(&client);
        let held = lease.is_some();
        if let Some(lease) = lease {
            lease.until = now + LEASE;
        }
        held
    }

    /// The board has taken the stop of the motors in `mask`, asked for by `client` itself.
    pub(super) fn stopped(&mut self, client: u64, mask: u32) {
        if let Some(lease) = self.held.get_mut(&client) {
            lease.motors &= !mask;
            if lease.motors == 0 {
                self.held.remove(&client);
            }
        }
    }

    /// The request with `ticket` is over: if it had to stop a jog and was not taken, it comes again.
    pub(super) fn request_over(&mut self, ticket: Ticket, outcome: Outcome, now: Instant) {
        let Some(motors) = self.stopping.remove(&ticket).filter(|_| outcome != Outcome::Done) else { return };
        error!(
            target: "audit",
            "the board did not take the stop of a held jog (mask {:#04x}); asking again", motors
        );
        self.begin(NOBODY, motors, now + STOP_AGAIN);
    }

    /// Has `send` request the stop of every jog whose holder is silent or not there (`is_there`), all in one request. False when
    /// `send` had no room for it; what is held stays held then.
    pub(super) fn end_lapsed(
        &mut self,
        now: Instant,
        is_there: impl Fn(u64) -> bool,
        send: impl FnOnce(u32) -> Option<Ticket>,
    ) -> bool {
        if !self.may_stop() {
            return true;
        }
        let has_lapsed =
            |client: u64, lease: &Lease| lease.until <= now || client != NOBODY && !is_there(client);
        self.end(now, has_lapsed, send)
    }

    /// As [`Self::end_lapsed`], of every jog that is held.
    pub(super) fn end_all(&mut self, now: Instant, send: impl FnOnce(u32) -> Option<Ticket>) -> bool {
        self.end(now, |_, _| true, send)
    }

    fn end(
        &mut self,
        now: Instant,
        ends: impl Fn(u64, &Lease) -> bool,
        send: impl FnOnce(u32) -> Option<Ticket>,
    ) -> bool {
        let ended: Vec<(u64, Lease)> = self.held.extract_if(|client, lease| ends(*client, lease)).collect();
        if ended.is_empty() {
            return true;
        }
        let all = ended.iter().fold(0, |all, (_, lease)| all | lease.motors);
        let ticket = send(all);
        for (client, Lease { motors, .. }) in ended {
            if ticket.is_none() {
                // The stop must not be forgotten.
                self.begin(client, motors, now);
                continue;
            }
            warn!(target: "audit", "a held jog is stopped (mask {motors:#04x}): its holder is gone or silent");
        }
        ticket.is_some_and(|ticket| self.stopping.insert(ticket, all).is_none())
    }

    /// Jogs that are held, and stops that the board has not taken.
    pub(super) fn count(&self) -> usize {
        self.held.len() + self.stopping.len()
    }

    /// Whether another stop may be requested now.
    fn may_stop(&self) -> bool {
        self.stopping.len() < STOPS_AT_ONCE
    }

    /// When the next one runs out, unless its stop has to wait for others to be over.
    pub(super) fn next_end(&self) -> Option<Instant> {
        self.held.values().map(|lease| lease.until).min().filter(|_| self.may_stop())
    }

    /// When the first lease of the clients that are there (`is_there`) runs out.
    pub(super) fn first_end(&self, is_there: impl Fn(u64) -> bool) -> Option<Instant> {
        self.held.iter().filter(|(client, _)| is_there(**client)).map(|(_, lease)| lease.until).min()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The stop that is requested, if one is.
    fn ended(leases: &mut Leases, now: Instant, is_there: impl Fn(u64) -> bool) -> Option<u32> {
        let mut requested = None;
        leases.end_lapsed(now, is_there, |stop| {
            requested = Some(stop);
            Some(Ticket(u64::MAX))
        });
        requested
    }

    #[test]
    fn silence_and_absence_end_a_lease_and_renewal_does_not() {
        let now = Instant::now();
        let stop = |motor| 1_u32 << (motor - 1);
        let mut leases = Leases::default();
        for (client, motor) in [(7, 1), (7, 3), (8, 2)] {
            leases.begin(client, stop(motor), now + LEASE);
        }
        assert!(leases.renew(7, now + LEASE / 2) && !leases.renew(9, now));
        assert_eq!(leases.next_end(), Some(now + LEASE));
        assert_eq!(ended(&mut leases, now + LEASE, |_| true), Some(stop(2)));
        assert_eq!(ended(&mut leases, now + LEASE, |_| true), None);
        let both = 0b101;
        let is_there = |client| client != 7;
        assert!(!leases.end_lapsed(now + LEASE, is_there, |_| None), "no room for the request");
        assert_eq!(ended(&mut leases, now + LEASE, is_there), Some(both));
        assert_eq!(leases.next_end(), None);
        leases.begin(7, both, now + LEASE);
        leases.stopped(7, 0b001);
        assert!(leases.renew(7, now), "motor 3 is still held");
        leases.stopped(7, 0b100);
        assert!(!leases.renew(7, now));
    }

    #[test]
    fn what_ends_while_many_stops_are_under_way_waits_for_one_to_be_over() {
        let now = Instant::now();
        let stop = 0b1;
        let mut leases = Leases::default();
        for ticket in 0..STOPS_AT_ONCE as u64 {
            leases.begin(7, stop, now);
            assert!(leases.may_stop() && leases.next_end() == Some(now));
            assert!(leases.end_lapsed(now, |_| true, |_| Some(Ticket(ticket))));
        }
        leases.begin(7, stop, now);
        assert!(!leases.may_stop() && leases.next_end().is_none(), "nothing to wake up for");
        assert_eq!(ended(&mut leases, now, |_| true), None);
        leases.request_over(Ticket(0), Outcome::Done, now);
        assert!(leases.may_stop() && leases.next_end() == Some(now));
        assert_eq!(ended(&mut leases, now, |_| true), Some(stop));
        leases.request_over(Ticket(1), Outcome::TimedOut, now);
        assert_eq!(leases.next_end(), Some(now + STOP_AGAIN), "it comes again");
        assert!(leases.end_all(now, |_| Some(Ticket(99))) && leases.next_end().is_none());
    }
}
