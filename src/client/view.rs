//! A sample with its age, and why it may not be taken for live.

pub use crate::segment::Staleness;

/// Data of one region, with what is needed to judge them.
#[derive(Debug, Clone, PartialEq)]
pub struct View<T> {
    /// The sample's number in its region, from 1.
    pub sequence: u64,
    /// When the first device read that went into it was made, nanoseconds by the segment's clock.
    pub time_ns: u64,
    /// The same by CLOCK_REALTIME, nanoseconds since 1970.
    pub realtime_ns: i64,
    /// How old it was when it was looked at, nanoseconds.
    pub age_ns: u64,
    /// The board's servo timer, extended to 64 bit, in servo cycles.
    pub servo_timer: u64,
    /// Why the data are not live; `None` when they are.
    pub stale: Option<Staleness>,
    /// The data.
    pub data: T,
}

impl<T> View<T> {
    /// Whether the data may be shown as live.
    #[must_use]
    pub fn is_fresh(&self) -> bool {
        self.stale.is_none()
    }
}
