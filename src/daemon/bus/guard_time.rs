//! Servo data come first: for how long before a servo update no other work is begun, and when other work has stood back
//! often enough.
//!
//! The guard time is as long as the largest piece of other work takes on this bus, which is learnt from how long pieces
//! took.

use std::time::Duration;

/// Accesses of the largest piece of work: a response of 255 characters with its control words.
const LARGEST: f64 = 132.0;
/// What a piece takes besides its accesses: waking who waits for its result.
const BESIDES_NS: f64 = 8_000.0;
/// However slow the bus, some time has to be left between two updates.
const MOST_NS: f64 = 150_000.0;
/// Pieces of fewer accesses tell more about waking others than about the bus. A block of the background report has 62.
const TELLING: u64 = 48;
/// The fastest piece tells what the bus takes, the others were held up. A slower bus is believed in steps of this.
const SLOWER: f64 = 1.05;
/// Servo updates in a row before which work that was due may have to stand back.
const STARVING_UPDATES: u32 = 8;

/// Whose turn it is on the bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Turn {
    /// The servo data's.
    Servo,
    /// The other work's that is due.
    Others,
    /// Nobody's: nothing is due, or what is due waits for the servo update.
    Nobody,
}

/// The guard time, and the count of updates before which work that was due stood back.
#[derive(Debug)]
pub struct GuardTime {
    access_ns: f64,
    stood_back: u32,
}

impl Default for GuardTime {
    /// That of a fairly slow bus, until it is known.
    fn default() -> Self {
        Self { access_ns: 250.0, stood_back: 0 }
    }
}

impl GuardTime {
    /// A piece of work of so many accesses took so long.
    pub fn took(&mut self, accesses: u64, time: Duration) {
        if accesses >= TELLING {
            let each = time.as_nanos() as f64 / accesses as f64;
            self.access_ns = each.clamp(1.0, SLOWER * self.access_ns.max(1.0));
        }
    }

    /// Nanoseconds to be left before a servo update.
    fn ns(&self) -> u64 {
        (BESIDES_NS + LARGEST * self.access_ns).min(MOST_NS) as u64
    }

    /// Whether work begun at `now_ns` might delay the servo update that is due at `servo_due_ns`.
    #[must_use]
    pub fn is_near(&self, now_ns: u64, servo_due_ns: u64) -> bool {
        now_ns.saturating_add(self.ns()) > servo_due_ns
    }

    /// Whether other work stood back so often that its turn comes before the next servo update.
    #[must_use]
    pub fn is_starving(&self) -> bool {
        self.stood_back >= STARVING_UPDATES
    }

    /// Whose turn it is. The servo data are `servo_due`, or their update is `near`; other work is due or not
    /// (`work_due`), or commands wait that have not been taken yet (`commands_wait`).
    ///
    /// On a slow bus, or at a high servo rate, an update may always be near. What stops a machine goes out all the same:
    /// work that was due when servo data had their turn so many times in a row has its own before the next ones.
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

    /// Other work has been done.
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
