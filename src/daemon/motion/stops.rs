//! The stops under way: by the panel, by command line where the panel did not take it, and by ^A if a held jog goes on all the same.
//!
//! A motor stands when the servo report says so: its desired velocity is zero (bit 13 of the servo status), or its loop is open.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use super::target::Target;
use super::timing::{STOP_GIVEN_UP, STOP_HOPELESS, STOP_SEEN};
use crate::daemon::shared::caller::Caller;
use crate::daemon::shared::queue::{Ticket, at_once};
use crate::function::servo::Motion;
use crate::map::Motors;

/// How far a stop is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum At {
    /// The panel is to be asked for it from this moment on.
    Due(Instant),
    /// The daemon has asked the panel for it.
    Panel(Ticket),
    /// Its caller has asked the panel for it.
    CallersPanel,
    /// The board was asked what is addressed.
    Question,
    /// The line was sent.
    Line,
    /// Nothing is under way: the motors are watched.
    Watch,
    /// ^A was sent.
    AbortAll,
}

/// A stop under way.
#[derive(Debug)]
pub struct Stop {
    /// What it stops.
    pub target: Target,
    /// Who waits for it.
    pub caller: Option<Caller>,
    /// It ends a held jog, so the motors must stand in the end.
    pub ends_hold: bool,
    /// How far it is.
    pub at: At,
    /// Since when the motors may no longer move.
    pub begun: Instant,
    /// The board has acknowledged the line.
    pub taken: bool,
    /// A motor was left out that no answer of the board calls open, only a report that may be old.
    pub is_doubtful: bool,
    /// The board has refused the line with this error.
    pub error: Option<u16>,
    /// Nothing that was sent can stop it.
    pub hopeless: bool,
    stands_since: Option<Instant>,
}

/// What the motors that are watched come to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Seen {
    /// Not known yet.
    Open,
    /// They stand, or the board took the line and nothing says otherwise.
    Stand,
    /// They may move, and their time is over.
    Move,
}

impl Stop {
    /// Of `target`, for which `caller` waits, and which begins so.
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

    /// How long its motors may go on.
    fn patience(&self, stop_all_after: Option<Duration>) -> Duration {
        match (self.ends_hold, self.hopeless) {
            (true, _) => stop_all_after.unwrap_or(STOP_GIVEN_UP),
            (false, true) => STOP_HOPELESS,
            (false, false) => STOP_GIVEN_UP,
        }
    }

    /// What is to be thought of the motors by now. Their time is `stop_all_after`.
    fn look(&mut self, motion: Motion, stop_all_after: Option<Duration>, now: Instant) -> Seen {
        let motors = self.target.motors();
        let since = motion.standing.has_all(motors).then(|| self.stands_since.unwrap_or(now));
        self.stands_since = since;
        if since.is_some_and(|since| now >= since + STOP_SEEN) {
            return Seen::Stand;
        }
        // No report tells of these motors: the board's word is all there is.
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
    /// After how long ^A stops everything when a motor whose held jog is over goes on. Never, if `None`.
    pub stop_all_after: Option<Duration>,
}

impl Stops {
    /// None; ^A comes `stop_all_after` the panel did not take a stop.
    pub const fn new(stop_all_after: Option<Duration>) -> Self {
        Self { running: BTreeMap::new(), next: 0, stop_all_after }
    }

    /// Begins one. Its number.
    pub fn begin(&mut self, stop: Stop) -> u64 {
        self.next += 1;
        self.running.insert(self.next, stop);
        self.next
    }

    /// The panel is to stop `motors`, which nobody holds any more, from this moment on.
    pub fn begin_due(&mut self, motors: Motors, at: Instant) -> u64 {
        self.begin(Stop::new(Target::Motors(motors), None, true, At::Due(at), at))
    }

    /// What the panel is to be asked for now, as one stop with its number. Nothing while the bus thread has as many of the daemon's
    /// requests as it has room for; what is due meanwhile becomes one more.
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

    /// The motors whose stop is due now, or will be: nobody has seen that the board took it.
    pub fn due_motors(&self) -> Motors {
        let due = self.running.values().filter(|stop| matches!(stop.at, At::Due(_)));
        due.fold(Motors::NONE, |all, stop| all.and(stop.target.motors()))
    }

    /// The number of the stop that the panel was asked for with `ticket`.
    pub fn at_panel(&self, ticket: Ticket) -> Option<u64> {
        let mut all = self.running.iter();
        all.find(|(_, stop)| stop.at == At::Panel(ticket)).map(|(number, _)| *number)
    }

    /// The stop of that number.
    pub fn get_mut(&mut self, number: u64) -> Option<&mut Stop> {
        self.running.get_mut(&number)
    }

    /// It is over.
    pub fn over(&mut self, number: u64) -> Option<Stop> {
        self.running.remove(&number)
    }

    /// Another command has been carried out by `motors`: those that the board has been told to stop before, and for which nobody
    /// waits, are watched no more. The stops of which nothing is left.
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

    /// Of the stops whose motors are watched, those whose outcome is decided by now, each with whether the motors stand.
    pub fn seen(&mut self, motion: Motion, now: Instant) -> Vec<(u64, Seen)> {
        let after = self.stop_all_after;
        let watched = self.running.iter_mut().filter(|(_, stop)| stop.at == At::Watch);
        let seen = watched.map(|(number, stop)| (*number, stop.look(motion, after, now)));
        seen.filter(|(_, seen)| *seen != Seen::Open).collect()
    }

    /// When something is to be done, if nothing is told before.
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

    /// The motors that the daemon is to stop.
    pub fn motors(&self) -> Motors {
        let own = self.running.values().filter(|stop| stop.at != At::CallersPanel);
        own.fold(Motors::NONE, |all, stop| all.and(stop.target.motors()))
    }

    /// How many.
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
