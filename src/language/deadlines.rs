//! How long the board may take for a command line.
//!
//! No manual gives times. [`super::Meaning::deadline`] depends on the slowest command; we chose limits several times
//! as long as the work takes. A limit that is too long costs only the wait for a board that does not answer at all.
//! After a limit that is too short the daemon reports the line as uncertain, and holds the port until the board is
//! done.

use std::time::Duration;

use super::command::Kind;

/// For a line without a slow command, if its sender gives no time.
pub const PLAIN: Duration = Duration::from_secs(5);
/// The longest limit of all.
pub const LONGEST: Duration = Duration::from_secs(60);
/// For a line that resets the board: the board need not answer it, so the daemon waits no longer.
pub const RESETTING: Duration = Duration::from_secs(3);
/// For each value that a range asks for or sets, on top of the rest: the board answers with a line each.
const A_VALUE: Duration = Duration::from_millis(20);
/// More values than any board has of a kind.
const VALUES_MAX: u32 = 8192;

/// How long a slow command may take.
pub(super) const fn slow(kind: Kind) -> Duration {
    match kind {
        // The board acknowledges when it has written the flash memory, seconds later.
        Kind::Saves | Kind::StationSaves => LONGEST,
        // The board sends a response for each program line.
        Kind::Lists(_) => LONGEST,
        // The board reserves or frees memory for its buffers.
        Kind::Buffers(_) | Kind::DeletesGather | Kind::DeletesRotary => Duration::from_secs(20),
        // The board locks or unlocks its programs.
        Kind::Password => Duration::from_secs(20),
        _ => Duration::ZERO,
    }
}

/// How long the board may take for a line: `slow` is the time of its slowest command, `resets` tells whether it resets
/// the board, `values` counts the values of its ranges, and a plain line may take `plain`.
pub(super) fn limit(slow: Duration, resets: bool, values: u32, plain: Duration) -> Duration {
    if resets && slow.is_zero() {
        return RESETTING;
    }
    let limit = slow.max(plain) + A_VALUE * values.min(VALUES_MAX);
    limit.min(LONGEST.max(plain))
}
