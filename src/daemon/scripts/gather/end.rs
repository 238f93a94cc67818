//! The end of a gather: whether the board still gathers, `ENDGATHER`, and I19 as it was.

use std::time::{Duration, Instant};

use log::warn;

use super::{Begun, Gather, Phase, first, refused};
use crate::daemon::scripts::end_retry::was_set_meanwhile;
use crate::daemon::scripts::{Done, Ending, Sequence};
use crate::daemon::shared::queue::Outcome;
use crate::gather::GatherMode;
use crate::protocol::board::GatherStopReply;
use crate::protocol::{CallError, Reply};

/// How long an end tries what is known not to have been sent.
pub(super) const END_PATIENCE: Duration = Duration::from_secs(10);

impl Gather {
    /// Takes what became of a step of the end. What cannot be carried out is noted, and the end goes on.
    pub(super) fn take_of_end(&mut self, done: Done, now: Instant) {
        let gather_period = self.family.i.gather_period;
        let is_question = matches!(self.phase, Phase::AskWhetherToEnd | Phase::AskPeriodAgain);
        let can_be_tried = done.outcome.is_unsent() || is_question && done.outcome == Outcome::TimedOut;
        // A daemon that does not use the function any more follows nothing.
        let is_lost = self.phase == Phase::EndFollow && matches!(done.outcome, Outcome::Refused(_));
        if can_be_tried && !is_lost && self.phase != Phase::CheckAtEnd {
            let again = self.retry.again(done.outcome, self.call.is_some(), now);
            if again.is_some() && self.ending != Some(Ending::Stopping) {
                // Somebody may end the gather, or set another period, meanwhile.
                self.phase = match self.phase {
                    Phase::EndGather => self.first_of_end(),
                    Phase::PutBack => Phase::AskPeriodAgain,
                    phase => phase,
                };
                self.rest = again;
                return;
            }
        }
        let (phase, note) = match (self.phase, done.result) {
            (Phase::AskWhetherToEnd, Ok(lines)) => match self.gathers(&lines) {
                true => (Phase::EndGather, None),
                false if self.has_ended_early() => (Phase::CheckAtEnd, None),
                false => (Phase::EndFollow, None),
            },
            (Phase::CheckAtEnd, result) => {
                let was_reset = result.is_ok() && self.was_reset(done.resets);
                (Phase::EndFollow, Some(self.was_ended(was_reset)))
            }
            (Phase::AskWhetherToEnd, Err(error)) => (
                Phase::EndFollow,
                Some(format!(
                    "the board may still gather, it could not be asked ({error}); `pmacctl gather --stop` ends that"
                )),
            ),
            (Phase::EndGather, Ok(_)) => {
                self.ended = true;
                (Phase::EndFollow, None)
            }
            (Phase::EndGather, Err(error)) => {
                (Phase::EndFollow, Some(format!("ENDGATHER: {error}; the board may still gather")))
            }
            (Phase::EndFollow, _) => (Phase::AskPeriodAgain, None),
            (Phase::AskPeriodAgain, Ok(lines)) => {
                let found = first(&lines).to_owned();
                let ours = self.call.as_ref().map(|call| call.buffer.period.to_string());
                let is_other = self.period.as_ref().is_some_and(|old| *old != found);
                if self.period_sent && is_other && Some(&found) == ours.as_ref() {
                    (Phase::PutBack, None)
                } else {
                    let note = was_set_meanwhile(&format!("I{gather_period}"), &found);
                    self.period = Some(found);
                    (Phase::Over, (self.period_sent && is_other).then_some(note))
                }
            }
            (Phase::PutBack, Ok(_)) => (Phase::Over, None),
            (Phase::AskPeriodAgain | Phase::PutBack, Err(error)) => {
                let old = self.period.as_deref().unwrap_or_default();
                let note =
                    format!("I{gather_period}={old}: {error}; I{gather_period} may not be {old} again");
                (Phase::Over, self.period_sent.then_some(note))
            }
            (phase, _) => (phase, None),
        };
        self.phase = phase;
        self.notes.extend(note);
    }

    /// What has ended the gather: a reset of the board, or who did; what may have, where that is not known.
    pub(super) fn was_ended(&self, was_reset: bool) -> String {
        match (was_reset, self.ended_by.as_deref()) {
            (true, Some(by)) => format!("the board was reset, which ended the gather: {by}"),
            (true, None) => "the board was reset, which ended the gather".to_owned(),
            (false, Some(by)) => format!("the board gathers no more: {by}"),
            (false, None) => "the board gathers no more, and no client of pmacd ended that: the serial port, another host or a program \
                              of the board did, or the board was reset"
                .to_owned(),
        }
    }

    /// Whether a gather that goes round and round is over, though nobody has said why.
    fn has_ended_early(&self) -> bool {
        let wraps = self.call.as_ref().is_some_and(|call| call.buffer.mode == GatherMode::Wrap);
        wraps && self.started && self.failure.is_none()
    }

    /// Whether nothing but the end follows.
    pub(super) fn phase_is_of_end(&self) -> bool {
        use Phase::{AskPeriodAgain, AskWhetherToEnd, CheckAtEnd, EndFollow, EndGather, Over, PutBack};
        matches!(
            self.phase,
            AskWhetherToEnd | CheckAtEnd | EndGather | EndFollow | AskPeriodAgain | PutBack | Over
        )
    }

    /// The first phase of the end.
    pub(super) fn first_of_end(&self) -> Phase {
        match self.begun {
            // What was started last is the report, by this gather: that is undone.
            Begun::Report => Phase::EndGather,
            // A full buffer ends its gather, and so may somebody else: what ENDGATHER would end then is the servo report.
            Begun::Gathering => Phase::AskWhetherToEnd,
            // `GATHER` did not go: nothing comes into the buffer that is followed.
            Begun::Nothing if self.followed => Phase::EndFollow,
            Begun::Nothing if self.period_sent => Phase::AskPeriodAgain,
            Begun::Nothing => Phase::Over,
        }
    }

    /// What the owner is told in the end.
    pub(super) fn result(&mut self) -> Result<Reply, CallError> {
        let mut notes = std::mem::take(&mut self.notes);
        notes.extend(self.unfinished());
        notes.iter().for_each(|note| warn!("the end of a gather: {note}"));
        match self.failure.take() {
            Some(CallError::Refused { reason }) if !notes.is_empty() => {
                Err(refused(format!("{reason}; {}", notes.join("; "))))
            }
            Some(error) => Err(error),
            None if self.call.is_some() && !self.started => {
                let why = self.ending.map_or_else(String::new, |why| why.to_string());
                Err(refused(format!("the gather was ended before it began: {why}")))
            }
            None => Reply::with(&GatherStopReply {
                gathered: self.call.is_some() || self.ended,
                uid: self.owner.uid.as_raw(),
                pid: self.owner.pid,
                reason: self.ending.map(|why| why.to_string()),
                period: self.period.clone(),
                notes,
            }),
        }
    }
}
