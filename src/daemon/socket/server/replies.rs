//! Replies about holds, and at the daemon's end.

use crate::daemon::motion::hold_end::HoldEnd;
use crate::map::Motors;
use crate::protocol::{CallError, Reply};

/// The result of a call's step: the reply, or `None` while the call waits.
pub(super) type Answered = Result<Option<Reply>, CallError>;

/// The error for a client whose held jog is over.
pub(super) fn hold_over(end: Option<HoldEnd>) -> CallError {
    match end {
        Some(end) => CallError::refused(end),
        None => CallError::refused("there is no held jog of this connection (any more)"),
    }
}

/// The error for a client whose held jog was over before the daemon sent it to the board.
pub(super) fn not_sent(end: Option<HoldEnd>) -> CallError {
    CallError::refused(format_args!("{}; the jog was not sent", hold_over(end)))
}

/// The error for a holder while the daemon stops and the board has not taken the stop of these motors.
pub(super) fn stop_not_taken(motors: Motors) -> CallError {
    let reason = format!(
        "pmacd is stopping, and the board has not taken the stop of the held jog yet: motor {motors} MAY STILL MOVE; use the emergency stop"
    );
    CallError::Interrupted { reason }
}

/// The error for a call that the stopping daemon does not begin, or will not answer.
pub(super) fn is_stopping() -> CallError {
    CallError::Unavailable { reason: "pmacd is stopping".to_owned() }
}
