//! A gather: what is asked first, the lines that begin it, and what its end puts back.
//!
//! With I48=1 the first `GATHER` starts the servo report and the second one gathering; `ENDGATHER` undoes the latest one (DPRAM
//! manual p. 14). So the number of `GATHER`s depends on whether the report runs, which its timer shows, and `ENDGATHER` is
//! sent only where the board says that it gathers: sent once too often it ends everybody's servo data. A Turbo board reports without
//! `GATHER` (Turbo User Manual p. 403), and its I5049 is the period of gathering alone.
//! The period of gathering (I19) is the servo report's as well. It is put back, unless somebody has set another one
//! meanwhile, or a reset has. While somebody has a program buffer open the line would enter that: it is sent when the buffer is
//! closed, however long that takes, and nobody waits for it.
//!
//! While it gathers, the servo report tells whether the board still does. Where no report tells, the board is asked.

mod call;
mod end;

use std::time::{Duration, Instant};

pub use self::call::GatherCall;
use super::end_retry::{EndRetry, is_kept_back};
use super::report_watch::{ReportWatch, Seen};
use super::{Done, END_STEP, Ending, Resource, Sequence, SequenceCall, Step, ask, line};
use crate::daemon::shared::job::Job;
use crate::daemon::shared::peer::Peer;
use crate::gather::GatherMode;
use crate::map::status::reply_has;
use crate::map::{Family, ReportStart};
use crate::mirror::GatherClock;
use crate::protocol::{CallError, Reply, answer};

/// How long the board may take for a line, and the daemon for a job.
const STEP: Duration = Duration::from_secs(5);
/// How long a report that may run is waited for, beyond two of its periods.
const REPORT_PAUSE: Duration = Duration::from_secs(1);
/// How long the first `GATHER` may take to start the report, beyond two periods.
const REPORT_START: Duration = Duration::from_secs(5);
/// The longest time that two periods of the report may take: a report that comes seldom cannot be waited for.
const LONGEST_REPORT: Duration = Duration::from_secs(30);
/// How often to look whether the board still gathers, and whether it was reset.
const LOOK: Duration = Duration::from_millis(500);
/// How long the board may take to say that it gathers. One that is reset meanwhile answers nothing for a while.
const ASKING: Duration = Duration::from_secs(1);
const CHECK_EVERY: Duration = Duration::from_secs(60);

/// How far it is: what is asked of the board, or waited for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// The first check for resets.
    FirstCheck,
    AskReport,
    AskPeriod,
    AskGathers,
    /// Whether the report runs.
    SeeReport(ReportWatch),
    /// The line of this index.
    Prepare(usize),
    /// The `GATHER` that starts the report.
    StartReport,
    AwaitReport(ReportWatch),
    /// The daemon follows the buffer.
    Follow,
    /// The `GATHER` that starts gathering.
    Start,
    Gathering,
    /// What the report tells of it.
    Look,
    /// No report tells: the board does.
    AskStill,
    /// Whether the board has been reset, by the way or because it gathers no more.
    Check {
        stopped: bool,
    },
    /// The buffer is full, as it was asked for.
    Full,
    /// The end: whether it still gathers.
    AskWhetherToEnd,
    /// It gathers no more, and nobody has said why: whether it was reset.
    CheckAtEnd,
    EndGather,
    EndFollow,
    AskPeriodAgain,
    PutBack,
    Over,
}

/// What the latest `GATHER` has begun.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Begun {
    Nothing,
    Report,
    Gathering,
}

/// The sequence.
#[derive(Debug)]
pub struct Gather {
    family: &'static Family,
    owner: Peer,
    /// `None` where nothing is begun, but what somebody began by hand is ended.
    call: Option<GatherCall>,
    phase: Phase,
    /// I48 is 1, on a board whose report GATHER starts.
    reports: bool,
    /// The report's timer was seen to go on.
    report_runs: bool,
    /// I19 as it was found, and as it is at the end.
    period: Option<String>,
    period_sent: bool,
    begun: Begun,
    followed: bool,
    /// Its owner has heard that it gathers.
    started: bool,
    /// The report has told that it gathers.
    was_seen: bool,
    /// The resets that the first check told of, and when the next one is due.
    resets: Option<u64>,
    check_due: Option<Instant>,
    /// `ENDGATHER` was sent.
    ended: bool,
    stop_asked: bool,
    ending: Option<Ending>,
    /// The client who has ended it, as far as known.
    ended_by: Option<String>,
    failure: Option<CallError>,
    notes: Vec<String>,
    /// When to go on with an end that cannot be carried out now.
    rest: Option<Instant>,
    retry: EndRetry,
}

impl Gather {
    /// Begins a gather of `owner`.
    pub fn new(call: GatherCall, owner: Peer) -> Self {
        Self::at(Phase::FirstCheck, call.family, owner, Some(call))
    }

    /// Ends what the board gathers, whoever began it: `owner` asks for that.
    pub fn stop(family: &'static Family, owner: Peer) -> Self {
        let begun = Begun::Gathering;
        Self { begun, stop_asked: true, ..Self::at(Phase::AskWhetherToEnd, family, owner, None) }
    }

    fn at(phase: Phase, family: &'static Family, owner: Peer, call: Option<GatherCall>) -> Self {
        Self {
            family,
            owner,
            call,
            phase,
            reports: false,
            report_runs: false,
            period: None,
            period_sent: false,
            begun: Begun::Nothing,
            followed: false,
            started: false,
            was_seen: false,
            resets: None,
            check_due: None,
            ended: false,
            stop_asked: false,
            ending: None,
            ended_by: None,
            failure: None,
            notes: Vec::new(),
            rest: None,
            retry: EndRetry::new(end::END_PATIENCE),
        }
    }

    /// Takes what became of the step of this phase.
    ///
    /// # Errors
    /// Why there will be no gather.
    fn take(&mut self, mut done: Done, now: Instant) -> Result<(), CallError> {
        let i = &self.family.i;
        self.ended_by = done.ended_by.take();
        let unsent = done.outcome.is_unsent();
        match self.phase {
            Phase::FirstCheck => {
                // Of a board that cannot be asked now, a later reset cannot be known from an earlier one.
                self.resets = done.result.is_ok().then_some(done.resets);
                self.check_due = Some(now + CHECK_EVERY);
                self.phase = Phase::AskReport;
            }
            Phase::AskReport => {
                let is_on = first(&done.result?) == "1";
                self.reports = is_on && self.family.servo.start == ReportStart::Gather;
                if self.reports && self.call.as_ref().is_some_and(|call| !call.uses_report) {
                    // A board that reports takes another number of GATHERs than one that does not.
                    return Err(refused(format!(
                        "I{}=1, and gathering then takes the function `servo`, which is switched off: `functions` in the \
                         daemon's configuration leaves it out",
                        i.servo_enable
                    )));
                }
                self.phase = Phase::AskPeriod;
            }
            Phase::AskPeriod => {
                self.period = Some(first(&done.result?).to_owned());
                self.check_report_is_frequent()?;
                self.phase = Phase::AskGathers;
            }
            Phase::AskGathers => {
                if self.gathers(&done.result?) {
                    return Err(refused(
                        "the board gathers already, and no client of this pmacd began that: it was begun by hand, on the serial port, \
                         by another host, or through a pmacd that was killed; `pmacctl gather --stop` ends it",
                    ));
                }
                let watch = ReportWatch::new(now + REPORT_PAUSE + self.two_periods());
                self.phase = if self.reports { Phase::SeeReport(watch) } else { Phase::Prepare(0) };
            }
            Phase::SeeReport(mut watch) => match watch.see(&done, now) {
                Seen::Nothing => self.rest_on(Phase::SeeReport(watch), now + ReportWatch::LOOK),
                seen => {
                    self.report_runs = seen == Seen::Runs;
                    self.phase = Phase::Prepare(0);
                }
            },
            Phase::Prepare(index) => {
                done.result.map_err(|error| self.explain(index, error))?;
                let lines = self.call.as_ref().map_or(0, |call| call.lines.len());
                self.phase = match (index + 1 < lines, self.reports && !self.report_runs) {
                    (true, _) => Phase::Prepare(index + 1),
                    (false, true) => Phase::StartReport,
                    (false, false) => Phase::Follow,
                };
            }
            Phase::StartReport => {
                if !unsent {
                    self.begun = Begun::Report;
                }
                done.result?;
                self.phase = Phase::AwaitReport(ReportWatch::new(now + REPORT_START + self.two_periods()));
            }
            Phase::AwaitReport(mut watch) => match watch.see(&done, now) {
                Seen::Nothing => self.rest_on(Phase::AwaitReport(watch), now + ReportWatch::LOOK),
                Seen::Runs => self.phase = Phase::Follow,
                Seen::Stands => {
                    let reported =
                        i.reported.map_or_else(String::new, |number| format!(" (is I{number} above 0?)"));
                    return Err(refused(format!(
                        "I{}=1 and GATHER start no servo report{reported}, so turns of the buffer cannot be counted",
                        i.servo_enable
                    )));
                }
            },
            Phase::Follow => {
                self.followed = !unsent;
                done.result?;
                self.phase = Phase::Start;
            }
            Phase::Start => {
                if !unsent {
                    self.begun = Begun::Gathering;
                }
                done.result?;
                self.phase = Phase::Gathering;
            }
            Phase::Look => match done.gathers {
                Some(true) => {
                    self.was_seen = true;
                    self.goes_on(now);
                }
                Some(false) if self.was_seen => self.phase = Phase::Check { stopped: true },
                // It may be a report from before GATHER.
                Some(false) | None => self.phase = Phase::AskStill,
            },
            Phase::AskStill => match done.result {
                Ok(lines) if !self.gathers(&lines) => self.phase = Phase::Check { stopped: true },
                Ok(_) => self.goes_on(now),
                // Nothing is known: it cannot be asked now.
                Err(_) => self.rest_on(Phase::Look, now + LOOK),
            },
            Phase::Check { stopped } => {
                self.check_due = Some(now + CHECK_EVERY);
                if done.result.is_ok() && self.was_reset(done.resets) {
                    return Err(refused(self.was_ended(true)));
                }
                match (stopped, self.call.as_ref().map(|call| call.buffer.mode)) {
                    (false, _) => self.rest_on(Phase::Look, now + LOOK),
                    (true, Some(GatherMode::Stop)) => self.phase = Phase::Full,
                    (true, _) => return Err(refused(self.was_ended(false))),
                }
            }
            Phase::Gathering | Phase::Full | Phase::Over => {}
            _ => self.take_of_end(done, now),
        }
        Ok(())
    }

    /// Waits until then before the next look.
    fn rest_on(&mut self, phase: Phase, until: Instant) {
        self.phase = phase;
        self.rest = Some(until);
    }

    /// The board gathers.
    fn goes_on(&mut self, now: Instant) {
        match self.check_due {
            Some(due) if now >= due => self.phase = Phase::Check { stopped: false },
            _ => self.rest_on(Phase::Look, now + LOOK),
        }
    }

    /// Whether the board, of which so many `resets` are known, was reset since the check before.
    fn was_reset(&mut self, resets: u64) -> bool {
        self.resets.replace(resets).is_some_and(|before| before != resets)
    }

    /// Whether the report comes so often that it can be waited for.
    ///
    /// # Errors
    /// It does not.
    fn check_report_is_frequent(&self) -> Result<(), CallError> {
        let two = self.two_periods();
        if !self.reports || two <= LONGEST_REPORT {
            return Ok(());
        }
        let (i, found) = (&self.family.i, self.period.as_deref().unwrap_or_default());
        let ours = self.call.as_ref().map_or(0, |call| call.buffer.period);
        Err(refused(format!(
            "the servo report would come once in {} s (I{} is {found}, this gather takes {ours}), and pmacd waits at most {} s to \
             see it: gather more often, set a smaller I{}, or switch the report off (I{}=0); nothing was sent",
            two.as_secs() / 2,
            i.gather_period,
            LONGEST_REPORT.as_secs() / 2,
            i.gather_period,
            i.servo_enable
        )))
    }

    /// Two periods of the report: one may just have begun.
    fn two_periods(&self) -> Duration {
        let cycles = self.period.as_deref().and_then(answer::integer).unwrap_or(1);
        let ours = self.call.as_ref().map_or(1, |call| i64::from(call.buffer.period));
        let cycle_ns = self.call.as_ref().and_then(|call| call.servo_period_ns).unwrap_or(500_000);
        let cycles = u64::try_from(cycles.max(ours)).unwrap_or(1);
        Duration::from_nanos(cycles.saturating_mul(2).saturating_mul(cycle_ns))
    }

    fn gathers(&self, reply: &[String]) -> bool {
        reply.first().is_some_and(|reply| reply_has(reply, self.family.status.global, "data_gathering_on"))
    }

    fn explain(&self, index: usize, error: CallError) -> CallError {
        let text = self.call.as_ref().and_then(|call| call.lines.get(index)).map_or("", String::as_str);
        match error {
            CallError::Board { .. } if text.starts_with("DEFINE") => {
                let and_more = match self.family.servo.start {
                    ReportStart::Gather => " (and the servo report where none waits: GATHER starts it again)",
                    ReportStart::Enable => "",
                };
                refused(format!(
                    "{text}: {error}; if a gather waits for its trigger, `pmacctl send ENDGATHER` ends that{and_more}"
                ))
            }
            CallError::Board { .. } => refused(format!("{text}: {error}")),
            error => error,
        }
    }

    /// The clock that counts the board's turns in its buffer.
    fn clock(&self) -> Result<GatherClock, CallError> {
        let Some(call) = &self.call else { return Ok(GatherClock::Report) };
        match call.servo_period_ns.and_then(GatherClock::host) {
            _ if self.reports || call.buffer.mode == GatherMode::Stop => Ok(GatherClock::Report),
            Some(clock) => Ok(clock),
            None if self.family.servo.start == ReportStart::Gather => Err(refused(format!(
                "the servo report is off and I10 is not known, so turns of the buffer cannot be counted; switch the report on \
                 (I{}=1), or gather --once",
                self.family.i.servo_enable
            ))),
            None => Err(refused(
                "I10 is not known, so turns of the buffer cannot be counted; write i10 into pmacd's configuration, or \
                 gather --once",
            )),
        }
    }

    /// The step of this phase.
    fn step(&mut self) -> Result<Step, CallError> {
        let i = &self.family.i;
        let timeout = if self.phase_is_of_end() { END_STEP } else { STEP };
        Ok(match self.phase {
            Phase::FirstCheck | Phase::Check { .. } | Phase::CheckAtEnd => Step::Check,
            Phase::AskReport => line(format_args!("I{}", i.servo_enable), timeout),
            Phase::AskPeriod => line(format_args!("I{}", i.gather_period), timeout),
            Phase::AskPeriodAgain => ask(format_args!("I{}", i.gather_period), timeout),
            Phase::AskGathers => line("???", timeout),
            Phase::AskStill => ask("???", ASKING),
            Phase::AskWhetherToEnd => ask("???", timeout),
            Phase::SeeReport(_) | Phase::AwaitReport(_) => ReportWatch::look(self.family, timeout),
            Phase::Prepare(index) => {
                self.clock()?;
                self.period_sent = true;
                let lines = self.call.as_ref().map_or(&[][..], |call| &call.lines);
                line(lines.get(index).map_or("", String::as_str), timeout)
            }
            Phase::StartReport | Phase::Start => line("GATHER", timeout),
            Phase::Follow => {
                let clock = self.clock()?;
                let Some(call) = &self.call else { return Err(CallError::Busy) };
                Step::Job { job: Box::new(Job::GatherBegin { buffer: call.buffer, clock }), timeout }
            }
            Phase::Gathering if !self.started => {
                self.started = true;
                Step::Answer(Ok(Reply::done()))
            }
            Phase::Gathering | Phase::Look => {
                self.phase = Phase::Look;
                ReportWatch::look(self.family, timeout)
            }
            Phase::Full => Step::Answer(Ok(Reply::done())),
            Phase::EndGather => line("ENDGATHER", timeout),
            Phase::EndFollow => Step::Job { job: Box::new(Job::GatherEnd), timeout },
            Phase::PutBack => {
                let old = self.period.as_deref().unwrap_or_default();
                line(format_args!("I{}={old}", i.gather_period), timeout)
            }
            Phase::Over => Step::Over(self.result()),
        })
    }
}

impl Sequence for Gather {
    fn resource(&self) -> Resource {
        Resource::Gather
    }

    fn name(&self) -> &str {
        "gather"
    }

    fn next(&mut self, done: Option<Done>, now: Instant) -> Step {
        let mut taken = done.map_or(Ok(()), |done| self.take(done, now));
        loop {
            if let Err(error) = taken {
                self.failure.get_or_insert(error);
            }
            let ends = self.failure.is_some() || self.ending.is_some() || self.stop_asked;
            if ends && !self.phase_is_of_end() {
                (self.phase, self.rest) = (self.first_of_end(), None);
            }
            if self.phase == Phase::EndFollow && !self.followed {
                self.phase = Phase::AskPeriodAgain;
            }
            if self.retry.tells_now() {
                return Step::AnswerEnd(self.result());
            }
            match self.rest {
                Some(rest) if rest > now => return Step::Wait(rest),
                _ => self.rest = None,
            }
            match self.step() {
                Ok(step) => return step,
                Err(error) => taken = Err(error),
            }
        }
    }

    fn watches(&self) -> bool {
        self.phase != Phase::Full
    }

    fn unfinished(&self) -> Option<String> {
        if !self.retry.is_kept_back() || self.phase == Phase::Over {
            return None;
        }
        let period = self.family.i.gather_period;
        let ours = self.call.as_ref().map_or(0, |call| call.buffer.period);
        let old = self.period.as_deref().unwrap_or_default();
        Some(match self.phase {
            Phase::AskPeriodAgain | Phase::PutBack => {
                is_kept_back(&format!("I{period}"), &ours.to_string(), old, "gather")
            }
            _ => format!(
                "the board still gathers for nobody; pmacd ends that, and sets I{period} to {old} again, when the open program \
                 buffer is closed"
            ),
        })
    }

    fn asked(&mut self, call: SequenceCall, _: Instant) -> Result<(), CallError> {
        match call {
            SequenceCall::GatherStop { .. } => {
                self.stop_asked = true;
                Ok(())
            }
            _ => Err(refused("this connection gathers already; GatherStop ends that")),
        }
    }

    fn end(&mut self, why: Ending) {
        self.ending = Some(why);
    }
}

fn first(lines: &[String]) -> &str {
    lines.first().map_or("", |line| answer::text(line))
}

fn refused(reason: impl Into<String>) -> CallError {
    CallError::Refused { reason: reason.into() }
}
