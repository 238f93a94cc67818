//! Servo data come first: no other work starts within the guard time before a servo update, unless other work has
//! waited too often.
//!
//! The guard time is how long the largest piece of other work takes on this bus. The daemon learns it from the pieces
//! done.

use std::time::Duration;

/// Accesses of the largest piece of work: a response of 255 characters with its control words.
const LARGEST: f64 = 132.0;
/// What a piece takes besides its accesses: waking the client that waits for the result.
const BESIDES_NS: f64 = 8_000.0;
/// The longest guard time. Even on a slow bus it must leave some time between updates.
const MOST_NS: f64 = 150_000.0;
/// Pieces with fewer accesses are not used: waking clients would dominate. A block of the background report has 62.
const GUARD_SAMPLES: u64 = 48;
/// The fastest piece shows the speed of the bus; something held up the others. So the estimate grows at most by this
/// factor.
const SLOWER: f64 = 1.05;
/// Due work waits for at most this many servo updates in a row.
const STARVING_UPDATES: u32 = 8;

/// Whose turn it is on the bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Turn {
    /// The servo data.
    Servo,
    /// Other work that is due.
    Others,
    /// Nothing is due, or other work waits for the servo update.
    Nobody,
}

/// The guard time, and for how many updates in a row due work has waited.
#[derive(Debug)]
pub struct GuardTime {
    access_ns: f64,
    stood_back: u32,
}

impl Default for GuardTime {
    /// Assumes a fairly slow bus, until its speed is known.
    fn default() -> Self {
        Self { access_ns: 250.0, stood_back: 0 }
    }
}

impl GuardTime {
    /// Learns from a piece of work: its accesses and its time.
    pub fn took(&mut self, accesses: u64, time: Duration) {
        if accesses >= GUARD_SAMPLES {
            let each = time.as_nanos() as f64 / accesses as f64;
            self.access_ns = each.clamp(1.0, SLOWER * self.access_ns.max(1.0));
        }
    }

    /// The guard time in nanoseconds.
    fn ns(&self) -> u64 {
        (BESIDES_NS + LARGEST * self.access_ns).min(MOST_NS) as u64
    }

    /// Whether work that starts at `now_ns` could delay the servo update due at `servo_due_ns`.
    #[must_use]
    pub fn is_near(&self, now_ns: u64, servo_due_ns: u64) -> bool {
        now_ns.saturating_add(self.ns()) > servo_due_ns
    }

    /// Whether other work has waited so often that it goes before the next servo update.
    #[must_use]
    pub fn is_starving(&self) -> bool {
        self.stood_back >= STARVING_UPDATES
    }

    /// Decides whose turn it is. `servo_due`: a poll for servo data is due. `near`: their update is within the guard
    /// time. `work_due`: other work is due. `commands_wait`: commands wait in the queue.
    ///
    /// On a slow bus, or at a high servo rate, an update may always be near. A command that stops a machine must go
    /// out all the same. So due work that has waited for `STARVING_UPDATES` updates goes before the next one.
    pub fn turn(
        &mut self,
        servo_due: bool,
        near: bool,
        work_due: bool,
        commands_wait: impl FnOnce() -> bool,
    ) -> Turn {
        if (servo_due || near) && !(work_due && self.is_starving()) {
            if !servo_due {
                return Turn::Nobody;
            }
            self.stood_back = if work_due || commands_wait() { self.stood_back + 1 } else { 0 };
            return Turn::Servo;
        }
        self.others_had_turn();
        if work_due { Turn::Others } else { Turn::Nobody }
    }

    /// Records that other work was done.
    pub fn others_had_turn(&mut self) {
        self.stood_back = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_what_the_largest_piece_takes_on_this_bus() {
        let mut guard = GuardTime::default();
        assert_eq!(guard.ns(), 41_000);
        guard.took(62, Duration::from_micros(62));
        assert_eq!(guard.ns(), 42_650, "believed by and by");
        for _ in 0..100 {
            guard.took(62, Duration::from_micros(62));
        }
        assert_eq!(guard.ns(), 140_000, "1 us an access, as on ISA");
        guard.took(62, Duration::from_nanos(620));
        assert_eq!(guard.ns(), 9_320, "a fast one shows that the others were held up");
        for _ in 0..100 {
            guard.took(20, Duration::from_micros(500));
        }
        assert_eq!(guard.ns(), 9_320, "a few accesses tell nothing");
        for _ in 0..10_000 {
            guard.took(62, Duration::from_millis(5));
        }
        assert_eq!(guard.ns(), 150_000);
        assert!(guard.is_near(850_001, 1_000_000) && !guard.is_near(850_000, 1_000_000));
    }

    #[test]
    fn work_that_is_seldom_due_never_goes_just_before_a_servo_update() {
        let mut guard = GuardTime::default();
        for _ in 0..100 {
            assert_eq!(guard.turn(true, true, false, || false), Turn::Servo, "nothing else was due");
        }
        assert_eq!(guard.turn(false, true, true, || false), Turn::Nobody, "it waits for the update");
        assert_eq!(guard.turn(true, true, true, || false), Turn::Servo);
        assert_eq!(guard.turn(false, false, true, || false), Turn::Others);
    }

    #[test]
    fn work_that_stood_back_before_so_many_updates_has_its_turn() {
        for commands_alone in [false, true] {
            let mut guard = GuardTime::default();
            for _ in 0..STARVING_UPDATES {
                assert!(!guard.is_starving());
                assert_eq!(guard.turn(false, true, !commands_alone, || commands_alone), Turn::Nobody);
                assert_eq!(guard.turn(true, true, !commands_alone, || commands_alone), Turn::Servo);
            }
            assert!(guard.is_starving());
            // By now the command has been taken, and has become work.
            assert_eq!(guard.turn(true, true, true, || false), Turn::Others);
            assert_eq!(guard.turn(true, true, true, || false), Turn::Servo, "then it stands back again");
        }
    }
}
