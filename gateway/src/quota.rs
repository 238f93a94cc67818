//! Limits the log lines that strangers on the network can cause.

use std::time::{Duration, Instant};

/// The log lines left at present; used lines come back with time.
#[derive(Debug)]
pub struct Quota {
    most: u32,
    /// The time until one used line comes back.
    every: Duration,
    left: u32,
    /// The time for which `left` holds.
    since: Option<Instant>,
    left_out: u64,
}

impl Quota {
    /// `most` lines at once, and one more each `every`.
    #[must_use]
    pub const fn new(most: u32, every: Duration) -> Self {
        Self { most, every, left: most, since: None, left_out: 0 }
    }

    /// Takes one line at `now`, and returns how many were dropped before it; `None` if no line is left.
    pub fn take(&mut self, now: Instant) -> Option<u64> {
        let since = *self.since.get_or_insert(now);
        let back = now.duration_since(since).as_nanos() / self.every.as_nanos().max(1);
        if let Some(back) = u32::try_from(back).ok().filter(|back| *back < self.most - self.left) {
            self.left += back;
            self.since = Some(since + self.every * back);
        } else {
            (self.left, self.since) = (self.most, Some(now));
        }
        match self.left.checked_sub(1) {
            Some(left) => {
                self.left = left;
                Some(std::mem::take(&mut self.left_out))
            }
            None => {
                self.left_out += 1;
                None
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_leaves_few_lines_and_the_others_are_counted() {
        let every = Duration::from_secs(10);
        let (mut quota, start) = (Quota::new(20, every), Instant::now());
        let told = (0..1000).filter(|_| quota.take(start).is_some()).count();
        assert_eq!(told, 20);
        assert_eq!(quota.take(start + every / 2), None);
        assert_eq!(quota.take(start + every), Some(981));
        assert_eq!(quota.take(start + every), None, "one comes back at a time");
        // A day of it.
        let told = (0..8640).filter(|_| quota.take(start + every).is_some()).count();
        assert_eq!(told, 0);
        let later = (2..8642).filter(|tens| quota.take(start + every * *tens).is_some()).count();
        assert_eq!(later, 8640);
        let rested = start + every * 100_000;
        assert_eq!((0..1000).filter(|_| quota.take(rested).is_some()).count(), 20);
    }
}
