//! The servo timer: how many servo cycles the board has run, as far as the DPRAM shows.
//!
//! PMAC counts its servo cycles in 24 bits (X:$0000). On PMAC and PMAC2 the servo report has the low 15 of them, the
//! background report the low 16 (DPRAM manual p. 14, 17); on Turbo both have all 24. Extended to 64 bits it orders
//! everything the board reports.

/// Extends a counter that wraps to one that does not.
#[derive(Debug, Clone)]
pub struct ServoTimer {
    bits: u32,
    last: Option<u32>,
    extended: u64,
}

impl ServoTimer {
    /// A timer of which the DPRAM shows `bits` (at most 24).
    #[must_use]
    pub fn new(bits: u32) -> Self {
        Self { bits: bits.min(24), last: None, extended: 0 }
    }

    /// Takes the timer's present reading. Returns the extended count and how many servo cycles passed since the last
    /// reading: `None` for the first one. The timer cannot tell a board that was reset, or silent for a whole turn of
    /// the counter, from a board that was silent for less; a caller that knows better calls [`ServoTimer::reset`].
    pub fn advance(&mut self, reading: u32) -> (u64, Option<u32>) {
        let mask = (1u32 << self.bits) - 1;
        let reading = reading & mask;
        let passed = self.last.map(|last| reading.wrapping_sub(last) & mask);
        self.extended = match passed {
            Some(passed) => self.extended + u64::from(passed),
            // Keeps the low bits equal to the board's own, so that a reader can match them.
            None => (self.extended | u64::from(mask)) + 1 + u64::from(reading),
        };
        self.last = Some(reading);
        (self.extended, passed)
    }

    /// Forgets the last reading: the next one starts a new stretch, later than everything so far.
    pub fn reset(&mut self) {
        self.last = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_counts_across_the_wrap() {
        let mut timer = ServoTimer::new(15);
        let (first, passed) = timer.advance(0x7FFE);
        assert_eq!((first & 0x7FFF, passed), (0x7FFE, None));
        assert_eq!(timer.advance(0x7FFF), (first + 1, Some(1)));
        assert_eq!(timer.advance(0x0001), (first + 3, Some(2)));
        assert_eq!(timer.advance(0x8002), (first + 4, Some(1)), "bit 15 is not part of it");
        let mut timer = ServoTimer::new(24);
        let (first, _) = timer.advance(0xFF_FFFF);
        assert_eq!(timer.advance(0x00_0001), (first + 2, Some(2)));
    }

    #[test]
    fn after_a_break_it_goes_on_later_with_the_boards_own_low_bits() {
        let mut timer = ServoTimer::new(15);
        timer.advance(0x7000);
        let (before, _) = timer.advance(0x7FFF);
        timer.reset();
        let (after, passed) = timer.advance(3);
        assert!(after > before);
        assert_eq!((after & 0x7FFF, passed), (3, None));
    }
}
