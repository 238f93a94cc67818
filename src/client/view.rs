//! A sample with its age, and the reason if it is not live.

use crate::segment::{Condition, RegionInfo, Sample, Stamp, Subscriber};

pub use crate::segment::Staleness;

/// Data of one region, with the facts by which to judge them.
#[derive(Debug, Clone, PartialEq)]
pub struct View<T> {
    /// The sample's number in its region, from 1.
    pub sequence: u64,
    /// The time of the sample's first device read, in nanoseconds by the segment's clock.
    pub time_ns: u64,
    /// The same by CLOCK_REALTIME, nanoseconds since 1970.
    pub realtime_ns: i64,
    /// The sample's age when the client judged it, in nanoseconds.
    pub age_ns: u64,
    /// The board's servo timer, extended to 64 bit, in servo cycles.
    pub servo_timer: u64,
    /// Why the data are not live; `None` if they are.
    pub stale: Option<Staleness>,
    /// The data.
    pub data: T,
}

impl<T> View<T> {
    /// Whether the client may show the data as live.
    #[must_use]
    pub fn is_fresh(&self) -> bool {
        self.stale.is_none()
    }
}

/// A sample, not yet judged.
pub(super) struct Reading<T> {
    sequence: u64,
    stamp: Stamp,
    data: T,
}

impl<T> Reading<T> {
    /// `data`, which `sample` was decoded to.
    pub(super) fn new(sample: &Sample, data: T) -> Self {
        Self { sequence: sample.sequence(), stamp: sample.stamp(), data }
    }
}

/// The moment by which one call judges all its data. Take it after the last copy: then data that have become old
/// meanwhile do not pass as live. Judging makes no system call, for thousands of samples as for one.
pub(super) struct Moment {
    now_ns: u64,
    realtime_offset_ns: i64,
    /// Why no data of the segment are live.
    pub(super) stale: Option<Staleness>,
}

impl Moment {
    /// Now, in a segment that had `condition` when the call began. Makes no system call either.
    pub(super) fn now(subscriber: &Subscriber, condition: Condition) -> Self {
        let now_ns = subscriber.now_ns();
        let header = subscriber.header();
        let condition = if condition.is_over() { condition } else { subscriber.header_condition(now_ns) };
        Self {
            now_ns,
            realtime_offset_ns: header.realtime_offset_ns,
            stale: Staleness::of_segment(condition, &header, now_ns),
        }
    }

    /// A reading of `region`, judged.
    pub(super) fn view<T>(&self, region: &RegionInfo, reading: Reading<T>) -> View<T> {
        let Reading { sequence, stamp, data } = reading;
        let time_ns = stamp.time_ns;
        View {
            sequence,
            time_ns,
            realtime_ns: i64::try_from(time_ns).unwrap_or(i64::MAX).saturating_add(self.realtime_offset_ns),
            age_ns: self.now_ns.saturating_sub(time_ns),
            servo_timer: stamp.servo_timer,
            stale: self.stale.or_else(|| Staleness::of_sample(region, &stamp, self.now_ns)),
            data,
        }
    }
}
