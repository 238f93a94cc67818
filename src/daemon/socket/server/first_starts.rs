//! Has the board asked what lies in rotary buffers that the daemon knows nothing of, before it starts their programs.
//!
//! A daemon that was restarted does not know what a stream before has left, and the board does. Each coordinate system is asked
//! about once, and again at each start where something is left: another host, or a reset that nobody saw, may have taken it. Where command lines are not
//! used nobody can ask: a start goes as it is.

use std::time::{Duration, Instant};

use super::Service;
use super::replies::reply_lines;
use crate::daemon::shared::queue::Outcome;
use crate::daemon::socket::call_table::{Caller, Then};
use crate::daemon::socket::connection::Waiting;
use crate::daemon::socket::first_start::FirstStart;
use crate::daemon::socket::methods::Ask;
use crate::map::Systems;
use crate::protocol::{CallError, Function};

/// How long a question may wait for its turn.
const QUESTION: Duration = Duration::from_secs(1);

impl Service {
    /// Gives `ask` back if it is known what lies in the rotary buffers of the programs that it starts. Otherwise the board is asked,
    /// and it goes on then.
    pub(super) fn knows_what_is_left(&mut self, caller: Caller, ask: Ask, now: Instant) -> Option<Ask> {
        let existing = Systems::first(self.info.family().coordinate_systems);
        // What a stream of our own feeds it has asked about itself.
        let fed = Systems::from_bits(self.sequences.fed());
        let unknown = self.leftovers.to_ask(ask.starts()).among(existing).without(fed);
        if unknown.is_empty() || self.info.why_not(Function::Ascii).is_some() {
            return Some(ask);
        }
        let then = Then::FirstStart(Box::new(FirstStart::new(ask, unknown.bits())));
        self.question(caller, FirstStart::QUESTION, then, now + QUESTION);
        None
    }

    /// The board has answered a question of `start`, or not.
    pub(super) fn left_told(
        &mut self,
        caller: Caller,
        mut start: Box<FirstStart>,
        lines: Vec<String>,
        outcome: Outcome,
        now: Instant,
    ) {
        let reply = reply_lines(outcome, lines, false, now);
        let result = match (start.take(outcome, reply), outcome) {
            // Somebody has stopped all motion: what waited is not to be begun either.
            (Err(dropped), Outcome::Dropped(_)) => Err(dropped),
            (Err(reason), _) => Err(start.unknown(&reason, self.info.why_not(Function::Panel).is_none())),
            (Ok(found), _) => {
                match (found, outcome) {
                    (Some((system, _)), Outcome::Error(error)) => {
                        self.leftovers.refused(Systems::from_bits(system), error);
                    }
                    (Some((system, left)), _) => self.leftovers.find(Systems::from_bits(system), left),
                    (None, _) => {}
                }
                self.go_on_with_start(caller, start, now)
            }
        };
        if let Err(error) = result {
            self.answer(caller, Err(error), now);
        }
    }

    fn go_on_with_start(
        &mut self,
        caller: Caller,
        start: Box<FirstStart>,
        now: Instant,
    ) -> Result<(), CallError> {
        let Some(line) = start.line() else {
            let Some(client) = self.clients.get_mut(caller.client) else { return Ok(()) };
            client.wait_for(Waiting::Nothing);
            return self.ask(caller, start.ask, now);
        };
        self.question(caller, &line, Then::FirstStart(start), now + QUESTION);
        Ok(())
    }
}
