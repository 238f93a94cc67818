//! Jogs without an end that command lines have begun, and that end with the connection these came by.
//!
//! Nobody else is kept from such a motor: whoever sends it another command has it from then on. A motor that stands is nobody's.
//! Where its client has said how long he may be silent, his silence ends a jog as his end does: who hangs stops nothing either.

use std::collections::HashMap;
use std::time::{Duration, Instant};

use super::leases::STANDS;
use super::stop_target::numbers;
use crate::function::servo::Motion;

#[derive(Debug)]
struct Jog {
    /// How long its client may be silent, if that ends it.
    silence: Option<Duration>,
    /// When its client was heard last.
    heard: Instant,
    has_moved: bool,
    stands_since: Option<Instant>,
}

impl Jog {
    fn is_over(&self, now: Instant) -> bool {
        self.stands_since.is_some_and(|since| now >= since + STANDS)
    }

    /// When its client has been silent for too long.
    fn lapses(&self) -> Option<Instant> {
        self.silence.map(|silence| self.heard + silence)
    }
}

/// Each motor that jogs so, and its client; several where it is not known whose jog the motor obeys.
#[derive(Debug, Default)]
pub(super) struct LineJogs(HashMap<(u32, u64), Jog>);

impl LineJogs {
    /// The motors in the mask `motors` jog for `client`, who may be silent for so long; bit 0 is motor 1.
    pub(super) fn begin(&mut self, client: u64, motors: u32, silence: Option<Duration>, now: Instant) {
        self.over(motors);
        self.may_begin(client, motors, silence, now);
    }

    /// As [`Self::begin`], where the board may not have carried it out: the jogs of others are not over.
    pub(super) fn may_begin(&mut self, client: u64, motors: u32, silence: Option<Duration>, now: Instant) {
        for motor in numbers(motors) {
            self.0.insert((motor, client), Jog { silence, heard: now, has_moved: false, stands_since: None });
        }
    }

    /// The clients that `is_heard` names are still there.
    pub(super) fn hear(&mut self, is_heard: impl Fn(u64) -> bool, now: Instant) {
        let heard = self.0.iter_mut().filter(|((_, client), _)| is_heard(*client));
        heard.for_each(|(_, jog)| jog.heard = now);
    }

    /// Whether a motor may still jog for `client`.
    pub(super) fn go_on(&self, client: u64, now: Instant) -> bool {
        self.0.iter().any(|((_, of), jog)| *of == client && !jog.is_over(now))
    }

    /// Whether a jog ends with `client`.
    pub(super) fn is_of(&self, client: u64) -> bool {
        self.0.keys().any(|(_, of)| *of == client)
    }

    /// When the first client has been silent for too long.
    pub(super) fn first_lapse(&self) -> Option<Instant> {
        self.0.values().filter_map(Jog::lapses).min()
    }

    /// The motors in the mask `motors` do something else.
    pub(super) fn over(&mut self, motors: u32) {
        self.0.retain(|(motor, _), _| motors >> (motor - 1) & 1 == 0);
    }

    /// The motors move and stand so.
    pub(super) fn see_motion(&mut self, motion: Motion, now: Instant) {
        self.0.retain(|(motor, _), jog| {
            let is_in = |mask: u32| mask >> (motor - 1) & 1 != 0;
            if jog.is_over(now) {
                return false;
            }
            jog.has_moved |= is_in(motion.moving);
            let stands = jog.has_moved && is_in(motion.standing);
            jog.stands_since = stands.then(|| jog.stands_since.unwrap_or(now));
            true
        });
    }

    /// The motors that jog for the clients that `is_gone` names, or that are silent for too long; they are stopped now.
    pub(super) fn take(&mut self, now: Instant, is_gone: impl Fn(u64) -> bool) -> u32 {
        let is_silent = |jog: &Jog| jog.lapses().is_some_and(|end| now >= end);
        let gone = self.0.extract_if(|(_, client), jog| is_gone(*client) || is_silent(jog));
        gone.filter(|(_, jog)| !jog.is_over(now)).fold(0, |motors, ((motor, _), _)| motors | 1 << (motor - 1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn d7_a_jog_ends_with_its_client_unless_it_is_over_or_anothers() {
        let now = Instant::now();
        let at = |ms| now + Duration::from_millis(ms);
        let mut jogs = LineJogs::default();
        jogs.begin(7, 0b111, None, now);
        jogs.begin(8, 0b010, None, now);
        jogs.over(0b001);
        assert_eq!(jogs.take(now, |client| client == 7), 0b100);
        assert_eq!(jogs.take(now, |client| client == 7), 0);
        assert_eq!(jogs.take(now, |_| true), 0b010);
        let see = |jogs: &mut LineJogs, moving: u32, ms| {
            jogs.see_motion(Motion { moving, standing: !moving }, at(ms));
        };
        jogs.begin(7, 0b11, None, now);
        see(&mut jogs, 0b00, 0);
        see(&mut jogs, 0b01, 200);
        see(&mut jogs, 0b00, 300);
        see(&mut jogs, 0b01, 350);
        see(&mut jogs, 0b00, 400);
        // Somebody moves the first one again, but not this client.
        see(&mut jogs, 0b11, 600);
        assert_eq!(jogs.take(at(600), |_| true), 0b10, "the second one had not begun to move");
    }

    #[test]
    fn d7_a_line_that_may_have_done_nothing_takes_nobodys_jog_away() {
        let now = Instant::now();
        let mut jogs = LineJogs::default();
        jogs.begin(7, 0b1, None, now);
        jogs.may_begin(8, 0b1, None, now);
        assert_eq!(jogs.take(now, |client| client == 7), 0b1);
        jogs.begin(7, 0b1, None, now);
        jogs.may_begin(8, 0b1, None, now);
        assert_eq!(jogs.take(now, |client| client == 8), 0b1, "or it may have");
        assert!(jogs.go_on(7, now));
        jogs.begin(9, 0b1, None, now);
        assert_eq!(jogs.take(now, |client| client != 9), 0);
    }

    #[test]
    fn d7_a_jog_ends_when_its_client_is_silent_for_as_long_as_he_said() {
        let now = Instant::now();
        let at = |ms| now + Duration::from_millis(ms);
        let mut jogs = LineJogs::default();
        jogs.begin(7, 0b01, Some(Duration::from_secs(1)), now);
        jogs.begin(8, 0b10, None, now);
        assert_eq!((jogs.first_lapse(), jogs.take(at(999), |_| false)), (Some(at(1000)), 0));
        jogs.hear(|client| client == 7, at(999));
        assert!(jogs.take(at(1998), |_| false) == 0 && jogs.go_on(7, at(1998)));
        assert_eq!(jogs.take(at(1999), |_| false), 0b01);
        assert!(!jogs.go_on(7, at(1999)) && jogs.go_on(8, at(1999)));
        assert_eq!((jogs.first_lapse(), jogs.take(at(9999), |_| false)), (None, 0));
    }
}
