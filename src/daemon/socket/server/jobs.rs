//! The calls that ask for a job: the daemon checks the job's guard on the board before the job; for a stop, after it.

use std::time::Instant;

use super::Service;
use super::replies::{Answered, hold_over};
use crate::daemon::motion::stops::{At, Stop};
use crate::daemon::motion::target::Target;
use crate::daemon::shared::job::Job;
use crate::daemon::shared::queue::{Command, Outcome};
use crate::daemon::socket::call_step::CallStep;
use crate::daemon::socket::call_table::{Caller, Then};
use crate::daemon::socket::heard::Heard;
use crate::daemon::socket::jobs::{JobAt, JobCall};
use crate::protocol::Reply;
use crate::protocol::board::NotesReply;

impl Service {
    /// Has the bus thread do a job, or checks the guard on the board first. If the daemon cannot ask the board, the
    /// job's own outcome decides; with command lines switched off, the caller has to see to the job's needs.
    pub(super) fn ask_job(&mut self, caller: Caller, mut call: Box<JobCall>, now: Instant) -> Answered {
        if let Some(buffer) = call.feeds {
            self.own_stream(caller, buffer)?;
        }
        if let Some(guard) = call.guard {
            let is_known = guard.is_known(self.info.enabling(), now);
            let asks = self.answers() && (call.has_question() || !is_known);
            if asks && !call.stops {
                return self.ask_about(caller, call, now);
            }
            if !asks && !is_known {
                call.note_unasked(guard);
            }
            if !asks && (call.stops || !is_known) {
                call.guard = None;
            }
        }
        self.do_job(caller, call, now)
    }

    /// Asks the board whether it meets the needs of `call`.
    fn ask_about(&mut self, caller: Caller, call: Box<JobCall>, now: Instant) -> Answered {
        if let Some(guard) = call.guard {
            let (question, deadline) = (call.question(guard), now + call.timeout);
            self.question(caller, &question, CallStep::Job(call), deadline);
        }
        Ok(None)
    }

    /// Has the bus thread do a job without a question to the board.
    fn do_job(&mut self, caller: Caller, mut call: Box<JobCall>, now: Instant) -> Answered {
        let deadline = now + call.timeout;
        self.may_start(call.starts)?;
        // A stop names no motors here, so this check never refuses one.
        self.spares_holds(caller.client, call.moves)?;
        let JobAt::Wanted(mut job) = std::mem::replace(&mut call.at, JobAt::UnderWay) else {
            return Ok(None);
        };
        if let Some(motors) = call.lease {
            // The hold begins now: the client may go before the board has taken the jog.
            self.ledger.hold(caller.client, caller.peer.account(), motors, deadline);
        }
        let audit = call.audit.take();
        let then = match call.target {
            None => Then::Call(CallStep::Job(call)),
            Some(target) => {
                let mut ends_hold = false;
                if let Target::Motors(stops) = target {
                    let stop_for = self.ledger.stop_for(caller.client, stops, now);
                    ends_hold = stop_for.map_err(|end| hold_over(Some(end)))?;
                    if ends_hold {
                        job = Job::EndHold(stops);
                    }
                }
                let stop = Stop::new(target, Some(caller), ends_hold, At::CallersPanel, now);
                Then::Stop(self.stops.begin(stop))
            }
        };
        let job = Box::new(job);
        self.wait_for_board(caller, deadline, then, audit, |ticket| Command::Job { ticket, job, deadline });
        Ok(None)
    }

    /// Goes on after the bus thread's job, or after a question to the board about it, whether done or failed.
    pub(super) fn job_step(&mut self, mut call: Box<JobCall>, heard: Heard, now: Instant) -> Answered {
        let caller = heard.caller;
        match call.at {
            JobAt::Wanted(_) => {
                call.take_answers(heard.answers(now)?.as_deref())?;
                self.do_job(caller, call, now)
            }
            JobAt::UnderWay => self.job_done(call, heard, now),
            JobAt::Done => {
                Reply::with(&NotesReply { notes: call.into_notes(heard.remarks().as_deref()) }).map(Some)
            }
            JobAt::Failed(failed) => {
                let why = call.guard.and_then(|guard| guard.check(heard.remarks().as_deref()).err());
                Err(match why {
                    Some(why) => failed.because(&why),
                    None => failed,
                })
            }
        }
    }

    fn job_done(&mut self, mut call: Box<JobCall>, heard: Heard, now: Instant) -> Answered {
        let Heard { caller, outcome, .. } = heard;
        let is_held = call.lease.is_some();
        // The jog has begun: the holder's time runs from here.
        let renewed = is_held && !heard.is_given_up;
        let renewed = if renewed { self.ledger.renew(caller.client, now) } else { Ok(()) };
        let result = heard.lines(now);
        let asks = call.guard.is_some()
            && match outcome {
                Outcome::Done => call.stops,
                // The daemon assumed that the board would take the job. Another host may have switched the function
                // off.
                Outcome::Refused(_) | Outcome::Interrupted(_) => !is_held && !call.stops && self.answers(),
                _ => false,
            };
        if asks {
            call.at = result.map_or_else(JobAt::Failed, |_| JobAt::Done);
            return self.ask_about(caller, call, now);
        }
        result?;
        renewed.map_err(hold_over)?;
        call.notes.map_or_else(|| Ok(Reply::done()), |notes| Reply::with(&NotesReply { notes })).map(Some)
    }
}
