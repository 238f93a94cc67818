//! How many lines of a kind the log gets within a time. The daemon counts the other lines.

use std::time::Instant;

/// The lines of a kind until a time: the logged ones, and the others.
#[derive(Debug, Clone, Copy)]
pub struct LogQuota {
    end: Instant,
    told: u32,
    untold: u64,
}

impl LogQuota {
    /// No lines yet; the quota counts until `end`.
    #[must_use]
    pub const fn until(end: Instant) -> Self {
        Self { end, told: 0, untold: 0 }
    }

    /// Whether the log may get another line, of `most`. Counts the line.
    pub fn may_tell(&mut self, most: u32) -> bool {
        let may = self.told < most;
        self.told += u32::from(may);
        self.untold += u64::from(!may);
        may
    }

    /// When the quota is over.
    #[must_use]
    pub const fn end(&self) -> Instant {
        self.end
    }

    /// How many lines the log got.
    #[must_use]
    pub const fn told(&self) -> u32 {
        self.told
    }

    /// How many lines the quota kept from the log.
    #[must_use]
    pub const fn untold(&self) -> u64 {
        self.untold
    }
}
