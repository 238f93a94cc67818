//! The end of a rotary stream: closes the buffers, ends the program if it is not whole, and counts the lines left in
//! the board's buffer.

use std::time::Duration;

use log::warn;

use super::Rotary;
use super::count::lines_left;
use crate::daemon::scripts::end_retry::EndRetry;
use crate::daemon::scripts::{Done, Ending, Request, with_notes};
use crate::daemon::shared::job::Job;
use crate::daemon::shared::queue::{Line, Outcome};
use crate::protocol::board::RotaryStopReply;
use crate::protocol::{CallError, Reply};

/// How long the end repeats steps that the daemon has certainly not sent.
const END_PATIENCE: Duration = Duration::from_secs(2);
/// How often the daemon asks whether `Q` has ended the program, and the pause between two questions.
const ENDED_LOOKS: u32 = 4;
const ENDED_LOOK: Duration = Duration::from_millis(100);

impl Rotary<'_> {
    /// The end. It notes a step that fails, and goes on.
    pub(super) async fn end(&mut self) -> Result<Reply, CallError> {
        if self.io.take_asked() || self.answer_by.is_some() {
            // The owner's next call, `RotaryStop`, hears how the stream has ended.
            self.io.answer(Ok(Reply::done())).await;
        }
        let mut retry = EndRetry::new(END_PATIENCE, true);
        self.close(&mut retry).await;
        if self.set_up {
            self.end_program(&mut retry).await;
            self.count_left(&mut retry).await;
        }
        self.io.set_unfinished(None);
        if self.started {
            self.io.leaves(if self.is_whole() { 0 } else { self.left.unwrap_or_default() });
        }
        self.result()
    }

    /// Takes back the lines that are not in the DPRAM yet, and keeps the board from those that are. The last stream closes
    /// the rotary buffers and ends the transfer.
    async fn close(&mut self, retry: &mut EndRetry) {
        if self.enters.is_some() && self.entry.leave() {
            self.close_entry(retry).await;
            self.entry.closed();
        }
        if self.set_up {
            let buffer = self.call.buffer;
            // A reset has taken the buffer, and with it the lines that waited.
            let is_lost = |outcome| matches!(outcome, Outcome::Refused(_));
            let job = |job| Request::Job(Box::new(job));
            self.end_step(retry, job(Job::RotaryFinish(buffer)), is_lost).await;
            let seen = self.end_step(retry, job(Job::RotaryState(buffer)), is_lost).await;
            self.see(seen.rotary);
            if !is_lost(seen.outcome) && seen.rotary.is_none_or(|state| state.ahead_lines > 0) {
                // Another stream may have switched the transfer on, or do so later.
                let closed = self.end_step(retry, job(Job::RotaryClose(buffer)), is_lost).await;
                self.notes.extend(closed.result.err().filter(|_| !is_lost(closed.outcome)).map(|error| {
                    format!("the DPRAM's buffer may still be in use ({error}): beside other streams the board may take its lines")
                }));
                // When the board has answered a line, it has seen that.
                self.end_step(retry, line("???"), |_| false).await;
                let seen = self.end_step(retry, job(Job::RotaryState(buffer)), is_lost).await;
                self.see(seen.rotary);
            }
        }
    }

    async fn close_entry(&mut self, retry: &mut EndRetry) {
        if self.opened {
            // Another buffer is open, so the rotary buffers are closed: one is open at a time.
            let is_closed = |outcome| matches!(outcome, Outcome::Barred(_));
            let closed = self.end_step(retry, line("CLOSE"), is_closed).await;
            self.opened = false;
            if let Err(error) = closed.result
                && !is_closed(closed.outcome)
            {
                self.notes.push(format!(
                    "CLOSE failed ({error}), so the rotary buffers may still be open, and take what is in the DPRAM: send CLOSE"
                ));
            }
        }
        if self.switched {
            let ended = self.end_step(retry, line(&self.switch(0)), |_| false).await;
            self.notes
                .extend(ended.result.err().map(|error| format!("the end of the transfer failed ({error})")));
        }
    }

    /// Ends the program if it runs and is not whole.
    async fn end_program(&mut self, retry: &mut EndRetry) {
        if self.runs == self.is_whole() {
            return;
        }
        let runs = self.ask_runs_at_end(retry).await;
        if self.is_whole() {
            self.runs |= runs != Some(false);
        } else if runs != Some(false) {
            // If the board does not answer, the daemon sends Q all the same: Q starts nothing.
            self.send_quit(retry).await;
        }
    }

    async fn send_quit(&mut self, retry: &mut EndRetry) {
        let cs = self.call.coordinate_system;
        let sent = self.end_step(retry, line(&format!("&{cs}Q")), |_| false).await;
        self.quit = sent.result.is_ok();
        if let Err(error) = sent.result {
            return self.notes.push(format!("&{cs}Q failed ({error}): the program may still run"));
        }
        for looks in 1.. {
            let still_runs = self.ask_runs_at_end(retry).await == Some(true);
            if still_runs && looks < ENDED_LOOKS && self.io.ending() != Some(Ending::Stopping) {
                self.io.rest(ENDED_LOOK).await;
                continue;
            }
            self.quit = !still_runs;
            break;
        }
        if !self.quit {
            self.notes.push(format!(
                "&{cs}Q was sent, and the program still runs: the moves that are calculated come first, and in a feed hold they \
                 wait for &{cs}R; &{cs}A ends it at once"
            ));
        }
    }

    async fn ask_runs_at_end(&mut self, retry: &mut EndRetry) -> Option<bool> {
        let question = line(&format!("&{}??", self.call.coordinate_system));
        let asked = self.end_step(retry, question, |_| false).await;
        self.is_running(&asked.result.ok()?, 0)
    }

    /// Asks the board how many lines are left in its own buffer, and compares the number with the lines that the board
    /// took.
    async fn count_left(&mut self, retry: &mut EndRetry) {
        let cs = self.call.coordinate_system;
        let asked = self.end_step(retry, line(&format!("&{cs}PR")), |_| false).await;
        self.left = asked.result.ok().and_then(|lines| lines_left(&lines).ok());
        if self.started && matches!(asked.outcome, Outcome::Error(_)) {
            let by = self.io.ended_by();
            self.failure = Some(CallError::refused(format!(
                "{}: &{cs} has no rotary buffer any more, which it had when the stream began",
                by.as_deref().unwrap_or("the board was reset")
            )));
        } else if self.is_whole() {
            self.count.told = self.left;
            let doubt = match (self.runs, self.call.run) {
                (true, _) => self.count.surplus(cs),
                (false, false) => self.count.doubt(self.count, cs),
                (false, true) => Some(format!("the stream was ended before R could be sent; &{cs}R runs it")),
            };
            self.failure = doubt.map(CallError::refused);
        }
    }

    /// Carries out a step of the end, again and again while the daemon has certainly not sent it and its outcome is not
    /// `is_final`.
    async fn end_step(
        &mut self,
        retry: &mut EndRetry,
        request: Request,
        is_final: impl Fn(Outcome) -> bool,
    ) -> Done {
        let io = self.io.clone();
        loop {
            let done = io.request(request.clone()).await;
            let may_go = done.outcome.is_unsent() && !is_final(done.outcome);
            if !may_go || !retry.rests(&io, done.outcome, self.unfinished(), || self.result()).await {
                return done;
            }
        }
    }

    /// The part of the end that an open program buffer keeps back.
    fn unfinished(&self) -> Option<String> {
        let cs = self.call.coordinate_system;
        let program = if self.runs {
            format!("&{cs} may still run it (abort {cs} ends that); ")
        } else {
            String::new()
        };
        Some(format!(
            "the end of the rotary stream into &{cs} is not carried out; {program}pmacd goes on when the open program buffer is \
             closed"
        ))
    }

    /// The owner's reply in the end.
    fn result(&mut self) -> Result<Reply, CallError> {
        let mut notes = std::mem::take(&mut self.notes);
        notes.extend(self.io.unfinished());
        notes.iter().for_each(|note| warn!("the end of a rotary stream: {note}"));
        let ended = |when: &str| self.io.ending().map(|why| format!("the stream was ended{when}: {why}"));
        if !self.started {
            let before = ended(" before it began").unwrap_or_default();
            let error = self.failure.take().unwrap_or_else(|| CallError::refused(before));
            return Err(with_notes(error, &notes));
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

fn line(text: &str) -> Request {
    Request::Line(Line::of(text))
}
