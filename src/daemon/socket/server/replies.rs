//! What callers are answered of what somebody holds, and at the daemon's end.

use crate::daemon::motion::hold_end::HoldEnd;
use crate::map::Motors;
use crate::protocol::{CallError, Reply};

/// What a call goes on with: the reply, unless something else waits for the board.
pub(super) type Answered = Result<Option<Reply>, CallError>;

/// What a client is told whose held jog is over.
pub(super) fn hold_over(end: Option<HoldEnd>) -> CallError {
    match end {
        Some(end) => CallError::refused(end),
        None => CallError::refused("there is no held jog of this connection (any more)"),
    }
}

/// What a client is told whose held jog was over before it was sent to the board.
pub(super) fn not_sent(end: Option<HoldEnd>) -> CallError {
    CallError::refused(format_args!("{}; the jog was not sent", hold_over(end)))
}

/// What a holder is told when `pmacd` stops, and the board has not taken the stop of these motors.
pub(super) fn stop_not_taken(motors: Motors) -> CallError {
    let reason = format!(
        "pmacd is stopping, and the board has not taken the stop of the held jog yet: motor {motors} MAY STILL MOVE; use the emergency stop"
    );
    CallError::Interrupted { reason }
}

/// What a client is told whose call is not begun any more, or will not be answered.
pub(super) fn is_stopping() -> CallError {
    CallError::Unavailable { reason: "pmacd is stopping".to_owned() }
}
