//! The calls that a replay answers: about the board, about the words in its window, and lines that the recording has an
//! answer to. Every other call would move, set or stop something, and a replay has nothing to move.

use super::methods::{Action, Ask};
use super::sequences::SequenceCall;
use crate::protocol::{CallError, control};
use crate::recording::Replies;

/// Whether a client may ask for `action` in the replay of a recording with these `replies`.
///
/// # Errors
/// The replay cannot do `action`: the daemon does nothing.
pub(super) fn check(action: &Action, replies: &Replies) -> Result<(), CallError> {
    let unanswered = match action {
        Action::Reply(_)
        | Action::Info
        | Action::Stream
        | Action::Renew
        | Action::RenewJogs
        | Action::Trace(_)
        | Action::Ask(Ask::Read { .. })
        | Action::Sequence(SequenceCall::Renew) => None,
        Action::Ask(Ask::Send { line, .. }) => unanswered(line.as_bytes(), replies),
        Action::Ask(Ask::Control { character, .. }) => {
            unanswered(control::name(*character).as_bytes(), replies)
        }
        Action::Sequence(SequenceCall::Lines(batch)) => {
            batch.all_lines().find_map(|line| unanswered(line.as_bytes(), replies))
        }
        _ => return Err(CallError::replay_moves_nothing()),
    };
    unanswered.map_or(Ok(()), |what| Err(CallError::of_replay(what)))
}

fn unanswered(line: &[u8], replies: &Replies) -> Option<String> {
    let line = String::from_utf8_lossy(line);
    replies
        .to(&line)
        .is_none()
        .then(|| format!("the recording has no answer to `{line}`, and nothing can be moved or set"))
}
