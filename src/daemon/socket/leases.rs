//! Leases on jogs: a motor jogs only while the client that holds it says so.
//!
//! `PanelHold` starts a jog; the same connection has to renew it within [`LEASE`], again and again. When it does not,
//! or is gone, the stop is requested. A kill or an abort of all motors ends every lease without a stop: the motors stand, and
//! a stop would close the loop of a killed one again.

use std::collections::HashMap;
use std::fmt;
use std::time::{Duration, Instant};

use log::{error, info, warn};

use super::stop_target::Target;
use crate::daemon::shared::open_buffer::Account;
use crate::daemon::shared::queue::{Outcome, Ticket, at_once};
use crate::function::servo::Motion;
use crate::protocol::control;

/// How long a client may be silent.
pub(super) const LEASE: Duration = Duration::from_millis(200);
/// Holds the stops that the board did not take, until they are requested again.
const NOBODY: u64 = u64::MAX;
/// How long the holder's own stop may take, by panel, command line and ^A.
const HOLDERS_STOP: Duration = Duration::from_secs(3);
/// How long until a stop is requested again.
const STOP_AGAIN: Duration = Duration::from_secs(1);
/// How long a motor must be seen to stand until its jog is over: one that turns round stands for a moment.
pub(super) const STANDS: Duration = Duration::from_millis(100);
/// Stops that the bus thread has at a time. What ends meanwhile waits and becomes one more.
const STOPS_AT_ONCE: usize = at_once::STOPS;

/// Why a held jog is over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LeaseEnd {
    /// Its holder was silent for too long, or is gone.
    Silent,
    /// This control character, which stops every motor.
    Control(u8),
    /// The loops of these motors have opened; bit 0 is motor 1.
    OpenLoop(u32),
    /// Somebody else has stopped these motors through the daemon.
    Stopped(Account, u32),
    /// These motors do not move any more, whoever or whatever stopped them.
    Stands(u32),
    /// The board does not read the control panel any more: this client has switched it off, or it is not known who.
    PanelEnded(Option<Account>),
    /// The daemon ends.
    DaemonEnds,
}

impl fmt::Display for LeaseEnd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Silent => write!(f, "the held jog was not renewed in time; pmacd stops it"),
            Self::Control(character) => {
                let what = if *character == control::KILL { "kills" } else { "stops" };
                write!(
                    f,
                    "the held jog is over: somebody sent {}, which {what} every motor",
                    control::name(*character)
                )
            }
            Self::OpenLoop(motors) => {
                let target = Target::Motors(*motors);
                write!(f, "the held jog is over: the loop of {target} is open (killed, a fault, or a reset)")
            }
            Self::Stopped(by, motors) => {
                write!(f, "the held jog is over: {by} stopped {}", Target::Motors(*motors))
            }
            Self::PanelEnded(by) => {
                f.write_str("the held jog is over: ")?;
                match by {
                    Some(by) => write!(f, "{by} has switched the control panel off (I2)")?,
                    None => f.write_str(
                        "the control panel is off (I2 is not 3 any more), by the serial port, another host or a program of the board",
                    )?,
                }
                f.write_str("; pmacd stops it by command line")
            }
            Self::DaemonEnds => {
                f.write_str("the held jog is over: pmacd is stopping, and every held jog with it")
            }
            Self::Stands(motors) => {
                let target = Target::Motors(*motors);
                write!(
                    f,
                    "the held jog is over: {target} stands; somebody stopped it, or it is at a limit; pmacd stops every motor of \
                     the hold"
                )
            }
        }
    }
}

#[derive(Debug)]
struct Lease {
    /// The motors that jog: bit 0 is motor 1.
    motors: u32,
    until: Instant,
    /// Why it cannot be renewed any more, though its stop has not been requested.
    over: Option<LeaseEnd>,
    /// Whose it is.
    holder: Account,
    /// The motors that were seen to move since the jog was asked for.
    moved: u32,
    /// Since when some of them have stood without a break, and which.
    stands: Option<(Instant, u32)>,
}

impl Lease {
    /// When it ends if nothing happens.
    fn ends(&self) -> Instant {
        self.stands.map_or(self.until, |(since, _)| self.until.min(since + STANDS))
    }
}

/// Every lease there is, by client, and the stops that the board has not taken yet.
#[derive(Debug, Default)]
pub(super) struct Leases {
    held: HashMap<u64, Lease>,
    /// The leases that have ended, each with its motors, of clients that have not begun another one.
    ended: HashMap<u64, (LeaseEnd, u32)>,
    stopping: HashMap<Ticket, u32>,
}

/// How a stop that a client asks for is done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum StopFor {
    /// It ends a jog that the client holds, or held.
    Holder,
    /// As any other request.
    Anybody,
}

impl Leases {
    /// `client` holds a jog of the motors in the mask `motors`. One it held before is added to it.
    /// It runs until `begun` at first, when the board must have taken the jog, and after that from renewal to renewal.
    pub(super) fn begin(&mut self, client: u64, holder: Account, motors: u32, begun: Instant) {
        self.ended.remove(&client);
        let lease = self.held.entry(client).or_insert(Lease {
            motors: 0,
            until: begun,
            over: None,
            holder,
            moved: 0,
            stands: None,
        });
        lease.until = lease.until.max(begun);
        lease.motors |= motors;
        (lease.over, lease.moved, lease.stands) = (None, 0, None);
    }

    /// Who else than `client` holds one of the motors in `mask`, and which of them. `None` for a jog that nobody holds any more,
    /// whose stop the board has not taken yet.
    pub(super) fn held_by_another(&self, client: u64, mask: u32) -> Option<(Option<Account>, u32)> {
        let others = self.held.iter().filter(|(other, lease)| **other != client && lease.over.is_none());
        let holder = |client: u64, lease: &Lease| (client != NOBODY).then_some(lease.holder);
        others.map(|(other, lease)| (holder(*other, lease), lease.motors & mask)).find(|(_, held)| *held != 0)
    }

    /// `by` has had the motors in `mask` stopped, over the connection `client`. A jog of them that somebody else holds is over. It
    /// gets a stop of its own: it may have begun after the other one.
    pub(super) fn stopped_by_another(&mut self, client: u64, by: Account, mask: u32, now: Instant) {
        let others = self.held.iter_mut().filter(|(other, _)| **other != client && **other != NOBODY);
        for (_, lease) in others.filter(|(_, lease)| lease.over.is_none() && lease.motors & mask != 0) {
            (lease.over, lease.until) = (Some(LeaseEnd::Stopped(by, lease.motors & mask)), now);
        }
    }

    /// The motors move and stand so. One that was held and moved, and stands, is held no more.
    pub(super) fn see_motion(&mut self, motion: Motion, now: Instant) {
        let leases =
            self.held.iter_mut().filter(|(client, lease)| **client != NOBODY && lease.over.is_none());
        for (_, lease) in leases {
            lease.moved |= motion.moving & lease.motors;
            let standing = lease.moved & motion.standing & lease.motors;
            // One that begins to stand while another one does has its own time, after that one's.
            let (since, still) = lease.stands.map_or((now, 0), |(since, stood)| (since, stood & standing));
            lease.stands = match (still, standing) {
                (_, 0) => None,
                (0, standing) => Some((now, standing)),
                (still, _) => Some((since, still)),
            };
        }
    }

    /// The jogs end whose motors have stood for long enough at `now`: a motor that turns round stands for a moment.
    fn end_standing(&mut self, now: Instant) {
        for lease in self.held.values_mut().filter(|lease| lease.over.is_none()) {
            if let Some((_, standing)) = lease.stands.filter(|(since, _)| now >= *since + STANDS) {
                (lease.over, lease.until) = (Some(LeaseEnd::Stands(standing)), now);
            }
        }
    }

    /// `client` is still there.
    ///
    /// # Errors
    /// Why its lease is over; `None` when it had none.
    pub(super) fn renew(&mut self, client: u64, now: Instant) -> Result<(), Option<LeaseEnd>> {
        match self.held.get_mut(&client) {
            Some(Lease { over: Some(end), .. }) => Err(Some(*end)),
            Some(lease) => {
                lease.until = now + LEASE;
                Ok(())
            }
            None => Err(self.ended.get(&client).map(|(end, _)| *end)),
        }
    }

    /// `client` asks for the stop of the motors in `mask`.
    ///
    /// # Errors
    /// Why the motors stand already: they get no stop, which could close the loop of a killed one. Said once.
    pub(super) fn stop_for(&mut self, client: u64, mask: u32, now: Instant) -> Result<StopFor, LeaseEnd> {
        let found = match self.held.get(&client) {
            Some(Lease { motors, over, .. }) => Some((*over, *motors)),
            None => self.ended.remove(&client).map(|(end, motors)| (Some(end), motors)),
        };
        match found {
            Some((Some(end @ (LeaseEnd::Control(_) | LeaseEnd::OpenLoop(_))), motors))
                if mask & !motors == 0 =>
            {
                Err(end)
            }
            Some((_, motors)) if mask & !motors == 0 => {
                if let Some(lease) = self.held.get_mut(&client) {
                    // While the stop is under way its caller waits, and renews nothing.
                    lease.until = lease.until.max(now + HOLDERS_STOP);
                }
                Ok(StopFor::Holder)
            }
            _ => Ok(StopFor::Anybody),
        }
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

    /// `character`, which stops every motor, is on its way to the board. No lease is renewed any more, and no stop is requested
    /// unless the board has not taken it in the time of a lease.
    pub(super) fn control_begins(&mut self, character: u8, now: Instant) {
        let held = self.held.iter_mut().filter(|(client, lease)| **client != NOBODY && lease.over.is_none());
        for (_, lease) in held {
            (lease.over, lease.until) = (Some(LeaseEnd::Control(character)), now + LEASE);
        }
    }

    /// The board has taken a character that stops every motor: the leases that [`Self::control_begins`] marked are over.
    /// The clients that had one.
    pub(super) fn control_taken(&mut self) -> Vec<u64> {
        let stand = |lease: &Lease| matches!(lease.over, Some(LeaseEnd::Control(_)));
        let over: Vec<(u64, Lease)> = self.held.extract_if(|_, lease| stand(lease)).collect();
        let mut clients = Vec::new();
        for (client, Lease { motors, over, .. }) in over {
            let end = over.unwrap_or(LeaseEnd::Silent);
            info!(target: "audit", "{end} (mask {motors:#04x}); it gets no stop");
            self.ended.insert(client, (end, motors));
            clients.push(client);
        }
        clients
    }

    /// The loops of the motors in `opened` have opened. Leases on them end at `now`.
    pub(super) fn loops_opened(&mut self, opened: u32, now: Instant) {
        let leases = self.held.iter_mut().filter(|(client, _)| **client != NOBODY);
        for (_, lease) in leases.filter(|(_, lease)| lease.motors & opened != 0 && lease.over.is_none()) {
            (lease.over, lease.until) = (Some(LeaseEnd::OpenLoop(lease.motors & opened)), now);
        }
    }

    /// The board does not read the control panel any more, by which every jog is held and stopped.
    pub(super) fn panel_ended(&mut self, by: Option<Account>, now: Instant) {
        let held = self.held.iter_mut().filter(|(client, lease)| **client != NOBODY && lease.over.is_none());
        for (_, lease) in held {
            (lease.over, lease.until) = (Some(LeaseEnd::PanelEnded(by)), now);
        }
    }

    /// `client` is gone, and will not ask why its lease ended.
    pub(super) fn forget(&mut self, client: u64) {
        self.ended.remove(&client);
    }

    /// The request with `ticket` is over. The motors that it had to stop, if the board did not take it.
    pub(super) fn request_over(&mut self, ticket: Ticket, outcome: Outcome) -> Option<u32> {
        let motors = self.stopping.remove(&ticket).filter(|_| outcome != Outcome::Done)?;
        error!(target: "audit", "the board did not take the stop of a held jog (mask {motors:#04x})");
        Some(motors)
    }

    /// Nobody knows that `motors` stand: their stop is requested again in a while.
    pub(super) fn stop_again(&mut self, motors: u32, now: Instant) {
        self.begin(NOBODY, Account { uid: 0, pid: 0 }, motors, now + STOP_AGAIN);
    }

    /// `motors`, which jog for nobody any more, are stopped `now`, as those that were held.
    pub(super) fn stop_now(&mut self, motors: u32, now: Instant) {
        self.begin(NOBODY, Account { uid: 0, pid: 0 }, motors, now);
    }

    /// Has `send` request the stop of every jog whose holder is silent or not there (`is_there`), all in one request, and gives
    /// the clients whose jogs these were. `None` when `send` had no room for it; what is held stays held then.
    pub(super) fn end_lapsed(
        &mut self,
        now: Instant,
        is_there: impl Fn(u64) -> bool,
        send: impl FnOnce(u32) -> Option<Ticket>,
    ) -> Option<Vec<u64>> {
        self.end_standing(now);
        if !self.may_stop() {
            return Some(Vec::new());
        }
        // What a control character stops gets its time to stop, whether its holder waits for that or not.
        let may_be_gone = |lease: &Lease| !matches!(lease.over, Some(LeaseEnd::Control(_)));
        let has_lapsed = |client: u64, lease: &Lease| {
            lease.until <= now || client != NOBODY && may_be_gone(lease) && !is_there(client)
        };
        self.end(now, has_lapsed, send)
    }

    /// Whether somebody whose jog ended with the daemon has not heard so.
    pub(super) fn has_untold(&self) -> bool {
        self.ended.values().any(|(end, _)| *end == LeaseEnd::DaemonEnds)
    }

    /// The daemon ends: no jog is held any more.
    pub(super) fn daemon_ends(&mut self, now: Instant) {
        for lease in self.held.values_mut().filter(|lease| lease.over.is_none()) {
            (lease.over, lease.until) = (Some(LeaseEnd::DaemonEnds), now);
        }
    }

    /// The motors that are held, or whose stop the board has not taken; bit 0 is motor 1.
    pub(super) fn motors(&self) -> u32 {
        let held = self.held.values().map(|lease| lease.motors);
        held.chain(self.stopping.values().copied()).fold(0, |all, motors| all | motors)
    }

    /// As [`Self::end_lapsed`], of every jog that is held.
    pub(super) fn end_all(&mut self, now: Instant, send: impl FnOnce(u32) -> Option<Ticket>) {
        let _ = self.end(now, |_, _| true, send);
    }

    fn end(
        &mut self,
        now: Instant,
        ends: impl Fn(u64, &Lease) -> bool,
        send: impl FnOnce(u32) -> Option<Ticket>,
    ) -> Option<Vec<u64>> {
        let over: Vec<(u64, Lease)> = self.held.extract_if(|client, lease| ends(*client, lease)).collect();
        if over.is_empty() {
            return Some(Vec::new());
        }
        let all = over.iter().fold(0, |all, (_, lease)| all | lease.motors);
        let Some(ticket) = send(all) else {
            // The stop must not be forgotten.
            for (client, lease) in over {
                self.held.insert(client, Lease { until: now, ..lease });
            }
            return None;
        };
        self.stopping.insert(ticket, all);
        let mut clients = Vec::new();
        for (client, Lease { motors, over, .. }) in over {
            let end = over.unwrap_or(LeaseEnd::Silent);
            match end {
                LeaseEnd::Silent if client == NOBODY => {
                    warn!(target: "audit", "motors that jog for nobody any more are stopped (mask {motors:#04x})");
                }
                LeaseEnd::Silent => {
                    warn!(target: "audit", "a held jog is stopped (mask {motors:#04x}): its holder is gone or silent");
                }
                _ => warn!(target: "audit", "{end}; its motors (mask {motors:#04x}) are stopped"),
            }
            if client != NOBODY {
                self.ended.insert(client, (end, motors));
                clients.push(client);
            }
        }
        Some(clients)
    }

    /// Whether `client` holds a jog, or has not been told yet why that is over.
    pub(super) fn is_of(&self, client: u64) -> bool {
        self.held.contains_key(&client) || self.ended.contains_key(&client)
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
        self.held.values().map(Lease::ends).min().filter(|_| self.may_stop())
    }

    /// When the first lease of the clients that are there (`is_there`) runs out.
    pub(super) fn first_end(&self, is_there: impl Fn(u64) -> bool) -> Option<Instant> {
        let held = self.held.iter().filter(|(client, lease)| lease.over.is_none() && is_there(**client));
        held.map(|(_, lease)| lease.until).min()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOLDER: Account = Account { uid: 1000, pid: 5 };

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
            leases.begin(client, HOLDER, stop(motor), now + LEASE);
        }
        assert_eq!((leases.renew(7, now + LEASE / 2), leases.renew(9, now)), (Ok(()), Err(None)));
        assert_eq!(leases.next_end(), Some(now + LEASE));
        assert_eq!(ended(&mut leases, now + LEASE, |_| true), Some(stop(2)));
        assert_eq!(ended(&mut leases, now + LEASE, |_| true), None);
        let both = 0b101;
        let is_there = |client| client != 7;
        assert!(leases.end_lapsed(now + LEASE, is_there, |_| None).is_none(), "no room for the request");
        assert_eq!(ended(&mut leases, now + LEASE, is_there), Some(both));
        assert_eq!(leases.next_end(), None);
        leases.begin(7, HOLDER, both, now + LEASE);
        leases.stopped(7, 0b001);
        assert_eq!(leases.renew(7, now), Ok(()), "motor 3 is still held");
        leases.stopped(7, 0b100);
        assert_eq!(leases.renew(7, now), Err(None));
    }

    #[test]
    fn what_ends_while_many_stops_are_under_way_waits_for_one_to_be_over() {
        let now = Instant::now();
        let stop = 0b1;
        let mut leases = Leases::default();
        for ticket in 0..STOPS_AT_ONCE as u64 {
            leases.begin(7, HOLDER, stop, now);
            assert!(leases.may_stop() && leases.next_end() == Some(now));
            assert!(leases.end_lapsed(now, |_| true, |_| Some(Ticket(ticket))).is_some());
        }
        leases.begin(7, HOLDER, stop, now);
        assert!(!leases.may_stop() && leases.next_end().is_none(), "nothing to wake up for");
        assert_eq!(ended(&mut leases, now, |_| true), None);
        assert_eq!(leases.request_over(Ticket(0), Outcome::Done), None);
        assert!(leases.may_stop() && leases.next_end() == Some(now));
        assert_eq!(ended(&mut leases, now, |_| true), Some(stop));
        assert_eq!(leases.request_over(Ticket(1), Outcome::TimedOut), Some(stop));
        leases.stop_again(stop, now);
        assert_eq!(leases.next_end(), Some(now + STOP_AGAIN), "it comes again");
        assert_eq!(leases.held_by_another(7, stop), Some((None, stop)), "nobody holds it");
        leases.end_all(now, |_| Some(Ticket(99)));
        assert!(leases.next_end().is_none());
    }

    #[test]
    fn a_kill_ends_leases_without_a_stop_unless_the_board_does_not_take_it() {
        let now = Instant::now();
        let end = LeaseEnd::Control(control::KILL);
        for taken in [true, false] {
            let mut leases = Leases::default();
            leases.begin(7, HOLDER, 0b1, now + LEASE);
            leases.control_begins(control::KILL, now);
            assert_eq!(leases.renew(7, now), Err(Some(end)));
            assert_eq!(leases.control_taken().len(), 1);
            assert_eq!(leases.count(), 0);
            leases.begin(8, HOLDER, 0b10, now);
            leases.control_begins(control::KILL, now);
            if taken {
                assert_eq!(leases.control_taken(), [8]);
                assert_eq!(ended(&mut leases, now + LEASE, |_| false), None);
            } else {
                assert_eq!(ended(&mut leases, now + LEASE / 2, |_| true), None);
                assert_eq!(ended(&mut leases, now + LEASE, |_| true), Some(0b10));
            }
            assert_eq!(leases.renew(8, now), Err(Some(end)));
            assert_eq!(leases.stop_for(8, 0b10, now), Err(end), "its stop would close the loop");
            assert_eq!(leases.stop_for(8, 0b10, now), Ok(StopFor::Anybody), "it has been told");
        }
    }

    #[test]
    fn an_opened_loop_ends_the_lease_on_its_motor() {
        let now = Instant::now();
        let mut leases = Leases::default();
        leases.begin(7, HOLDER, 0b11, now + LEASE);
        leases.begin(8, HOLDER, 0b100, now + LEASE);
        assert_eq!(leases.stop_for(8, 0b100, now), Ok(StopFor::Holder));
        assert_eq!(leases.stop_for(8, 0b101, now), Ok(StopFor::Anybody), "it holds only one of them");
        leases.loops_opened(0b10, now);
        assert_eq!(leases.renew(8, now), Ok(()));
        assert_eq!(ended(&mut leases, now, |_| true), Some(0b11), "the other motor may be moving");
        let end = LeaseEnd::OpenLoop(0b10);
        assert_eq!(leases.renew(7, now), Err(Some(end)));
        assert!(end.to_string().contains("the loop of motor 2 is open"), "{end}");
        leases.forget(7);
        assert_eq!(leases.renew(7, now), Err(None));
    }

    #[test]
    fn b2_6_another_ones_stop_ends_a_hold_and_the_holder_is_told() {
        let now = Instant::now();
        let mut leases = Leases::default();
        leases.begin(7, HOLDER, 0b11, now + LEASE);
        leases.begin(8, HOLDER, 0b100, now + LEASE);
        assert_eq!(leases.held_by_another(9, 0b10), Some((Some(HOLDER), 0b10)));
        assert_eq!((leases.held_by_another(7, 0b11), leases.held_by_another(9, 0b1000)), (None, None));
        let by = Account { uid: 1001, pid: 6 };
        leases.stopped_by_another(7, by, 0b1, now);
        assert_eq!(leases.renew(7, now), Ok(()), "the holder's own stop");
        leases.stopped_by_another(9, by, 0b1, now);
        let end = LeaseEnd::Stopped(by, 0b1);
        assert_eq!((leases.renew(7, now), leases.renew(8, now)), (Err(Some(end)), Ok(())));
        assert!(end.to_string().ends_with("uid 1001 (pid 6) stopped motor 1"), "{end}");
        assert_eq!(ended(&mut leases, now, |_| true), Some(0b11), "the other motor may be moving");
        assert_eq!(leases.renew(7, now), Err(Some(end)));
    }

    #[test]
    fn b2_6_a_held_motor_that_stands_is_held_no_more() {
        let now = Instant::now();
        let at = |ms| now + Duration::from_millis(ms);
        let (moving, standing) = (Motion { moving: 1, standing: 0 }, Motion { moving: 0, standing: 1 });
        let mut leases = Leases::default();
        leases.begin(7, HOLDER, 1, at(10_000));
        leases.see_motion(standing, at(0));
        assert_eq!(ended(&mut leases, at(500), |_| true), None, "it has not begun to move");
        leases.see_motion(moving, at(600));
        leases.see_motion(standing, at(700));
        leases.see_motion(moving, at(750));
        assert_eq!(ended(&mut leases, at(900), |_| true), None, "it turned round");
        leases.see_motion(standing, at(1000));
        assert_eq!(leases.next_end(), Some(at(1100)));
        assert_eq!(ended(&mut leases, at(1099), |_| true), None);
        assert_eq!(ended(&mut leases, at(1100), |_| true), Some(1));
        let told = leases.renew(7, at(1100)).unwrap_err().unwrap().to_string();
        assert!(told.contains("motor 1 stands") && told.contains("every motor of the hold"), "{told}");
    }

    #[test]
    fn b2_6_two_held_motors_that_turn_round_one_after_the_other_are_held() {
        let now = Instant::now();
        let at = |ms| now + Duration::from_millis(ms);
        let standing = |standing: u32| Motion { moving: 0b11 & !standing, standing };
        let mut leases = Leases::default();
        leases.begin(7, HOLDER, 0b11, at(10_000));
        for (ms, motors) in [(0, 0), (10, 0b01), (80, 0b11), (90, 0b10)] {
            leases.see_motion(standing(motors), at(ms));
        }
        assert_eq!(ended(&mut leases, at(150), |_| true), None, "neither has stood for long enough");
        leases.see_motion(standing(0b11), at(160));
        assert_eq!(ended(&mut leases, at(190), |_| true), Some(0b11), "both are stopped");
        assert_eq!(leases.renew(7, at(190)), Err(Some(LeaseEnd::Stands(0b10))));
    }
}
