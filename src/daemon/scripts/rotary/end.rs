//! The end of a rotary stream: the buffers closed, the program ended if it is not whole, and what is left in the buffers
//! counted.

use std::time::{Duration, Instant};

use log::warn;

use super::count::lines_left;
use super::{Phase, Rotary, refused};
use crate::daemon::scripts::{Done, Ending, Sequence};
use crate::daemon::shared::queue::Outcome;
use crate::protocol::board::RotaryStopReply;
use crate::protocol::{CallError, Reply};

/// How long the end tries what is known not to have been sent.
pub(super) const END_PATIENCE: Duration = Duration::from_secs(2);
/// How often to look whether `Q` has ended the program, and how long between two looks.
const ENDED_LOOKS: u32 = 4;
const ENDED_LOOK: Duration = Duration::from_millis(100);

impl Rotary {
    /// Takes what became of a step of the end. What cannot be carried out is noted, and the end goes on.
    pub(super) fn take_of_end(&mut self, done: Done, now: Instant) -> Phase {
        let cs = self.call.coordinate_system;
        // Another buffer is open, so the rotary buffers are closed: one is open at a time.
        let is_closed = self.phase == Phase::Close && matches!(done.outcome, Outcome::Barred(_));
        // A reset has taken the buffer, and with it the lines that waited.
        let is_lost = matches!(self.phase, Phase::DropLines | Phase::SeeAhead)
            && matches!(done.outcome, Outcome::Refused(_));
        if done.outcome.is_unsent()
            && !is_closed
            && !is_lost
            && self.ending != Some(Ending::Stopping)
            && let Some(again) = self.retry.again(done.outcome, now)
        {
            return self.rest_before(self.phase, again);
        }
        let failed = |what: &str| done.result.as_ref().err().map(|error| format!("{what} failed ({error})"));
        let (phase, note) = match self.phase {
            Phase::Close => {
                self.opened = false;
                let note = failed("CLOSE").filter(|_| !is_closed).map(|note| {
                    format!("{note}, so the rotary buffers may still be open, and take what is in the DPRAM: send CLOSE")
                });
                (Phase::EndTransfer, note)
            }
            Phase::EndTransfer => (Phase::DropLines, failed("the end of the transfer")),
            Phase::DropLines => (Phase::SeeAhead, None),
            Phase::SeeAhead => {
                self.see(done.rotary);
                (Phase::AskRuns, None)
            }
            Phase::AskRuns => {
                let runs = done.result.as_ref().ok().and_then(|lines| self.is_running(lines, 0));
                match runs {
                    _ if self.is_whole() => {
                        self.runs |= runs != Some(false);
                        (Phase::AskLeftAtEnd, None)
                    }
                    Some(false) => (Phase::AskLeftAtEnd, None),
                    // What cannot be asked is ended all the same: Q starts nothing.
                    Some(true) | None => (Phase::Quit, None),
                }
            }
            Phase::Quit => {
                self.quit = done.result.is_ok();
                let note =
                    failed(&format!("&{cs}Q")).map(|note| format!("{note}: the program may still run"));
                (if self.quit { Phase::AskEnded(1) } else { Phase::AskLeftAtEnd }, note)
            }
            Phase::AskEnded(times) => {
                let runs = done.result.as_ref().ok().and_then(|lines| self.is_running(lines, 0));
                if runs == Some(true) && times < ENDED_LOOKS && self.ending != Some(Ending::Stopping) {
                    return self.rest_before(Phase::AskEnded(times + 1), now + ENDED_LOOK);
                }
                self.quit = runs != Some(true);
                let note = format!(
                    "&{cs}Q was sent, and the program still runs: the moves that are calculated come first, and in a feed hold they \
                     wait for &{cs}R; &{cs}A ends it at once"
                );
                (Phase::AskLeftAtEnd, (!self.quit).then_some(note))
            }
            Phase::AskLeftAtEnd => {
                self.left = done.result.as_ref().ok().and_then(|lines| lines_left(lines).ok());
                if self.started && matches!(done.outcome, Outcome::Error(_)) {
                    let by = self.ended_by.as_deref().unwrap_or("the board was reset");
                    self.failure = Some(refused(format!(
                        "{by}: &{cs} has no rotary buffer any more, which it had when the stream began"
                    )));
                } else if self.is_whole() {
                    self.count.told = self.left;
                    let doubt = match (self.runs, self.call.run) {
                        (true, _) => self.count.surplus(cs),
                        (false, false) => self.count.doubt(self.count, cs),
                        (false, true) => {
                            Some(format!("the stream was ended before R could be sent; &{cs}R runs it"))
                        }
                    };
                    self.failure = doubt.map(refused);
                }
                (Phase::Over, None)
            }
            phase => (phase, None),
        };
        self.notes.extend(note);
        phase
    }

    /// What the owner is told in the end.
    pub(super) fn result(&mut self) -> Result<Reply, CallError> {
        let mut notes = std::mem::take(&mut self.notes);
        notes.extend(self.unfinished());
        notes.iter().for_each(|note| warn!("the end of a rotary stream: {note}"));
        let ended = |when: &str| self.ending.map(|why| format!("the stream was ended{when}: {why}"));
        if !self.started {
            let before = ended(" before it began").unwrap_or_default();
            let error = self.failure.take().unwrap_or_else(|| refused(before));
            return Err(match error {
                CallError::Refused { reason } if !notes.is_empty() => {
                    refused(format!("{reason}; {}", notes.join("; ")))
                }
                error => error,
            });
        }
        Reply::with(&RotaryStopReply {
            reason: self.failure.as_ref().map(ToString::to_string).or_else(|| ended("")),
            ahead_lines: self.ahead,
            left_lines: self.left,
            quit: self.quit,
            notes,
        })
    }
}
