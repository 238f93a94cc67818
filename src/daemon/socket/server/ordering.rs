//! Orders: jogs to a position, home searches, runs, steps and new positions, by a command line of the daemon's own.
//!
//! The daemon asks the board for the address, then sends the line, which puts the address back. Both lines are on-line
//! only: no program buffer takes them.

use std::time::Instant;

use super::Service;
use super::replies::Answered;
use crate::daemon::motion::effect::LineEffect;
use crate::daemon::shared::queue::{DEFAULT_TIMEOUT, Line, Outcome};
use crate::daemon::socket::call_step::CallStep;
use crate::daemon::socket::call_table::Caller;
use crate::daemon::socket::heard::Heard;
use crate::daemon::socket::order::Order;
use crate::protocol::Reply;

impl Service {
    /// Asks the board for `caller` what the line of `order` has to know.
    ///
    /// # Errors
    /// Why the daemon has sent nothing.
    pub(super) fn order(&mut self, caller: Caller, order: Order, now: Instant) -> Answered {
        self.may_order(caller, order)?;
        self.may_start(order.starts())?;
        self.ask_for_order(caller, order, now + DEFAULT_TIMEOUT);
        Ok(None)
    }

    fn ask_for_order(&mut self, caller: Caller, order: Order, deadline: Instant) {
        self.question(caller, &order.question(), CallStep::Order { order, is_old: false }, deadline);
    }

    /// The board has answered the question: sends the line. Asks again if the answer `is_old`.
    pub(super) fn order_step(&mut self, order: Order, is_old: bool, heard: Heard, now: Instant) -> Answered {
        if is_old && heard.outcome == Outcome::Done {
            self.ask_for_order(heard.caller, order, heard.deadline);
            return Ok(None);
        }
        let Heard { caller, deadline, outcome, .. } = heard;
        let answers = match outcome {
            // The question has failed. The daemon has not sent the line.
            Outcome::Error(_) | Outcome::TimedOut | Outcome::Interrupted(_) => Vec::new(),
            _ => heard.lines(now)?,
        };
        // Another client may have begun to hold the motor while the daemon asked the board.
        self.may_order(caller, order)?;
        let (line, back) = order.line(&answers, &self.info)?;
        let line = Line::of(&*line);
        let effect = self.may_send(caller.client, &line, order.starts().confirmed)?;
        let audit = Some(format!("sends {:?}", &*line));
        self.send_beside(caller, line, audit, CallStep::Ordered { effect, back }, deadline);
        Ok(None)
    }

    /// The board has taken the line, or refused it: then the line may not have come to its end, so another line puts
    /// the address back.
    pub(super) fn ordered(&mut self, effect: LineEffect, back: &str, heard: Heard, now: Instant) -> Answered {
        let (caller, is_refused) = (heard.caller, matches!(heard.outcome, Outcome::Error(_)));
        match self.reply_to_line(effect, heard, now) {
            Err(error) if is_refused => {
                self.question(caller, back, CallStep::PutBack(Box::new(error)), now + DEFAULT_TIMEOUT);
                Ok(None)
            }
            reply => reply.map(|_| Some(Reply::done())),
        }
    }
}
