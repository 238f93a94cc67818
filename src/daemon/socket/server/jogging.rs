//! Jogs to a position.
//!
//! The daemon asks what is addressed, then sends the line that jogs and puts the address back. Both lines are on-line only: no
//! program buffer takes them, whoever has one open.

use std::time::Instant;

use super::Service;
use super::replies::outcome_reply;
use crate::daemon::shared::open_buffer::Writer;
use crate::daemon::shared::queue::{Command, Line, Origin, Outcome};
use crate::daemon::socket::call_table::{Caller, Then};
use crate::daemon::socket::jog_to::JogTo;
use crate::protocol::CallError;

impl Service {
    /// Begins a jog that `caller` asks for.
    ///
    /// # Errors
    /// Why nothing was sent.
    pub(super) fn jog_to(&mut self, caller: Caller, jog: JogTo, now: Instant) -> Result<(), CallError> {
        self.may_jog(caller, jog)?;
        let deadline = JogTo::deadline(now);
        self.question(caller, JogTo::QUESTION, Then::JogTo(jog, deadline), deadline);
        Ok(())
    }

    /// The board has said what is addressed, or not: the line is sent, or the caller hears why not.
    pub(super) fn jog_addressed(
        &mut self,
        caller: Caller,
        (jog, deadline): (JogTo, Instant),
        lines: &[String],
        outcome: Outcome,
        now: Instant,
    ) {
        if let Err(error) = self.send_jog(caller, (jog, deadline), lines, outcome, now) {
            self.answer(caller, Err(error), now);
        }
    }

    fn send_jog(
        &mut self,
        caller: Caller,
        (jog, deadline): (JogTo, Instant),
        lines: &[String],
        outcome: Outcome,
        now: Instant,
    ) -> Result<(), CallError> {
        let addressed = match outcome {
            Outcome::Done => lines.first().and_then(|line| line.trim().parse().ok()),
            // That is said of the question. The jog has not been sent.
            Outcome::Error(_) | Outcome::TimedOut | Outcome::Interrupted(_) => None,
            outcome => return outcome_reply(outcome, Vec::new(), false, now).map(drop),
        };
        let addressed = addressed.ok_or_else(|| {
            CallError::refused("the board does not say which motor is addressed; nothing was sent")
        })?;
        // Somebody may have begun to hold it meanwhile.
        self.may_jog(caller, jog)?;
        let line = jog.line(addressed);
        let line = Line::of(&*line);
        let origin = Origin::of(caller.peer.uid.as_raw(), &line, false);
        let audit = Some(format!("sends {:?}", &*line));
        self.wait_for_board(caller, deadline, Then::ReplyDone(None), audit, |ticket| Command::Send {
            ticket,
            line,
            origin,
            deadline,
            writer: Writer::Question,
        });
        Ok(())
    }

    /// Whether `caller` may jog the motor now: nobody else holds it, and its loop is known not to be open. The daemon takes it
    /// that every jog closes the loop of a killed motor, as `J/` does (Turbo Software Reference p. 275).
    fn may_jog(&self, caller: Caller, jog: JogTo) -> Result<(), CallError> {
        self.spares_holds(caller.client, jog.motors())?;
        if self.info.loops_untold().meets(jog.motors()) {
            return Err(CallError::refused(format_args!(
                "whether the loop of motor {} is open is not known until the board has told where its M-variables point \
                 (pmacctl status tells how far that is); nothing was sent",
                jog.motors()
            )));
        }
        if self.info.loops_left_open().meets(jog.motors()) {
            return Err(CallError::refused(format_args!(
                "the loop of motor {0} is open (killed, or a fault), and a jog would close it; nothing was sent; pmacctl send \
                 '#{0}J/' closes it where the motor stands",
                jog.motors()
            )));
        }
        Ok(())
    }
}
