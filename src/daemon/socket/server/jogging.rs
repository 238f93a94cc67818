//! Jogs to a position.
//!
//! The daemon asks the board which motor it addresses, then sends the line that jogs and puts the address back. Both
//! lines are on-line only: no program buffer takes them.

use std::time::Instant;

use super::Service;
use super::replies::Answered;
use crate::daemon::shared::open_buffer::Writer;
use crate::daemon::shared::queue::{Command, Line, Origin, Outcome};
use crate::daemon::socket::call_step::CallStep;
use crate::daemon::socket::call_table::{Caller, Then};
use crate::daemon::socket::heard::Heard;
use crate::daemon::socket::jog_to::JogTo;
use crate::protocol::{CallError, Reply};

impl Service {
    /// Asks the board for `caller` which motor it addresses; once the board has told, sends the line.
    ///
    /// # Errors
    /// Why the daemon has sent nothing.
    pub(super) fn jog_to(&mut self, caller: Caller, jog: JogTo, deadline: Instant) -> Answered {
        // Another client may have begun to hold the motor while the daemon asked the board.
        self.may_jog(caller, jog)?;
        let Some(line) = jog.line() else {
            self.question(caller, "#", CallStep::JogTo(jog), deadline);
            return Ok(None);
        };
        let line = Line::of(&*line);
        let origin = Origin::of(caller.peer.uid.as_raw(), &line, false);
        let audit = Some(format!("sends {:?}", &*line));
        let then = Then::Call(CallStep::JogTo(jog));
        self.wait_for_board(caller, deadline, then, audit, |ticket| Command::Send {
            ticket,
            line,
            origin,
            deadline,
            writer: Writer::Question,
        });
        Ok(None)
    }

    /// Goes on after the question for the address, or after the line that jogs.
    pub(super) fn jog_step(&mut self, mut jog: JogTo, heard: Heard, now: Instant) -> Answered {
        let Heard { caller, deadline, outcome, .. } = heard;
        let is_question = jog.addressed.is_none();
        let addressed = match outcome {
            // The question has failed. The daemon has not sent the jog.
            Outcome::Error(_) | Outcome::TimedOut | Outcome::Interrupted(_) if is_question => None,
            _ => heard.lines(now)?.first().and_then(|line| line.trim().parse().ok()),
        };
        if !is_question {
            return Ok(Some(Reply::done()));
        }
        let unsaid =
            || CallError::refused("the board does not say which motor is addressed; nothing was sent");
        jog.addressed = Some(addressed.ok_or_else(unsaid)?);
        self.jog_to(caller, jog, deadline)
    }
}
