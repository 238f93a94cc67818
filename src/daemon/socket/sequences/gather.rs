//! A gather: what is asked first, the lines that begin it, and what its end puts back.
//!
//! With I48=1 the first `GATHER` starts the servo report and the second one gathering; `ENDGATHER` undoes the latest one (DPRAM
//! manual p. 14). So the number of `GATHER`s depends on whether the report runs, which its timer shows, and `ENDGATHER` is
//! sent only where the board says that it gathers: sent once too often it ends everybody's servo data.
//! The period of gathering (I19) is the servo report's as well. It is put back, unless somebody has set another one
//! meanwhile, or a reset has.

use std::time::{Duration, Instant};

use log::warn;

use super::report_watch::{ReportWatch, Seen};
use super::{Done, END_STEP, Ending, Resource, Sequence, SequenceCall, Step, is_unsent, line};
use crate::daemon::shared::info::Info;
use crate::daemon::shared::job::Job;
use crate::daemon::shared::queue::Outcome;
use crate::daemon::socket::jobs::inside;
use crate::daemon::socket::policy::Peer;
use crate::function::gather::GatherBuffer;
use crate::gather::{GatherMode, MOST_PERIOD, gather_lines};
use crate::map::status::reply_has;
use crate::map::{Family, GatherPlace, PmacRegister};
use crate::mirror::GatherClock;
use crate::protocol::board::GatherStopReply;
use crate::protocol::{CallError, Function, Reply, answer, calls};

/// How long the board may take for a line, and the daemon for a job.
const STEP: Duration = Duration::from_secs(5);
/// How long a report that may run is waited for, beyond two of its periods.
const REPORT_PAUSE: Duration = Duration::from_secs(1);
/// How long the first `GATHER` may take to start the report, beyond two periods.
const REPORT_START: Duration = Duration::from_secs(5);
/// How long an end tries what is known not to have been sent, and how often.
const END_PATIENCE: Duration = Duration::from_secs(10);
const AGAIN: Duration = Duration::from_millis(250);

/// A gather as it was called for.
#[derive(Debug)]
pub struct GatherCall {
    family: &'static Family,
    buffer: GatherBuffer,
    /// The lines up to `DEFINE GATHER`.
    lines: Vec<String>,
    servo_period_ns: Option<u64>,
    /// Whether the servo report is used.
    uses_report: bool,
}

impl GatherCall {
    /// What `call` asks for.
    ///
    /// # Errors
    /// What is wrong with it.
    pub(in crate::daemon::socket) fn of(call: calls::GatherStart, info: &Info) -> Result<Self, CallError> {
        let calls::GatherStart { registers, size_longs, period, wrap, servo_period_ns, .. } = call;
        let family = info.family();
        let place = GatherPlace {
            buffer: inside(call.buffer, 1, "buffer", family)?,
            size: inside(call.size_word, 1, "size_word", family)?,
            index: inside(call.index_word, 1, "index_word", family)?,
        };
        let most = family.i.most_gather_sources();
        if !(1..=most).contains(&registers.len()) {
            return Err(CallError::invalid(
                "registers",
                format_args!("1 to {most}, not {}", registers.len()),
            ));
        }
        let registers = registers.iter().map(|text| PmacRegister::parse(text, family));
        let registers: Vec<PmacRegister> =
            registers.collect::<Result<_, _>>().map_err(|reason| CallError::invalid("registers", reason))?;
        // A longer one does not fit the variable: the board would make another period of it, or 0, which ends the report.
        if !(1..=MOST_PERIOD).contains(&period) {
            return Err(CallError::invalid("period", format_args!("1 to {MOST_PERIOD} servo cycles")));
        }
        if servo_period_ns == Some(0) {
            return Err(CallError::invalid("servo_period_ns", "a servo cycle in nanoseconds"));
        }
        let mode = if wrap.unwrap_or(true) { GatherMode::Wrap } else { GatherMode::Stop };
        let readings = info.settings().readings;
        let codes: Vec<u32> = registers.iter().map(|register| register.gather_code()).collect();
        Ok(Self {
            lines: gather_lines(&family.i, &codes, period, mode, size_longs),
            buffer: GatherBuffer {
                place,
                room_longs: (family.length - place.buffer.bytes()) / 4,
                size_longs,
                sample_longs: registers.iter().map(|register| register.longs()).sum(),
                longest_sample: family.i.longest_gather_sample(),
                mode,
                period,
                size_word: readings.gather_size_word,
                index: readings.gather_index,
            },
            servo_period_ns,
            uses_report: info.settings().functions.has(Function::Servo),
            family,
        })
    }
}

/// How far it is: what is asked of the board, or waited for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
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
    /// The end: whether it still gathers.
    AskWhetherToEnd,
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
pub(in crate::daemon::socket) struct Gather {
    family: &'static Family,
    owner: Peer,
    /// `None` where nothing is begun, but what somebody began by hand is ended.
    call: Option<GatherCall>,
    phase: Phase,
    /// I48 is 1.
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
    /// `ENDGATHER` was sent.
    ended: bool,
    stop_asked: bool,
    ending: Option<Ending>,
    failure: Option<CallError>,
    notes: Vec<String>,
    /// When to go on with an end that cannot be carried out now, and when to give it up.
    rest: Option<Instant>,
    give_up: Option<Instant>,
}

impl Gather {
    /// Begins a gather of `owner`.
    pub(in crate::daemon::socket) fn new(call: GatherCall, owner: Peer) -> Self {
        Self::at(Phase::AskReport, call.family, owner, Some(call))
    }

    /// Ends what the board gathers, whoever began it: `owner` asks for that.
    pub(in crate::daemon::socket) fn stop(family: &'static Family, owner: Peer) -> Self {
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
            ended: false,
            stop_asked: false,
            ending: None,
            failure: None,
            notes: Vec::new(),
            rest: None,
            give_up: None,
        }
    }

    /// Takes what became of the step of this phase.
    ///
    /// # Errors
    /// Why there will be no gather.
    fn take(&mut self, done: Done, now: Instant) -> Result<(), CallError> {
        let i = &self.family.i;
        let unsent = is_unsent(done.outcome);
        match self.phase {
            Phase::AskReport => {
                self.reports = first(&done.result?) == "1";
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
                self.phase = Phase::AskGathers;
            }
            Phase::AskGathers => {
                if self.gathers(&done.result?) {
                    return Err(refused(
                        "the board gathers already, and no client of pmacd began that: somebody did by hand, on the serial port \
                         or from another host; `pmacctl gather --stop` ends it",
                    ));
                }
                let watch = ReportWatch::new(now + REPORT_PAUSE + self.two_periods());
                self.phase = if self.reports { Phase::SeeReport(watch) } else { Phase::Prepare(0) };
            }
            Phase::SeeReport(mut watch) => match watch.see(&done, now) {
                Seen::Nothing => self.rest_on(Phase::SeeReport(watch), now),
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
                Seen::Nothing => self.rest_on(Phase::AwaitReport(watch), now),
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
            Phase::Gathering | Phase::Over => {}
            _ => self.take_of_end(done, now),
        }
        Ok(())
    }

    /// Takes what became of a step of the end. What cannot be carried out is noted, and the end goes on.
    fn take_of_end(&mut self, done: Done, now: Instant) {
        let gather_period = self.family.i.gather_period;
        let is_question = matches!(self.phase, Phase::AskWhetherToEnd | Phase::AskPeriodAgain);
        let can_be_tried = is_unsent(done.outcome) || is_question && done.outcome == Outcome::TimedOut;
        if can_be_tried && self.phase != Phase::EndFollow {
            let give_up = *self.give_up.get_or_insert(now + END_PATIENCE);
            if now < give_up && self.ending != Some(Ending::Stopping) {
                self.rest = Some(now + AGAIN);
                return;
            }
        }
        let (phase, note) = match (self.phase, done.result) {
            (Phase::AskWhetherToEnd, Ok(lines)) => match self.gathers(&lines) {
                true => (Phase::EndGather, None),
                false => (Phase::EndFollow, None),
            },
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
                    let note =
                        format!("I{gather_period} is {found}, which this gather did not set: it stays so");
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

    /// Waits a moment before the next look.
    fn rest_on(&mut self, phase: Phase, now: Instant) {
        self.phase = phase;
        self.rest = Some(now + ReportWatch::LOOK);
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
            CallError::Board { .. } if text.starts_with("DEFINE") => refused(format!(
                "{text}: {error}; if a gather waits for its trigger, `pmacctl send ENDGATHER` ends that (and the servo report \
                 where none waits: GATHER starts it again)"
            )),
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
            None => Err(refused(format!(
                "the servo report is off and I10 is not known, so turns of the buffer cannot be counted; switch the report on \
                 (I{}=1), or gather --once",
                self.family.i.servo_enable
            ))),
        }
    }

    /// The step of this phase.
    fn step(&mut self) -> Result<Step, CallError> {
        let i = &self.family.i;
        let timeout = if self.phase_is_of_end() { END_STEP } else { STEP };
        Ok(match self.phase {
            Phase::AskReport => line(format_args!("I{}", i.servo_enable), timeout),
            Phase::AskPeriod | Phase::AskPeriodAgain => line(format_args!("I{}", i.gather_period), timeout),
            Phase::AskGathers | Phase::AskWhetherToEnd => line("???", timeout),
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
            Phase::Gathering => {
                self.started = true;
                Step::Answer(Ok(Reply::done()))
            }
            Phase::EndGather => line("ENDGATHER", timeout),
            Phase::EndFollow => Step::Job { job: Box::new(Job::GatherEnd), timeout },
            Phase::PutBack => {
                let old = self.period.as_deref().unwrap_or_default();
                line(format_args!("I{}={old}", i.gather_period), timeout)
            }
            Phase::Over => Step::Over(self.result()),
        })
    }

    fn phase_is_of_end(&self) -> bool {
        use Phase::{AskPeriodAgain, AskWhetherToEnd, EndFollow, EndGather, Over, PutBack};
        matches!(self.phase, AskWhetherToEnd | EndGather | EndFollow | AskPeriodAgain | PutBack | Over)
    }

    /// The first phase of the end.
    fn first_of_end(&self) -> Phase {
        match self.begun {
            // What was started last is the report, by this gather: that is undone.
            Begun::Report => Phase::EndGather,
            // A full buffer ends its gather, and so may somebody else: what ENDGATHER would end then is the servo report.
            Begun::Gathering => Phase::AskWhetherToEnd,
            Begun::Nothing if self.period_sent => Phase::AskPeriodAgain,
            Begun::Nothing => Phase::Over,
        }
    }

    fn result(&mut self) -> Result<Reply, CallError> {
        let notes = std::mem::take(&mut self.notes);
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
            if let Some(rest) = self.rest.take_if(|rest| *rest > now) {
                return Step::Wait(rest);
            }
            match self.step() {
                Ok(step) => return step,
                Err(error) => taken = Err(error),
            }
        }
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
