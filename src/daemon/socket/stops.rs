//! Stops that the control panel did not take, as when I2 is not 3 any more: by command line, and by ^A if a held jog goes on.
//!
//! A motor stands when the servo report says so: its desired velocity is zero (bit 13
//! of the servo status), or its loop is open.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use super::call_table::Caller;
use super::stop_target::Target;
use crate::function::servo::Motion;

/// How long the board has to say what is addressed. One given up holds the port for longer than a slow board takes.
pub(super) const QUESTION_TAKES: Duration = Duration::from_millis(400);
/// How long the board has for the line, and for ^A.
pub(super) const LINE_TAKES: Duration = Duration::from_secs(1);
/// How long a motor must be seen to stand. A report may be from just before the motor began to move.
const SEEN: Duration = Duration::from_millis(50);
/// How long motors may go on where ^A is not sent: less than what a client waits before it warns its user.
const GIVE_UP: Duration = Duration::from_millis(800);
/// How long they are looked at where nothing that was sent can stop them: they may stand by themselves.
const NO_HOPE: Duration = Duration::from_millis(100);

/// How far a stop is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum At {
    /// The board was asked what is addressed.
    Question,
    /// The line was sent.
    Line,
    /// Nothing is under way: the motors are watched.
    Watch,
    /// ^A was sent.
    AbortAll,
}

/// A stop that the panel did not take.
#[derive(Debug)]
pub(super) struct Stop {
    pub target: Target,
    /// Who waits for it.
    pub caller: Option<Caller>,
    /// It ends a held jog, so the motors must stand in the end.
    pub ends_hold: bool,
    pub at: At,
    begun: Instant,
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
pub(super) enum Seen {
    /// Not known yet.
    Open,
    /// They stand, or the board took the line and nothing says otherwise.
    Stand,
    /// They may move, and their time is over.
    Move,
}

impl Stop {
    /// How long its motors may go on.
    fn patience(&self, stop_all_after: Option<Duration>) -> Duration {
        match (self.ends_hold, self.hopeless) {
            (true, _) => stop_all_after.unwrap_or(GIVE_UP),
            (false, true) => NO_HOPE,
            (false, false) => GIVE_UP,
        }
    }

    /// What is to be thought of the motors by now. Their time is `stop_all_after`.
    fn look(&mut self, motion: Motion, stop_all_after: Option<Duration>, now: Instant) -> Seen {
        let motors = self.target.motors();
        let since =
            if motors & !motion.standing == 0 { Some(self.stands_since.unwrap_or(now)) } else { None };
        self.stands_since = since;
        if since.is_some_and(|since| now >= since + SEEN) {
            return Seen::Stand;
        }
        // No report tells of these motors: the board's word is all there is.
        if self.taken && motors & (motion.moving | motion.standing) == 0 {
            return Seen::Stand;
        }
        if now < self.begun + self.patience(stop_all_after) || since.is_some() {
            return Seen::Open;
        }
        if self.taken && motors & motion.moving == 0 { Seen::Stand } else { Seen::Move }
    }
}

/// Every stop under way that the panel did not take.
#[derive(Debug)]
pub(super) struct Stops {
    running: BTreeMap<u64, Stop>,
    next: u64,
    /// After how long ^A stops everything when a motor whose held jog is over goes on. Never, if `None`.
    pub stop_all_after: Option<Duration>,
}

impl Stops {
    /// None; ^A comes `stop_all_after` the panel did not take a stop.
    pub(super) const fn new(stop_all_after: Option<Duration>) -> Self {
        Self { running: BTreeMap::new(), next: 0, stop_all_after }
    }

    /// Begins one, with the question what is addressed. Its number.
    pub(super) fn begin(
        &mut self,
        target: Target,
        caller: Option<Caller>,
        ends_hold: bool,
        now: Instant,
    ) -> u64 {
        self.next += 1;
        let stop = Stop {
            target,
            caller,
            ends_hold,
            at: At::Question,
            begun: now,
            taken: false,
            is_doubtful: false,
            error: None,
            hopeless: false,
            stands_since: None,
        };
        self.running.insert(self.next, stop);
        self.next
    }

    /// The stop of that number.
    pub(super) fn get_mut(&mut self, number: u64) -> Option<&mut Stop> {
        self.running.get_mut(&number)
    }

    /// It is over.
    pub(super) fn over(&mut self, number: u64) -> Option<Stop> {
        self.running.remove(&number)
    }

    /// Another command has been carried out by `motors`: those that the board has been told to stop before, and for which nobody
    /// waits, are watched no more. The stops of which nothing is left.
    pub(super) fn let_go(&mut self, motors: u32) -> Vec<u64> {
        let is_done = |stop: &Stop| {
            let is_sure = stop.taken && !stop.is_doubtful;
            stop.at == At::Watch && is_sure && stop.caller.is_none()
        };
        let mut done = Vec::new();
        for (number, stop) in self.running.iter_mut().filter(|(_, stop)| is_done(stop)) {
            if let Target::Motors(watched) = &mut stop.target {
                *watched &= !motors;
                done.extend((*watched == 0).then_some(*number));
            }
        }
        done
    }

    /// Of the stops whose motors are watched, those of which it is known by now, each with whether the motors stand.
    pub(super) fn seen(&mut self, motion: Motion, now: Instant) -> Vec<(u64, Seen)> {
        let after = self.stop_all_after;
        let watched = self.running.iter_mut().filter(|(_, stop)| stop.at == At::Watch);
        let seen = watched.map(|(number, stop)| (*number, stop.look(motion, after, now)));
        seen.filter(|(_, seen)| *seen != Seen::Open).collect()
    }

    /// When to look again, if nothing is told before.
    pub(super) fn next_moment(&self) -> Option<Instant> {
        let watched = self.running.values().filter(|stop| stop.at == At::Watch);
        let moment = |stop: &Stop| match stop.stands_since {
            Some(since) => since + SEEN,
            None => stop.begun + stop.patience(self.stop_all_after),
        };
        watched.map(moment).min()
    }

    /// The motors that are to be stopped; bit 0 is motor 1.
    pub(super) fn motors(&self) -> u32 {
        self.running.values().fold(0, |all, stop| all | stop.target.motors())
    }

    /// How many.
    pub(super) fn count(&self) -> usize {
        self.running.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn d7_a_motor_that_has_another_command_is_not_watched_any_more_once_its_stop_is_taken() {
        let now = Instant::now();
        let mut stops = Stops::new(Some(Duration::from_secs(1)));
        let number = stops.begin(Target::Motors(0b11), None, true, now);
        assert!(stops.let_go(0b11).is_empty(), "its stop has not been taken");
        let stop = stops.get_mut(number).unwrap();
        (stop.at, stop.taken) = (At::Watch, true);
        assert!(stops.let_go(0b01).is_empty() && stops.motors() == 0b10);
        assert_eq!(stops.let_go(0b10), [number]);
    }

    #[test]
    fn b2_6_a_motor_that_goes_on_is_seen_and_one_that_stands_too() {
        let now = Instant::now();
        let after = Duration::from_secs(1);
        let (moving, standing) = (Motion { moving: 1, standing: 0 }, Motion { moving: 0, standing: 1 });
        let look = |taken, motions: &[(u64, Motion)]| {
            let mut stops = Stops::new(Some(after));
            let number = stops.begin(Target::Motors(1), None, true, now);
            let stop = stops.get_mut(number).unwrap();
            (stop.at, stop.taken) = (At::Watch, taken);
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
}
