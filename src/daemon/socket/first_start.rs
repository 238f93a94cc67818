//! Asks which lines are left in the rotary buffers before a start would run them.
//!
//! `PR` tells how many lines are left, and is an error where no rotary buffer is defined (Turbo Software Reference p.
//! 286). If a board answered an error for a buffer with lines in it, the board would run them anyway; the question
//! loses nothing. All senders share the address that `&n` changes (User Manual p. 29), so each line puts it back. After
//! an error the daemon does not know how much of the line the board has carried out, so another line puts the address
//! back.

use super::methods::Ask;
use crate::daemon::motion::leftovers::start_anyway;
use crate::daemon::scripts::lines_left;
use crate::daemon::shared::queue::{LINE_MAX, Outcome, Text};
use crate::map::Systems;
use crate::protocol::{CallError, answer};

/// A start that waits for the board's answers.
#[derive(Debug)]
pub(super) struct FirstStart {
    /// The client's request.
    pub ask: Ask,
    /// The coordinate systems to ask about, from the one whose question is under way on.
    systems: Systems,
    addressed: Option<usize>,
    /// The daemon has to put the address back.
    is_astray: bool,
}

impl FirstStart {
    /// Asks which coordinate system the board addresses.
    pub(super) const QUESTION: &str = "&";

    /// `ask` starts the programs of `systems`, and maybe others.
    pub(super) const fn new(ask: Ask, systems: Systems) -> Self {
        Self { ask, systems, addressed: None, is_astray: false }
    }

    /// Takes the board's answer. Returns the coordinate system of the answer, and how many lines are left there.
    ///
    /// # Errors
    /// The board did not say.
    pub(super) fn take(
        &mut self,
        outcome: Outcome,
        reply: Result<Vec<String>, CallError>,
    ) -> Result<Option<(Systems, u64)>, CallError> {
        if self.addressed.is_none() {
            let addressed = reply?.first().and_then(|line| answer::integer(line));
            self.addressed = addressed.and_then(|number| usize::try_from(number).ok());
            let unsaid = || CallError::refused("the board does not say which coordinate system is addressed");
            return self.addressed.map(|_| None).ok_or_else(unsaid);
        }
        let Some(system) = self.systems.numbers().next().map(Systems::of) else {
            self.is_astray = false;
            return Ok(None);
        };
        let is_refused = matches!(outcome, Outcome::Error(_));
        self.is_astray |= is_refused;
        let left = if is_refused { 0 } else { lines_left(&reply?)? };
        self.systems.remove(system);
        Ok(Some((system, left)))
    }

    /// The next line; `None`: the daemon knows everything.
    pub(super) fn line(&self) -> Option<Text<LINE_MAX>> {
        let addressed = self.addressed.unwrap_or_default();
        match self.systems.numbers().next() {
            None => self.is_astray.then(|| Text::of(&format_args!("&{addressed}"))),
            Some(number) if number == addressed => Some(Text::of(&format_args!("&{number}PR"))),
            Some(number) => Some(Text::of(&format_args!("&{number}PR&{addressed}"))),
        }
    }

    /// Why the daemon does not start the programs: the board did not say what is left, for this `reason`.
    pub(super) fn unknown(&self, reason: &CallError) -> CallError {
        let cs = self.systems.bits().trailing_zeros() + 1;
        CallError::refused(format_args!(
            "not started: &{cs}'s rotary buffer may hold lines of an earlier program, and the board could not be \
             asked ({reason}). {} runs whatever is there",
            start_anyway(cs)
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::motion::effect::Starts;

    #[test]
    fn each_question_puts_the_address_back_after_an_error_too() {
        let starts = Starts { systems: Systems::ALL, confirmed: false };
        let asked = [1, 2, 3, 9].into_iter().collect();
        let mut start = FirstStart::new(Ask::Control { character: 18, keeps_lines: false, starts }, asked);
        let error = CallError::Board { code: 3, meaning: String::new(), lines: Vec::new() };
        let mut lines = vec![FirstStart::QUESTION.to_owned()];
        let mut found = Vec::new();
        for reply in ["2", "0", "7", "", "4", ""] {
            let (outcome, reply) = match reply {
                "" => (Outcome::Error(3), Err(error.clone())),
                number => (Outcome::Done, Ok(vec![number.to_owned()])),
            };
            found.extend(start.take(outcome, reply).unwrap());
            lines.extend(start.line().map(|line| line.to_string()));
        }
        assert_eq!(lines, ["&", "&1PR&2", "&2PR", "&3PR&2", "&9PR&2", "&2"]);
        assert_eq!(found, [(1, 0), (2, 7), (3, 0), (9, 4)].map(|(number, left)| (Systems::of(number), left)));
        assert!(start.line().is_none());
    }

    #[test]
    fn what_the_board_does_not_say_is_no_answer() {
        for (addressed, left) in [("", None), ("x", None), ("1", Some("1.5")), ("1", Some("-1"))] {
            let reply = |text: &str| Ok(vec![text.to_owned()]);
            let ask = Ask::Control { character: 18, keeps_lines: false, starts: Starts::default() };
            let mut start = FirstStart::new(ask, Systems::of(1));
            let said = start.take(Outcome::Done, reply(addressed));
            let said = left.map_or(said, |left| start.take(Outcome::Done, reply(left)));
            let told = start.unknown(&said.unwrap_err()).to_string();
            assert!(told.contains("not started: &1's rotary buffer may hold"), "{told}");
        }
    }
}
