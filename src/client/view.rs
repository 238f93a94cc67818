//! A sample with its age, and why it may not be taken for live.

use std::fmt;

use crate::segment::{Condition, RegionState, Sample, Subscriber};

/// Servo data count as old after this time without an update, or after ten periods, when the daemon gives no limit.
const STALE_NS: u64 = 100_000_000;
const STALE_PERIODS: u64 = 10;

/// Why data are not live. The text says what to do where something can be done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Staleness {
    /// The daemon stopped or was killed, and no other has taken its place.
    DaemonGone,
    /// The daemon gives no sign of life.
    DaemonStopped {
        /// Since when, in nanoseconds.
        silent_ns: u64,
    },
    /// The daemon is still identifying its board.
    Starting,
    /// The daemon runs and the board does not answer.
    BoardSilent,
    /// The daemon does not mirror these data now: the function is off on the board.
    Off,
    /// The board has stopped updating these data.
    NoUpdates {
        /// The age of the latest, in nanoseconds.
        age_ns: u64,
    },
    /// The sample itself is marked as not whole.
    NotWhole,
}

impl Staleness {
    /// The reason in one word, for programs.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::DaemonGone => "daemon_gone",
            Self::DaemonStopped { .. } => "daemon_stopped",
            Self::Starting => "starting",
            Self::BoardSilent => "board_silent",
            Self::Off => "off",
            Self::NoUpdates { .. } => "no_updates",
            Self::NotWhole => "not_whole",
        }
    }
}

fn seconds(ns: u64) -> f64 {
    ns as f64 / 1e9
}

impl fmt::Display for Staleness {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::DaemonGone => f.write_str("pmacd is gone; start it"),
            Self::DaemonStopped { silent_ns } => {
                write!(
                    f,
                    "pmacd has given no sign of life for {:.1} s; it is stopped or hangs",
                    seconds(*silent_ns)
                )
            }
            Self::Starting => f.write_str("pmacd is still identifying the board"),
            Self::BoardSilent => {
                f.write_str("the board does not answer; look at its power, cable and address")
            }
            Self::Off => f.write_str(
                "the board does not send these data, or pmacd does not read them; switch the function on (servo I48, background I49, variables I55; `functions` in pmacd's configuration)",
            ),
            Self::NoUpdates { age_ns } => {
                write!(f, "the board has not updated these data for {:.1} s", seconds(*age_ns))
            }
            Self::NotWhole => f.write_str("the data were not read whole"),
        }
    }
}

/// Data of one region, with what is needed to judge them.
#[derive(Debug, Clone, PartialEq)]
pub struct View<T> {
    /// The sample's number in its region, from 1.
    pub sequence: u64,
    /// CLOCK_MONOTONIC of the first device read that went into it, nanoseconds.
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

/// Why what `subscriber` has may not be taken for live at `now_ns`, whatever region it is of.
pub(super) fn staleness(subscriber: &Subscriber, now_ns: u64) -> Option<Staleness> {
    let header = subscriber.header();
    let silent_ns = now_ns.saturating_sub(header.heartbeat_ns);
    match subscriber.condition() {
        Condition::Live => None,
        Condition::Init => Some(Staleness::Starting),
        Condition::Stale if silent_ns > header.heartbeat_limit_ns => {
            Some(Staleness::DaemonStopped { silent_ns })
        }
        Condition::Stale => Some(Staleness::BoardSilent),
        Condition::Dead | Condition::OwnerGone | Condition::Replaced => Some(Staleness::DaemonGone),
    }
}

/// Why `sample` of the region whose state is `region` may not be taken for live at `now_ns`.
pub(super) fn region_staleness(
    region: &crate::segment::RegionInfo,
    sample: &Sample,
    now_ns: u64,
) -> Option<Staleness> {
    let age_ns = now_ns.saturating_sub(sample.stamp().time_ns);
    let limit_ns = match (region.stale_after_ns, region.period_ns) {
        (0, 0) => u64::MAX,
        (0, period) => STALE_NS.max(period.saturating_mul(STALE_PERIODS)),
        (limit, _) => limit,
    };
    match region.state {
        RegionState::Off => Some(Staleness::Off),
        RegionState::Stale => Some(Staleness::NoUpdates { age_ns }),
        RegionState::Live if age_ns > limit_ns => Some(Staleness::NoUpdates { age_ns }),
        RegionState::Live if !sample.stamp().valid => Some(Staleness::NotWhole),
        RegionState::Live => None,
    }
}
