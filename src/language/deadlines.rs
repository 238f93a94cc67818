//! How long the board may take for a command line.
//!
//! No manual gives times. [`super::Meaning::deadline`] goes by what takes long; the limits are ours, several times what such work takes. A limit
//! that is too long costs only the wait for a board that does not answer at all. After one that is too short the line is told as
//! uncertain, and the port is held until it is done.

use std::time::Duration;

use super::command::Kind;

/// For a line with nothing in it that takes long, when its sender does not say.
pub const PLAIN: Duration = Duration::from_secs(5);
/// The longest limit of all.
pub const LONGEST: Duration = Duration::from_secs(60);
/// For a line that resets the board, which need not answer it, so that it is not waited for any longer.
pub const RESETTING: Duration = Duration::from_secs(3);
/// For each value that a range asks for or sets, on top of the rest: each is a line of the reply.
const A_VALUE: Duration = Duration::from_millis(20);
/// More values than any board has of a kind.
const VALUES_MAX: u32 = 8192;

/// How long a command may take that takes long.
pub(super) const fn slow(kind: Kind) -> Duration {
    match kind {
        // Acknowledged when the flash memory is written, seconds later.
        Kind::Saves | Kind::StationSaves => LONGEST,
        // A response for each program line.
        Kind::Lists(_) => LONGEST,
        // Reserves or frees memory of the board's buffers.
        Kind::Buffers(_) | Kind::DeletesGather | Kind::DeletesRotary => Duration::from_secs(20),
        // Locks or unlocks the board's programs.
        Kind::Password => Duration::from_secs(20),
        _ => Duration::ZERO,
    }
}

/// How long the board may take for a line whose slowest command takes so long, which resets the board or not, and whose ranges are of so
/// many values, where a plain one may take `plain`.
pub(super) fn limit(slow: Duration, resets: bool, values: u32, plain: Duration) -> Duration {
    if resets && slow.is_zero() {
        return RESETTING;
    }
    let limit = slow.max(plain) + A_VALUE * values.min(VALUES_MAX);
    limit.min(LONGEST.max(plain))
}
