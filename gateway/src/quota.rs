//! How often the log is told what anybody on the network can cause.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Lines in a period, and how long that is.
const LINES: u32 = 20;
const PERIOD: Duration = Duration::from_secs(10);

/// What is left of a period's lines.
#[derive(Debug, Default)]
pub struct Quota {
    period: Mutex<Option<(Instant, u32)>>,
}

impl Quota {
    /// Whether one more line may be logged at `now`.
    #[must_use]
    pub fn allows(&self, now: Instant) -> bool {
        let mut period = self.period.lock().unwrap_or_else(PoisonError::into_inner);
        let (began, told) =
            period.filter(|(began, _)| now.duration_since(*began) < PERIOD).unwrap_or((now, 0));
        *period = Some((began, told.saturating_add(1)));
        told < LINES
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_leaves_twenty_lines_a_period() {
        let (quota, start) = (Quota::default(), Instant::now());
        let told = (0..1000).filter(|_| quota.allows(start)).count();
        assert_eq!(told, 20);
        assert!(quota.allows(start + PERIOD));
    }
}
