//! Before a start, asks the board about the rotary buffers whose content the daemon does not know.
//!
//! After a restart the daemon does not know the lines that an earlier stream left, but the board does. The daemon asks
//! about each coordinate system once, and again at each start while lines are left: another host, or a reset that the
//! daemon missed, may have taken them away. Where the daemon uses no command lines it cannot ask, and sends the start
//! unchecked.

use std::time::{Duration, Instant};

use super::Service;
use super::replies::Answered;
use crate::daemon::shared::queue::Outcome;
use crate::daemon::socket::call_step::CallStep;
use crate::daemon::socket::call_table::Caller;
use crate::daemon::socket::first_start::FirstStart;
use crate::daemon::socket::heard::Heard;
use crate::daemon::socket::methods::Ask;
use crate::map::Systems;
use crate::protocol::Function;

/// How long a question may wait for its turn.
const QUESTION_TURN: Duration = Duration::from_secs(1);

impl Service {
    /// Gives `ask` back if the daemon knows the lines in the rotary buffers of the programs that `ask` starts.
    /// Otherwise the daemon asks the board first.
    pub(super) fn knows_what_is_left(&mut self, caller: Caller, ask: Ask, now: Instant) -> Option<Ask> {
        let existing = Systems::first(self.info.family().coordinate_systems);
        // A stream has already asked about the coordinate system that it feeds.
        let unknown = self.leftovers.to_ask(ask.starts()).among(existing).without(self.sequences.fed());
        if unknown.is_empty() || self.info.why_not(Function::Ascii).is_some() {
            return Some(ask);
        }
        let step = CallStep::Start(Box::new(FirstStart::new(ask, unknown)));
        self.question(caller, FirstStart::QUESTION, step, now + QUESTION_TURN);
        None
    }

    /// The board has answered a question of `start`, or has not: sends the next question, or the start itself.
    pub(super) fn start_step(&mut self, mut start: Box<FirstStart>, heard: Heard, now: Instant) -> Answered {
        let Heard { caller, outcome, .. } = heard;
        match (start.take(outcome, heard.lines(now)), outcome) {
            (Err(reason), _) => return Err(start.unknown(&reason)),
            (Ok(Some((system, _))), Outcome::Error(error)) => self.leftovers.refused(system, error),
            (Ok(Some((system, left))), _) => self.leftovers.find(system, left),
            (Ok(None), _) => {}
        }
        match start.line() {
            Some(line) => self.question(caller, &line, CallStep::Start(start), now + QUESTION_TURN),
            None => return self.ask(caller, start.ask, now),
        }
        Ok(None)
    }
}
