//! The number in a register's longs.

use serde::Serialize;

use crate::format::{fixed48, float48, int24};
use crate::map::status::{PMAC, is_set};

/// How to read a register's longs. The register alone does not tell: a word may have a sign or none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Reading {
    /// One long: a signed 24-bit word.
    Signed,
    /// One long: an unsigned 24-bit word.
    Unsigned,
    /// Two longs: 48-bit fixed point.
    Fixed,
    /// Two longs: 48-bit floating point.
    Float,
    /// Seven longs: commanded, actual and compensation position, 48-bit fixed point, and the servo status word. The
    /// following error is the first less the others, as in [`crate::decode::servo()`].
    FollowingError,
}

impl Reading {
    /// How many longs it takes.
    #[must_use]
    pub const fn longs(self) -> usize {
        match self {
            Self::Signed | Self::Unsigned => 1,
            Self::Fixed | Self::Float => 2,
            Self::FollowingError => 7,
        }
    }

    /// The number in `longs`, exactly; `None` when there are too few. A float beyond f64's range is infinite; the
    /// following error of a motor that follows a master is not a number, as no manual tells it.
    #[must_use]
    pub fn read(self, longs: &[u32]) -> Option<f64> {
        match (self, longs) {
            (Self::Signed, [word, ..]) => Some(int24::signed(*word).into()),
            (Self::Unsigned, [word, ..]) => Some(int24::unsigned(*word).into()),
            (Self::Fixed, [y, x, ..]) => Some(fixed48::decode(*y, *x) as f64),
            (Self::Float, [y, x, ..]) => Some(float48::decode(*y, *x)),
            (Self::FollowingError, [y, x, actual_y, actual_x, more_y, more_x, status, ..]) => {
                let [commanded, actual, more] =
                    [(y, x), (actual_y, actual_x), (more_y, more_x)].map(|(y, x)| fixed48::decode(*y, *x));
                let follows = is_set(*status, &PMAC.motor[0], "handwheel_enabled");
                let error = commanded.wrapping_sub(actual).wrapping_sub(more);
                Some(if follows { f64::NAN } else { error as f64 })
            }
            _ => None,
        }
    }
}
