//! Leases on jogs: a motor jogs only while the client that holds it says so.
//!
//! `PanelHold` starts a jog; the same connection has to renew it within [`LEASE`], again and again. When it does not,
//! or is gone, the stop is requested.

use std::collections::HashMap;
use std::time::{Duration, Instant};

use crate::daemon::shared::queue::{Ticket, at_once};
use crate::function::panel::PanelRequest;

/// How long a client may be silent.
pub(super) const LEASE: Duration = Duration::from_millis(200);
/// Stops that the bus thread has at a time. What ends meanwhile waits and becomes one more.
const STOPS_AT_ONCE: usize = at_once::STOPS;

#[derive(Debug)]
struct Lease {
    stop: PanelRequest,
    until: Instant,
}

/// Every lease there is, by client, and the stops that the board has not taken yet.
#[derive(Debug, Default)]
pub(super) struct Leases {
    held: HashMap<u64, Lease>,
    stopping: HashMap<Ticket, PanelRequest>,
}

impl Leases {
    /// `client` holds a jog that `stop` ends. One it held before is added to it.
    /// It runs until `begun` at first, when the board must have taken the jog, and after that from renewal to renewal.
    pub(super) fn begin(&mut self, client: u64, stop: PanelRequest, begun: Instant) {
        let lease = self.held.entry(client).or_insert(Lease { stop: PanelRequest::default(), until: begun });
        lease.until = lease.until.max(begun);
        lease.stop = lease.stop.together_with(&stop);
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
    pub(super) fn stopped(&mut self, client: u64, mask: u8) {
        if let Some(lease) = self.held.get_mut(&client) {
            lease.stop.mask &= !mask;
            if lease.stop.mask == 0 {
                self.held.remove(&client);
            }
        }
    }

    /// `ticket` requests the stop of what was held.
    pub(super) fn stopping(&mut self, ticket: Ticket, stop: PanelRequest) {
        self.stopping.insert(ticket, stop);
    }

    /// The request with `ticket` is over; what it was to stop, if it was such a one.
    pub(super) fn stop_over(&mut self, ticket: Ticket) -> Option<PanelRequest> {
        self.stopping.remove(&ticket)
    }

    /// Jogs that are held, and stops that the board has not taken.
    pub(super) fn count(&self) -> usize {
        self.held.len() + self.stopping.len()
    }

    /// Whether another stop may be requested now.
    pub(super) fn may_stop(&self) -> bool {
        self.stopping.len() < STOPS_AT_ONCE
    }

    /// When the next one runs out, unless its stop has to wait for others to be over.
    pub(super) fn next_end(&self) -> Option<Instant> {
        self.held.values().map(|lease| lease.until).min().filter(|_| self.may_stop())
    }

    /// When the first lease of those clients runs out of whom `is_there` says yes.
    pub(super) fn first_end(&self, is_there: impl Fn(u64) -> bool) -> Option<Instant> {
        self.held.iter().filter(|(client, _)| is_there(**client)).map(|(_, lease)| lease.until).min()
    }

    /// Takes out one that has run out, or whose client `is_gone`: the client, and what to request.
    pub(super) fn ended(
        &mut self,
        now: Instant,
        is_gone: impl Fn(u64) -> bool,
    ) -> Option<(u64, PanelRequest)> {
        let client = self
            .held
            .iter()
            .find(|(client, lease)| lease.until <= now || is_gone(**client))
            .map(|(c, _)| *c)?;
        self.held.remove(&client).map(|lease| (client, lease.stop))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::function::panel::PanelAction;

    #[test]
    fn silence_and_absence_end_a_lease_and_renewal_does_not() {
        let now = Instant::now();
        let stop = |motor| PanelRequest::of(PanelAction::JogStop, &[motor]).unwrap();
        let mut leases = Leases::default();
        for (client, motor) in [(7, 1), (7, 3), (8, 2)] {
            leases.begin(client, stop(motor), now + LEASE);
        }
        assert!(leases.renew(7, now + LEASE / 2) && !leases.renew(9, now));
        assert_eq!(leases.next_end(), Some(now + LEASE));
        assert_eq!(leases.ended(now + LEASE, |_| false), Some((8, stop(2))));
        assert_eq!(leases.ended(now + LEASE, |_| false), None);
        let both = PanelRequest::of(PanelAction::JogStop, &[1, 3]).unwrap();
        assert_eq!(leases.ended(now + LEASE, |client| client == 7), Some((7, both)));
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
        let stop = PanelRequest::of(PanelAction::JogStop, &[1]).unwrap();
        let mut leases = Leases::default();
        leases.begin(7, stop, now);
        for ticket in 0..STOPS_AT_ONCE as u64 {
            assert!(leases.may_stop() && leases.next_end() == Some(now));
            leases.stopping(Ticket(ticket), stop);
        }
        assert!(!leases.may_stop() && leases.next_end().is_none(), "nothing to wake up for");
        assert_eq!(leases.stop_over(Ticket(0)), Some(stop));
        assert!(leases.may_stop() && leases.next_end() == Some(now));
    }
}
