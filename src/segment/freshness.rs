//! The one rule that tells live data from old. `mirror`, [`super::Subscriber`] and [`crate::client`] all use it. The
//! layout page states it in words, under "Old or fresh".

use std::fmt;

use super::info::{Condition, HeaderInfo, RegionInfo};
use super::layout::RegionState;
use super::sample::Stamp;

/// Data are old after this many periods without an update.
const PERIODS: u64 = 10;

/// A time further ahead of now than this comes from another clock, so it tells no age: `pmacd` runs in another time
/// namespace, or was restored from a checkpoint.
const AHEAD_NS: u64 = 1_000_000_000;

/// The age limit of a region that expects an update every `period_ns`: ten periods, at least `least_ns`. All in
/// nanoseconds.
#[must_use]
pub const fn limit_ns(least_ns: u64, period_ns: u64) -> u64 {
    let periods = period_ns.saturating_mul(PERIODS);
    if least_ns > periods { least_ns } else { periods }
}

/// Whether data of `time_ns` are too old at `now_ns`, or so far ahead of `now_ns` that their age is unknown. A limit of
/// 0 means never.
#[must_use]
pub const fn is_old(time_ns: u64, now_ns: u64, limit_ns: u64) -> bool {
    limit_ns != 0 && (now_ns.saturating_sub(time_ns) > limit_ns || is_ahead(time_ns, now_ns))
}

const fn is_ahead(time_ns: u64, now_ns: u64) -> bool {
    time_ns.saturating_sub(now_ns) > AHEAD_NS
}

/// Why data are not live. The text says what the user can do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Staleness {
    /// The daemon has stopped or was killed, and no other daemon has taken its place.
    DaemonGone,
    /// The daemon's heartbeat has stopped.
    DaemonStopped {
        /// Time since the last heartbeat, in nanoseconds.
        silent_ns: u64,
    },
    /// The heartbeat or the sample comes from another clock than this program's.
    OtherClock {
        /// How far the time is ahead of now, in nanoseconds.
        ahead_ns: u64,
    },
    /// The daemon is still identifying its board.
    Starting,
    /// The daemon runs, but the board does not answer.
    BoardSilent,
    /// The daemon does not mirror these data: it does not use the board's function.
    Off,
    /// The board has stopped updating these data.
    NoUpdates {
        /// The age of the latest sample, in nanoseconds.
        age_ns: u64,
    },
    /// The sample is marked as incomplete.
    NotWhole,
}

impl Staleness {
    /// Why no region of the segment is live at `now_ns`; `None` if that depends on the region.
    #[must_use]
    pub fn of_segment(condition: Condition, header: &HeaderInfo, now_ns: u64) -> Option<Self> {
        match condition {
            Condition::Live => None,
            Condition::Init => Some(Self::Starting),
            Condition::Stale if !is_old(header.heartbeat_ns, now_ns, header.heartbeat_limit_ns) => {
                Some(Self::BoardSilent)
            }
            Condition::Stale => {
                Some(Self::of_age(header.heartbeat_ns, now_ns, |silent_ns| Self::DaemonStopped { silent_ns }))
            }
            Condition::Dead | Condition::OwnerGone | Condition::Replaced => Some(Self::DaemonGone),
        }
    }

    /// Why a sample is not live at `now_ns`, although the segment as a whole is.
    #[must_use]
    pub fn of_sample(region: &RegionInfo, stamp: &Stamp, now_ns: u64) -> Option<Self> {
        let too_old = || Self::of_age(stamp.time_ns, now_ns, |age_ns| Self::NoUpdates { age_ns });
        match region.state {
            RegionState::Off => Some(Self::Off),
            RegionState::Stale => Some(too_old()),
            RegionState::Live if is_old(stamp.time_ns, now_ns, region.stale_after_ns) => Some(too_old()),
            RegionState::Live if !stamp.valid => Some(Self::NotWhole),
            RegionState::Live => None,
        }
    }

    /// The reason why data of `time_ns` are old ([`is_old`]): another clock, or `of_age` of their age.
    fn of_age(time_ns: u64, now_ns: u64, of_age: impl FnOnce(u64) -> Self) -> Self {
        match is_ahead(time_ns, now_ns) {
            true => Self::OtherClock { ahead_ns: time_ns - now_ns },
            false => of_age(now_ns.saturating_sub(time_ns)),
        }
    }

    /// The reason in one word, for programs.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::DaemonGone => "daemon_gone",
            Self::DaemonStopped { .. } => "daemon_stopped",
            Self::OtherClock { .. } => "other_clock",
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
            Self::OtherClock { ahead_ns } => write!(
                f,
                "pmacd's times are {:.1} s ahead of this program's clock, so nobody knows how old the data are; run this program \
                in pmacd's time namespace, and restart a pmacd that was restored from a checkpoint",
                seconds(*ahead_ns)
            ),
            Self::Starting => f.write_str("pmacd is still identifying the board"),
            Self::BoardSilent => f.write_str(
                "the board does not answer; look at its power, cable and address, or switch on what pmacd may use of it (servo \
                I48, background I49, command lines I58)",
            ),
            Self::Off => f.write_str(
                "the board does not send these data, or pmacd does not read them; switch the function on (servo I48, \
                background I49, variables I55; `functions` in pmacd's configuration), or see pmacctl status",
            ),
            Self::NoUpdates { age_ns } => {
                write!(f, "the board has not updated these data for {:.1} s", seconds(*age_ns))
            }
            Self::NotWhole => f.write_str("the data were not read whole"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limit_is_ten_periods_and_at_least_the_least() {
        assert_eq!([limit_ns(100, 5), limit_ns(100, 11), limit_ns(100, 0)], [100, 110, 100]);
        assert_eq!(limit_ns(1, u64::MAX), u64::MAX);
    }

    #[test]
    fn what_is_older_than_its_limit_is_old_and_a_limit_of_0_is_none() {
        assert!(!is_old(1000, 1100, 100) && is_old(1000, 1101, 100));
        assert!(!is_old(0, u64::MAX, 0));
        assert!(!is_old(1000, 900, 1), "a sample taken after now is not old");
    }

    #[test]
    fn a_time_more_than_a_second_ahead_of_now_is_no_sign_of_life() {
        let (now, limit) = (5_000_000_000, 300_000_000);
        assert!(!is_old(now + AHEAD_NS, now, limit) && is_old(now + AHEAD_NS + 1, now, limit));
        assert!(!is_old(u64::MAX, 0, 0));
    }
}
