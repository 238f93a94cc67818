//! How many lines of a kind the log gets within a time. The others are counted.

use std::time::Instant;

/// What is left of the lines until a time.
#[derive(Debug, Clone, Copy)]
pub struct LogQuota {
    end: Instant,
    told: u32,
    untold: u64,
}

impl LogQuota {
    /// Nothing was logged yet of what counts until `end`.
    #[must_use]
    pub const fn until(end: Instant) -> Self {
        Self { end, told: 0, untold: 0 }
    }

    /// Whether one more line may be logged, of `most`. Counts it.
    pub fn may_tell(&mut self, most: u32) -> bool {
        let may = self.told < most;
        self.told += u32::from(may);
        self.untold += u64::from(!may);
        may
    }

    /// When it is over.
    #[must_use]
    pub const fn end(&self) -> Instant {
        self.end
    }

    /// Lines that were logged.
    #[must_use]
    pub const fn told(&self) -> u32 {
        self.told
    }

    /// Lines that were only counted.
    #[must_use]
    pub const fn untold(&self) -> u64 {
        self.untold
    }
}
