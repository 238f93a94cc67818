//! The stops under way: by the panel, by command line if the panel did not take the stop, and by ^A if the motors of a
//! held jog go on all the same.
//!
//! A motor stands when the servo report says so: its desired velocity is zero (bit 13 of the servo status), or its loop
//! is open.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use super::target::Target;
use super::timing::{STOP_GIVEN_UP, STOP_HOPELESS, STOP_SEEN};
use crate::daemon::shared::caller::Caller;
use crate::daemon::shared::queue::{Ticket, at_once};
use crate::function::servo::Motion;
use crate::map::Motors;

/// A stop's step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum At {
    /// The daemon has to ask the panel for the stop from this moment on.
    Due(Instant),
    /// The daemon has asked the panel for the stop.
    Panel(Ticket),
    /// The stop's caller has asked the panel for it.
    CallersPanel,
    /// The daemon has asked the board which motor or coordinate system it addresses.
    Question,
    /// The daemon has sent the line.
    Line,
    /// The daemon sends nothing and watches the motors.
    Watch,
    /// The daemon has sent ^A.
    AbortAll,
}

/// A stop under way.
#[derive(Debug)]
pub struct Stop {
    /// The motors or coordinate systems to stop.
    pub target: Target,
    /// The caller that waits for the stop.
    pub caller: Option<Caller>,
    /// The stop ends a held jog, so the motors must stand in the end.
    pub ends_hold: bool,
    /// The stop's step.
    pub at: At,
    /// When the motors should have stopped moving; the stop's time runs from here.
    pub begun: Instant,
    /// The board has acknowledged the line.
    pub taken: bool,
    /// The line leaves out a motor whose loop only a report calls open, not an answer of the board. The report may be
    /// old.
    pub is_doubtful: bool,
    /// The board has refused the line with this error.
    pub error: Option<u16>,
    /// No message sent so far can stop the target.
    pub hopeless: bool,
    stands_since: Option<Instant>,
}

/// The verdict on the watched motors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Seen {
    /// Undecided.
    Open,
    /// The motors stand, or the board took the line and no report contradicts.
    Stand,
    /// The motors may move, and their time is over.
    Move,
}

impl Stop {
    /// A stop of `target`, for which `caller` waits, and which begins at step `at`.
    pub const fn new(target: Target, caller: Option<Caller>, ends_hold: bool, at: At, now: Instant) -> Self {
        Self {
            target,
            caller,
            ends_hold,
            at,
            begun: now,
            taken: false,
            is_doubtful: false,
            error: None,
            hopeless: false,
            stands_since: None,
        }
    }

    /// How long the motors may go on.
    fn patience(&self, stop_all_after: Option<Duration>) -> Duration {
        match (self.ends_hold, self.hopeless) {
            (true, _) => stop_all_after.unwrap_or(STOP_GIVEN_UP),
            (false, true) => STOP_HOPELESS,
            (false, false) => STOP_GIVEN_UP,
        }
    }

    /// The verdict on the motors `now`. A held jog's motors have `stop_all_after` to stand.
    fn look(&mut self, motion: Motion, stop_all_after: Option<Duration>, now: Instant) -> Seen {
        let motors = self.target.motors();
        let since = motion.standing.has_all(motors).then(|| self.stands_since.unwrap_or(now));
        self.stands_since = since;
        if since.is_some_and(|since| now >= since + STOP_SEEN) {
            return Seen::Stand;
        }
        // No report tells about these motors: the board's acknowledgement has to do.
        if self.taken && !motors.meets(motion.moving.and(motion.standing)) {
            return Seen::Stand;
        }
        if now < self.begun + self.patience(stop_all_after) || since.is_some() {
            return Seen::Open;
        }
        if self.taken && !motors.meets(motion.moving) { Seen::Stand } else { Seen::Move }
    }
}

/// Every stop under way.
#[derive(Debug)]
pub struct Stops {
    running: BTreeMap<u64, Stop>,
    next: u64,
    /// How long a motor may go on after its held jog is over before the daemon sends ^A, which stops everything.
    /// `None`: never.
    pub stop_all_after: Option<Duration>,
}

impl Stops {
    /// No stops. The daemon sends ^A `stop_all_after` a stop that the panel did not take.
    pub const fn new(stop_all_after: Option<Duration>) -> Self {
        Self { running: BTreeMap::new(), next: 0, stop_all_after }
    }

    /// Begins a stop, and returns its number.
    pub fn begin(&mut self, stop: Stop) -> u64 {
        self.next += 1;
        self.running.insert(self.next, stop);
        self.next
    }

    /// Begins a stop by the panel, due `at`, of `motors` that no client holds any more.
    pub fn begin_due(&mut self, motors: Motors, at: Instant) -> u64 {
        self.begin(Stop::new(Target::Motors(motors), None, true, At::Due(at), at))
    }

    /// Merges the stops that are due now into one stop for the panel, and returns its number. `None` while the bus
    /// thread has no room for more of the daemon's requests; stops that fall due meanwhile become one further request.
    pub fn due(&mut self, now: Instant) -> Option<(u64, Motors)> {
        if !self.panel_has_room() {
            return None;
        }
        let all = self.running.iter();
        let due = all.filter(|(_, stop)| matches!(stop.at, At::Due(at) if at <= now));
        let due: Vec<u64> = due.map(|(number, _)| *number).collect();
        let motors = due.iter().filter_map(|number| self.running.remove(number));
        let motors = motors.fold(Motors::NONE, |all, stop| all.and(stop.target.motors()));
        (!motors.is_empty()).then(|| (self.begin_due(motors, now), motors))
    }

    fn panel_has_room(&self) -> bool {
        let at_panel = self.running.values().filter(|stop| matches!(stop.at, At::Panel(_)));
        at_panel.count() < at_once::STOPS
    }

    /// The motors whose stop is due, now or later: the daemon has not seen the board take that stop.
    pub fn due_motors(&self) -> Motors {
        let due = self.running.values().filter(|stop| matches!(stop.at, At::Due(_)));
        due.fold(Motors::NONE, |all, stop| all.and(stop.target.motors()))
    }

    /// The number of the stop that the daemon has asked of the panel with `ticket`.
    pub fn at_panel(&self, ticket: Ticket) -> Option<u64> {
        let mut all = self.running.iter();
        all.find(|(_, stop)| stop.at == At::Panel(ticket)).map(|(number, _)| *number)
    }

    /// The stop of that number.
    pub fn get_mut(&mut self, number: u64) -> Option<&mut Stop> {
        self.running.get_mut(&number)
    }

    /// Removes a stop that is over.
    pub fn over(&mut self, number: u64) -> Option<Stop> {
        self.running.remove(&number)
    }

    /// `motors` have carried out another command: the daemon no longer watches them if the board took their stop before
    /// and no caller waits for it. Returns the stops that have no motor left.
    pub fn let_go(&mut self, motors: Motors) -> Vec<u64> {
        let is_done = |stop: &Stop| {
            let is_sure = stop.taken && !stop.is_doubtful;
            stop.at == At::Watch && is_sure && stop.caller.is_none()
        };
        let mut done = Vec::new();
        for (number, stop) in self.running.iter_mut().filter(|(_, stop)| is_done(stop)) {
            if let Target::Motors(watched) = &mut stop.target {
                watched.remove(motors);
                done.extend(watched.is_empty().then_some(*number));
            }
        }
        done
    }

    /// The watched stops whose outcome is decided by now, each with its verdict.
    pub fn seen(&mut self, motion: Motion, now: Instant) -> Vec<(u64, Seen)> {
        let after = self.stop_all_after;
        let watched = self.running.iter_mut().filter(|(_, stop)| stop.at == At::Watch);
        let seen = watched.map(|(number, stop)| (*number, stop.look(motion, after, now)));
        seen.filter(|(_, seen)| *seen != Seen::Open).collect()
    }

    /// When the stops need attention next, if no news comes before.
    pub fn next_moment(&self) -> Option<Instant> {
        let has_room = self.panel_has_room();
        let moment = |stop: &Stop| match (stop.at, stop.stands_since) {
            (At::Due(at), _) => has_room.then_some(at),
            (At::Watch, Some(since)) => Some(since + STOP_SEEN),
            (At::Watch, None) => Some(stop.begun + stop.patience(self.stop_all_after)),
            _ => None,
        };
        self.running.values().filter_map(moment).min()
    }

    /// The motors that the daemon has to stop itself.
    pub fn motors(&self) -> Motors {
        let own = self.running.values().filter(|stop| stop.at != At::CallersPanel);
        own.fold(Motors::NONE, |all, stop| all.and(stop.target.motors()))
    }

    /// How many stops are under way.
    pub fn count(&self) -> usize {
        self.running.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_motor_that_has_another_command_is_not_watched_any_more_once_its_stop_is_taken() {
        let now = Instant::now();
        let mut stops = Stops::new(Some(Duration::from_secs(1)));
        let number = stops.begin(Stop::new(Target::Motors(Motors::first(2)), None, true, At::Question, now));
        assert!(stops.let_go(Motors::first(2)).is_empty(), "its stop has not been taken");
        let stop = stops.get_mut(number).unwrap();
        (stop.at, stop.taken) = (At::Watch, true);
        assert!(stops.let_go(Motors::of(1)).is_empty() && stops.motors() == Motors::of(2));
        assert_eq!(stops.let_go(Motors::of(2)), [number]);
    }

    #[test]
    fn a_motor_that_goes_on_is_seen_and_one_that_stands_too() {
        let now = Instant::now();
        let after = Duration::from_secs(1);
        let (moving, standing) = (
            Motion { moving: Motors::of(1), standing: Motors::NONE },
            Motion { moving: Motors::NONE, standing: Motors::of(1) },
        );
        let look = |taken, motions: &[(u64, Motion)]| {
            let mut stops = Stops::new(Some(after));
            let number = stops.begin(Stop::new(Target::Motors(Motors::of(1)), None, true, At::Watch, now));
            let stop = stops.get_mut(number).unwrap();
            stop.taken = taken;
            let seen =
                motions.iter().map(|(ms, motion)| stops.seen(*motion, now + Duration::from_millis(*ms)));
            seen.flatten().map(|(_, seen)| seen).next()
        };
        assert_eq!(look(true, &[(0, moving), (999, moving)]), None);
        assert_eq!(look(true, &[(0, moving), (1000, moving)]), Some(Seen::Move));
        assert_eq!(look(false, &[(0, standing), (49, standing)]), None, "it may just begin");
        assert_eq!(look(false, &[(0, standing), (50, standing)]), Some(Seen::Stand));
        assert_eq!(look(false, &[(0, standing), (49, moving), (60, standing)]), None);
        let unknown = Motion::default();
        assert_eq!(look(true, &[(0, unknown)]), Some(Seen::Stand));
        assert_eq!(look(false, &[(999, unknown)]), None);
        assert_eq!(look(false, &[(1000, unknown)]), Some(Seen::Move), "nobody knows that it stands");
    }

    #[test]
    fn what_is_due_while_the_panel_has_many_stops_waits_and_becomes_one_more() {
        let now = Instant::now();
        let mut stops = Stops::new(None);
        let ask = |stops: &mut Stops, ticket| {
            let (number, motors) = stops.due(now)?;
            stops.get_mut(number).unwrap().at = At::Panel(Ticket(ticket));
            Some(motors)
        };
        for ticket in 0..at_once::STOPS as u64 {
            stops.begin_due(Motors::of(1), now);
            assert_eq!(stops.next_moment(), Some(now));
            assert_eq!(ask(&mut stops, ticket), Some(Motors::of(1)));
        }
        stops.begin_due(Motors::of(1), now);
        stops.begin_due(Motors::of(2), now);
        stops.begin_due(Motors::of(3), now + Duration::from_secs(1));
        assert_eq!((stops.next_moment(), ask(&mut stops, 99)), (None, None), "nothing to wake up for");
        assert_eq!(stops.due_motors(), Motors::first(3));
        let first = stops.at_panel(Ticket(0)).unwrap();
        stops.over(first);
        assert_eq!(stops.next_moment(), Some(now));
        assert_eq!(ask(&mut stops, 99), Some(Motors::first(2)));
        assert_eq!((stops.due_motors(), stops.motors()), (Motors::of(3), Motors::first(3)));
        assert_eq!((ask(&mut stops, 100), stops.count()), (None, at_once::STOPS + 1));
    }
}
