//! Which motors' loops are open, by the servo report, if that is newer than the last panel request.
//!
//! A jog closes the loop of a killed motor. An older report still calls the loop open: a daemon that believed this
//! report would leave a motor moving.
//!
//! While no servo data come, for example after a reset, the background report tells which amplifiers are off. A killed
//! motor's amplifier is off, and a jog enables it (status bit "amplifier enabled", Software Reference, on-line `?`).

use crate::map::Motors;

/// How many updates after the board took a request the daemon believes the report again. The first update may have been
/// under way.
const UPDATES_UNTIL_BELIEVED: u64 = 2;

/// The daemon's knowledge of the motors' loops.
#[derive(Debug, Default)]
pub struct OpenLoops {
    servo: LoopReport,
    background: LoopReport,
}

/// The answer of one report.
#[derive(Debug, Default)]
struct LoopReport {
    open: Motors,
    updates: u64,
    /// The motors of whose loops the daemon knows nothing, until that update.
    doubted: Motors,
    until: u64,
}

impl LoopReport {
    const fn see(&mut self, open: Motors, updates: u64) {
        (self.open, self.updates) = (open, updates);
        if updates >= self.until {
            self.doubted = Motors::NONE;
        }
    }

    const fn doubt(&mut self, motors: Motors) {
        self.doubted.add(motors);
        self.until = self.updates + UPDATES_UNTIL_BELIEVED;
    }

    const fn known(&self) -> Motors {
        self.open.without(self.doubted)
    }
}

impl OpenLoops {
    /// The servo report was updated for the `updates`th time, and calls these loops open.
    pub const fn see_servo(&mut self, open: Motors, updates: u64) {
        self.servo.see(open, updates);
    }

    /// The background report came for the `reports`th time, and calls these amplifiers off; none while servo data come.
    pub const fn see_background(&mut self, off: Motors, reports: u64) {
        self.background.see(off, reports);
    }

    /// A request to the panel may have changed the loops of `motors` by now.
    pub const fn doubt(&mut self, motors: Motors) {
        self.servo.doubt(motors);
        self.background.doubt(motors);
    }

    /// The motors whose loop is open for sure.
    #[must_use]
    pub const fn known(&self) -> Motors {
        self.servo.known().and(self.background.known())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_from_before_a_request_is_not_believed() {
        let mut loops = OpenLoops::default();
        loops.see_servo(Motors::from_bits(0b11), 7);
        assert_eq!(loops.known().bits(), 0b11);
        loops.doubt(Motors::from_bits(0b01));
        for update in [7, 8] {
            loops.see_servo(Motors::from_bits(0b11), update);
            assert_eq!(loops.known().bits(), 0b10, "update {update}");
        }
        loops.see_servo(Motors::from_bits(0b11), 9);
        assert_eq!(loops.known().bits(), 0b11, "the motor was killed again");
        loops.see_servo(Motors::from_bits(0), 9);
        assert_eq!(loops.known().bits(), 0, "no data come");
    }

    #[test]
    fn each_report_has_its_own_count() {
        let mut loops = OpenLoops::default();
        loops.see_servo(Motors::from_bits(0), 1000);
        loops.see_background(Motors::from_bits(0b1), 3);
        loops.doubt(Motors::from_bits(0b1));
        loops.see_background(Motors::from_bits(0b1), 4);
        assert_eq!(loops.known().bits(), 0, "a report that may be older than the request");
        loops.see_background(Motors::from_bits(0b1), 5);
        assert_eq!(loops.known().bits(), 0b1);
    }
}
