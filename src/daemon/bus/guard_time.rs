//! How long before a servo update no other work is begun, so that it cannot delay the servo data: as long as the largest
//! piece of other work takes on this bus, which is learnt from how long pieces took.

use std::time::Duration;

/// Accesses of the largest piece of work: a response of 255 characters with its control words.
const LARGEST: f64 = 132.0;
/// What a piece takes besides its accesses: waking who waits for its result.
const BESIDES_NS: f64 = 8_000.0;
/// However slow the bus, there has to be room between two updates.
const MOST_NS: f64 = 150_000.0;
/// Pieces of fewer accesses tell more about waking others than about the bus. A block of the background report has 62.
const TELLING: u64 = 48;
/// The fastest piece tells what the bus takes, the others were held up; a bus that becomes slower is believed by and by.
const SLOWER: f64 = 1.05;

/// The time to be left before a servo update.
#[derive(Debug)]
pub struct Room {
    access_ns: f64,
}

impl Default for Room {
    /// A fairly slow bus, until it is known.
    fn default() -> Self {
        Self { access_ns: 250.0 }
    }
}

impl Room {
    /// A piece of work of so many accesses took so long.
    pub fn took(&mut self, accesses: u64, time: Duration) {
        if accesses >= TELLING {
            let each = time.as_nanos() as f64 / accesses as f64;
            self.access_ns = each.clamp(1.0, SLOWER * self.access_ns.max(1.0));
        }
    }

    /// Nanoseconds to be left before a servo update.
    #[must_use]
    pub fn ns(&self) -> u64 {
        (BESIDES_NS + LARGEST * self.access_ns).min(MOST_NS) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_what_the_largest_piece_takes_on_this_bus() {
        let mut room = Room::default();
        assert_eq!(room.ns(), 41_000);
        room.took(62, Duration::from_micros(62));
        assert_eq!(room.ns(), 42_650, "believed by and by");
        for _ in 0..100 {
            room.took(62, Duration::from_micros(62));
        }
        assert_eq!(room.ns(), 140_000, "1 us an access, as on ISA");
        room.took(62, Duration::from_nanos(620));
        assert_eq!(room.ns(), 9_320, "a fast one shows that the others were held up");
        for _ in 0..100 {
            room.took(20, Duration::from_micros(500));
        }
        assert_eq!(room.ns(), 9_320, "a few accesses tell nothing");
        for _ in 0..10_000 {
            room.took(62, Duration::from_millis(5));
        }
        assert_eq!(room.ns(), 150_000);
    }
}
