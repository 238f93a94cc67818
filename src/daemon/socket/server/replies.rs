//! What callers are answered: by how their command ended, and by whoever holds what they ask for.

use std::time::Instant;

use crate::daemon::motion::hold_end::HoldEnd;
use crate::daemon::shared::open_buffer::Account;
use crate::daemon::shared::queue::Outcome;
use crate::daemon::socket::call_table::{COLLECT_MAX, Heard};
use crate::map::Motors;
use crate::map::errors::meaning;
use crate::protocol::{CallError, CommandPort, Reply, answer};

/// What a call goes on with: the reply, unless something else waits for the board.
pub(super) type Answered = Result<Option<Reply>, CallError>;

impl Heard {
    /// The lines of the board's reply.
    ///
    /// # Errors
    /// Why they are not there.
    pub(super) fn lines(self, now: Instant) -> Result<Vec<String>, CallError> {
        reply_lines(self.outcome, self.lines, self.is_overlong, now)
    }

    /// The board's answers to a question of the daemon's own. `None`: the board cannot be asked (any more). It may still do what the
    /// caller wants; if not, the job says so.
    ///
    /// # Errors
    /// Why nothing follows: the question had no turn, or somebody has stopped all motion.
    pub(super) fn answers(self, now: Instant) -> Result<Option<Vec<String>>, CallError> {
        let is_known = self.is_given_up || matches!(self.outcome, Outcome::Done | Outcome::Dropped(_));
        let lines = is_known.then(|| self.lines(now)).transpose()?;
        Ok(lines.map(|lines| lines.iter().map(|line| answer::text(line).to_owned()).collect()))
    }
}

/// The lines of the board's reply, or why they are not there.
pub(super) fn reply_lines(
    outcome: Outcome,
    lines: Vec<String>,
    is_overlong: bool,
    now: Instant,
) -> Result<Vec<String>, CallError> {
    match outcome {
        Outcome::Done if is_overlong => Err(CallError::Interrupted {
            reason: format!("the board's reply is longer than {COLLECT_MAX} bytes"),
        }),
        Outcome::Done => Ok(lines),
        Outcome::Error(code) => {
            let meaning = meaning(code)
                .unwrap_or("an error number without a documented meaning, so it may have been carried out")
                .to_owned();
            Err(CallError::Board { code, meaning, lines })
        }
        Outcome::TimedOut => Err(CallError::TimedOut { lines }),
        Outcome::Unavailable { port, page } => {
            let written = page.map_or_else(String::new, |page| {
                format!("; pmacd has written the DPRAM's page 0x{page:02X} again, so try again")
            });
            let off = match port {
                CommandPort::Dpram => "is off (DPRAM ASCII: I58=0)",
                CommandPort::Mailbox => "is the VME mailboxes, which need I3=2 and both interrupts,",
            };
            let reason = format!("the port for command lines {off} or the board does not answer{written}");
            Err(CallError::Unavailable { reason })
        }
        Outcome::Busy => Err(CallError::Busy),
        Outcome::Interrupted(reason) => Err(CallError::Interrupted { reason: reason.to_string() }),
        Outcome::OutOfRange => Err(CallError::OutOfRange),
        Outcome::Barred(barred) => Err(CallError::refused(barred.reason(now))),
        Outcome::Refused(reason) | Outcome::Dropped(reason) => Err(CallError::refused(reason)),
    }
}

/// What a client is told whose held jog is over.
pub(super) fn hold_over(end: Option<HoldEnd>) -> CallError {
    match end {
        Some(end) => CallError::refused(end),
        None => CallError::refused("there is no held jog of this connection (any more)"),
    }
}

/// What a client is told who would move a motor that another one holds.
pub(super) fn held_by_another(holder: Option<Account>, motors: Motors) -> CallError {
    match holder {
        Some(holder) => CallError::refused(format_args!(
            "{holder} holds a jog of motor {motors}; nothing was sent; pmacctl jog N stop or abort ends that"
        )),
        None => CallError::refused(format_args!(
            "the board has not taken the stop of motor {motors} yet, which pmacd requests again; nothing was sent; abort stops it"
        )),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_that_does_not_answer_is_named() {
        let told = |port| {
            let outcome = Outcome::Unavailable { port, page: Some(0x1C) };
            reply_lines(outcome, Vec::new(), false, Instant::now()).unwrap_err().to_string()
        };
        let (dpram, mailbox) = (told(CommandPort::Dpram), told(CommandPort::Mailbox));
        assert!(dpram.contains("I58=0") && dpram.contains("page 0x1C"), "{dpram}");
        assert!(mailbox.contains("I3=2") && !mailbox.contains("I58"), "{mailbox}");
    }
}
