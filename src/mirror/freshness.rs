//! Whether a region's data still come. Reports each change once, for the log.

use crate::segment::freshness::is_old;

/// The change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transition {
    /// Data come (again).
    Live,
    /// No data came for the region's limit.
    Stale,
}

/// Watches one region.
#[derive(Debug, Clone)]
pub struct Freshness {
    limit_ns: u64,
    last_ns: u64,
    live: bool,
}

impl Freshness {
    /// Not live yet; stale after `limit_ns` without data (0: never).
    #[must_use]
    pub fn new(limit_ns: u64) -> Self {
        Self { limit_ns, last_ns: 0, live: false }
    }

    /// Changes the limit.
    pub fn set_limit(&mut self, limit_ns: u64) {
        self.limit_ns = limit_ns;
    }

    /// The limit.
    #[must_use]
    pub fn limit_ns(&self) -> u64 {
        self.limit_ns
    }

    /// Whether data come.
    #[must_use]
    pub fn is_live(&self) -> bool {
        self.live
    }

    /// Data came at `now_ns`.
    pub fn on_update(&mut self, now_ns: u64) -> Option<Transition> {
        self.last_ns = now_ns;
        (!std::mem::replace(&mut self.live, true)).then_some(Transition::Live)
    }

    /// The daemon no longer looks for data.
    pub const fn end(&mut self) {
        self.live = false;
    }

    /// The daemon did not poll until `now_ns`, so a silence counts only from then on.
    pub fn reset_deadline(&mut self, now_ns: u64) {
        self.last_ns = self.last_ns.max(now_ns);
    }

    /// No data came until `now_ns`.
    pub fn timeout(&mut self, now_ns: u64) -> Option<Transition> {
        let over = self.live && is_old(self.last_ns, now_ns, self.limit_ns);
        if over {
            self.live = false;
        }
        over.then_some(Transition::Stale)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_change_is_told_once() {
        let mut freshness = Freshness::new(100);
        assert_eq!(freshness.timeout(1000), None, "it never was live");
        assert_eq!(freshness.on_update(1000), Some(Transition::Live));
        assert_eq!(freshness.on_update(1050), None);
        assert_eq!(freshness.timeout(1150), None);
        assert_eq!(freshness.timeout(1151), Some(Transition::Stale));
        assert_eq!(freshness.timeout(2000), None);
        assert_eq!(freshness.on_update(2001), Some(Transition::Live));
        freshness.reset_deadline(5000);
        assert_eq!(freshness.timeout(5100), None);
        assert_eq!(freshness.timeout(5101), Some(Transition::Stale));
    }
}
