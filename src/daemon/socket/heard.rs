//! The outcome of a command, and the reply to its caller.

use std::time::Instant;

use crate::daemon::shared::caller::Caller;
use crate::daemon::shared::queue::Outcome;
use crate::map::errors::meaning;
use crate::protocol::{CallError, CommandPort, answer};

/// The most bytes of a board's reply that the server collects.
pub(super) const COLLECT_MAX: usize = 1024 * 1024;

/// The outcome of a command.
#[derive(Debug)]
pub(super) struct Heard {
    /// The command's caller.
    pub caller: Caller,
    /// How long the caller waits.
    pub deadline: Instant,
    /// How the command ended.
    pub outcome: Outcome,
    /// The lines of the board's reply.
    pub lines: Vec<String>,
    /// The reply was longer than [`COLLECT_MAX`], and is not whole.
    pub is_overlong: bool,
    /// The bus thread has not answered, or did not get the command.
    pub is_given_up: bool,
    /// Whether the log has an entry for the request.
    pub is_logged: bool,
}

impl Heard {
    /// The lines of the board's reply.
    ///
    /// # Errors
    /// Why the lines are missing.
    pub(super) fn lines(self, now: Instant) -> Result<Vec<String>, CallError> {
        reply_lines(self.outcome, self.lines, self.is_overlong, now)
    }

    /// The board's answers to a question before the call begins anything. `None`: the daemon cannot ask the board (any
    /// more). The board may still do the caller's request; if not, the job says so.
    ///
    /// # Errors
    /// Why nothing begins: the question had no turn, or a client has stopped all motion.
    pub(super) fn answers(self, now: Instant) -> Result<Option<Vec<String>>, CallError> {
        if self.is_given_up || matches!(self.outcome, Outcome::Dropped(_)) {
            return self.lines(now).map(|_| None);
        }
        Ok(self.remarks())
    }

    /// The board's answers to a question about a job that is already done or refused.
    pub(super) fn remarks(self) -> Option<Vec<String>> {
        let is_done = self.outcome == Outcome::Done;
        is_done.then(|| self.lines.iter().map(|line| answer::text(line).to_owned()).collect())
    }
}

/// The lines of the board's reply, or why they are missing.
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
