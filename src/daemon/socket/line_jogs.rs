//! Jogs without an end that command lines have begun, and that end with the connection these came by.
//!
//! Nobody else is kept from such a motor: whoever sends it another command has it from then on. A motor that stands is nobody's.

use std::collections::HashMap;
use std::time::Instant;

use super::leases::STANDS;
use super::stop_target::numbers;
use crate::function::servo::Motion;

#[derive(Debug)]
struct Jog {
    client: u64,
    has_moved: bool,
    stands_since: Option<Instant>,
}

impl Jog {
    fn is_over(&self, now: Instant) -> bool {
        self.stands_since.is_some_and(|since| now >= since + STANDS)
    }
}

/// Each motor that jogs so.
#[derive(Debug, Default)]
pub(super) struct LineJogs(HashMap<u32, Jog>);

impl LineJogs {
    /// The motors in the mask `motors` jog for `client`; bit 0 is motor 1.
    pub(super) fn begin(&mut self, client: u64, motors: u32) {
        for motor in numbers(motors) {
            self.0.insert(motor, Jog { client, has_moved: false, stands_since: None });
        }
    }

    /// The motors in the mask `motors` do something else.
    pub(super) fn over(&mut self, motors: u32) {
        for motor in numbers(motors) {
            self.0.remove(&motor);
        }
    }

    /// The motors move and stand so.
    pub(super) fn see_motion(&mut self, motion: Motion, now: Instant) {
        self.0.retain(|motor, jog| {
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

    /// The motors that jog for the clients that `is_gone` names; they are stopped now.
    pub(super) fn take(&mut self, now: Instant, is_gone: impl Fn(u64) -> bool) -> u32 {
        let gone = self.0.extract_if(|_, jog| is_gone(jog.client));
        gone.filter(|(_, jog)| !jog.is_over(now)).fold(0, |motors, (motor, _)| motors | 1 << (motor - 1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn d7_a_jog_ends_with_its_client_unless_it_is_over_or_anothers() {
        let now = Instant::now();
        let at = |ms| now + Duration::from_millis(ms);
        let mut jogs = LineJogs::default();
        jogs.begin(7, 0b111);
        jogs.begin(8, 0b010);
        jogs.over(0b001);
        assert_eq!(jogs.take(now, |client| client == 7), 0b100);
        assert_eq!(jogs.take(now, |client| client == 7), 0);
        assert_eq!(jogs.take(now, |_| true), 0b010);
        let see = |jogs: &mut LineJogs, moving: u32, ms| {
            jogs.see_motion(Motion { moving, standing: !moving }, at(ms));
        };
        jogs.begin(7, 0b11);
        see(&mut jogs, 0b00, 0);
        see(&mut jogs, 0b01, 200);
        see(&mut jogs, 0b00, 300);
        see(&mut jogs, 0b01, 350);
        see(&mut jogs, 0b00, 400);
        // Somebody moves the first one again, but not this client.
        see(&mut jogs, 0b11, 600);
        assert_eq!(jogs.take(at(600), |_| true), 0b10, "the second one had not begun to move");
    }
}
