//! A gather: its first questions to the board, the lines that begin it, and the values that its end puts back.
//!
//! With I48=1 the first `GATHER` starts the servo report and the second one gathering; `ENDGATHER` undoes the latest
//! one (DPRAM manual p. 14). So the number of `GATHER`s depends on whether the report runs, which its timer shows, and
//! the daemon sends `ENDGATHER` only if the board says that it gathers: one `ENDGATHER` too many ends the servo data
//! for every client. A Turbo board reports without `GATHER` (Turbo User Manual p. 403), and its I5049 is the period of
//! gathering alone. The period of gathering (I19) is the servo report's as well. The end puts I19 back, unless another
//! sender or a reset has set another period meanwhile. While a program buffer is open the line would enter that buffer:
//! the daemon sends the line once the buffer is closed, however long that takes, and no caller waits for it.
//!
//! During the gather, the servo report tells whether the board still gathers. If no report tells, the daemon asks the
//! board.

mod call;

use std::time::{Duration, Instant};

use log::warn;

pub use self::call::GatherCall;
use super::end_retry::{EndRetry, is_kept_back, was_set_meanwhile};
use super::report_watch::report_runs;
use super::script::{Io, Script};
use super::{Request, Resource, first, with_notes};
use crate::daemon::shared::job::Job;
use crate::daemon::shared::peer::Peer;
use crate::daemon::shared::queue::{Line, Outcome};
use crate::gather::GatherMode;
use crate::map::status::reply_has;
use crate::map::{Family, ReportStart};
use crate::mirror::GatherClock;
use crate::protocol::board::GatherStopReply;
use crate::protocol::{CallError, Reply, answer};

/// How long the script waits for a report that may run, beyond two of its periods.
const REPORT_PAUSE: Duration = Duration::from_secs(1);
/// How long the first `GATHER` may take to start the report, beyond two periods.
const REPORT_START: Duration = Duration::from_secs(5);
/// The longest time that two periods of the report may take: the script cannot wait for a report that comes more
/// seldom.
const LONGEST_REPORT: Duration = Duration::from_secs(30);
/// How often to check whether the board still gathers, and whether it was reset.
const GATHER_LOOK: Duration = Duration::from_millis(500);
/// How long the board may take to say that it gathers. A board in a reset answers nothing for a while.
const ASKING: Duration = Duration::from_secs(1);
const CHECK_EVERY: Duration = Duration::from_secs(60);
/// How long the end retries lines that the daemon has certainly not sent.
const END_PATIENCE: Duration = Duration::from_secs(10);

/// The effect of the latest `GATHER`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Begun {
    Nothing,
    Report,
    Gathering,
}

/// The state that the end needs.
struct Gather<'a> {
    io: Io,
    family: &'static Family,
    owner: Peer,
    /// `None` if the script begins no gather but ends one that a user began by hand.
    call: Option<&'a GatherCall>,
    /// I48 is 1, on a board whose report GATHER starts.
    reports: bool,
    /// I19 before the gather, and at the end.
    period: Option<String>,
    period_sent: bool,
    begun: Begun,
    followed: bool,
    /// The owner has heard that the board gathers.
    started: bool,
    /// The number of resets at the latest check.
    resets: Option<u64>,
    /// The daemon has sent `ENDGATHER`.
    ended: bool,
    failure: Option<CallError>,
    notes: Vec<String>,
}

/// The script of a gather of `owner`.
pub fn gather(call: GatherCall, owner: Peer) -> Script {
    Script::new(Resource::Gather, "gather", move |io| async move {
        let mut gather = Gather::new(io.clone(), call.family, owner, Some(&call));
        gather.failure = io.until_ended(gather.run(&call)).await;
        gather.end().await
    })
}

/// The script that ends the board's gather, whoever began it, for `owner`.
pub fn stop_gather(family: &'static Family, owner: Peer) -> Script {
    Script::new(Resource::Gather, "gather", move |io| async move {
        let mut gather = Gather::new(io.clone(), family, owner, None);
        gather.begun = Begun::Gathering;
        io.begin_end();
        gather.end().await
    })
}

impl<'a> Gather<'a> {
    fn new(io: Io, family: &'static Family, owner: Peer, call: Option<&'a GatherCall>) -> Self {
        Self {
            io,
            family,
            owner,
            call,
            reports: false,
            period: None,
            period_sent: false,
            begun: Begun::Nothing,
            followed: false,
            started: false,
            resets: None,
            ended: false,
            failure: None,
            notes: Vec::new(),
        }
    }

    /// Begins the gather, and watches it.
    ///
    /// # Errors
    /// Why no gather begins, or why it has ended.
    async fn run(&mut self, call: &GatherCall) -> Result<(), CallError> {
        let i = &self.family.i;
        let check = self.io.check().await;
        // If the board cannot be asked now, the daemon cannot tell a later reset from an earlier one.
        self.resets = check.result.is_ok().then_some(check.resets);
        let check_due = self.io.now() + CHECK_EVERY;
        let report = self.io.line(&format!("I{}", i.servo_enable)).await.result?;
        self.reports = first(&report) == "1" && self.family.servo.start == ReportStart::Gather;
        if self.reports && !call.uses_report {
            // The number of GATHERs depends on whether the board reports.
            return Err(CallError::refused(format!(
                "I{}=1, and gathering then takes the function `servo`, which is switched off: `functions` in the \
                 daemon's configuration leaves it out",
                i.servo_enable
            )));
        }
        let period = self.io.line(&format!("I{}", i.gather_period)).await.result?;
        self.period = Some(first(&period).to_owned());
        self.check_report_is_frequent(call)?;
        if self.gathers(&self.io.line("???").await.result?) {
            return Err(CallError::refused(
                "the board gathers already, and no client of this pmacd began that: it was begun by hand, on the serial port, \
                 by another host, or through a pmacd that was killed; `pmacctl gather --stop` ends it",
            ));
        }
        let patience = REPORT_PAUSE + self.two_periods(call);
        let runs = self.reports && report_runs(&self.io, self.family, patience).await;
        let clock = self.clock(call)?;
        for text in &call.lines {
            let sent = self.io.line(text).await;
            self.period_sent = true;
            sent.result.map_err(|error| self.explain(text, error))?;
        }
        if self.reports && !runs {
            self.start_report(call).await?;
        }
        let follows = self.io.job(Job::GatherBegin { buffer: call.buffer, clock }).await;
        self.followed = !follows.outcome.is_unsent();
        follows.result?;
        self.send_gather(Begun::Gathering).await?;
        self.io.answer(Ok(Reply::done())).await;
        self.started = true;
        self.watch(call, check_due).await
    }

    /// Starts the servo report, by the first `GATHER`.
    async fn start_report(&mut self, call: &GatherCall) -> Result<(), CallError> {
        self.send_gather(Begun::Report).await?;
        if report_runs(&self.io, self.family, REPORT_START + self.two_periods(call)).await {
            return Ok(());
        }
        let i = &self.family.i;
        let reported = i.reported.map_or_else(String::new, |number| format!(" (is I{number} above 0?)"));
        Err(CallError::refused(format!(
            "I{}=1 and GATHER start no servo report{reported}, so turns of the buffer cannot be counted",
            i.servo_enable
        )))
    }

    /// Sends a `GATHER` that `begins` this.
    async fn send_gather(&mut self, begins: Begun) -> Result<(), CallError> {
        let sent = self.io.line("GATHER").await;
        if !sent.outcome.is_unsent() {
            self.begun = begins;
        }
        sent.result.map(drop)
    }

    /// Checks now and then whether the board still gathers, and whether it was reset.
    ///
    /// # Errors
    /// Why the gather has ended.
    async fn watch(&mut self, call: &GatherCall, mut check_due: Instant) -> Result<(), CallError> {
        let look = Request::Read { first: self.family.servo.timer.low, count: 1 };
        let mut was_seen = false;
        loop {
            let told = self.io.request(look.clone()).await.gathers;
            was_seen |= told == Some(true);
            // Before that the report may date from before GATHER. A board that the daemon cannot ask now tells nothing.
            let gathers = if told.is_some() && was_seen {
                told
            } else {
                let asked = self.io.request_within(Request::Ask(Line::of("???")), ASKING).await;
                asked.result.ok().map(|lines| self.gathers(&lines))
            };

            let is_over = gathers == Some(false);
            if is_over || gathers.is_some() && self.io.now() >= check_due {
                let check = self.io.check().await;
                check_due = self.io.now() + CHECK_EVERY;
                if check.result.is_ok() && self.was_reset(check.resets) {
                    return Err(CallError::refused(self.was_ended(true)));
                }
            }
            match call.buffer.mode {
                _ if !is_over => self.io.rest(GATHER_LOOK).await,
                // The buffer is full, as the caller asked.
                GatherMode::Stop => {
                    self.io.answer(Ok(Reply::done())).await;
                    self.io.asked().await;
                }
                GatherMode::Wrap => return Err(CallError::refused(self.was_ended(false))),
            }
        }
    }

    /// The end. It notes the steps that fail, and goes on.
    async fn end(&mut self) -> Result<Reply, CallError> {
        let mut retry = EndRetry::new(END_PATIENCE, self.call.is_some());
        if self.begun != Begun::Nothing {
            let note = self.end_gather(&mut retry).await;
            self.notes.extend(note);
        }
        while self.followed {
            let ended = self.io.job(Job::GatherEnd).await;
            // A daemon that no longer uses the function follows no gather.
            let is_lost = matches!(ended.outcome, Outcome::Refused(_));
            self.followed = ended.outcome.is_unsent()
                && !is_lost
                && self.tries_again(&mut retry, ended.outcome, false).await;
        }
        if self.period_sent || self.call.is_none() {
            let note = self.put_back(&mut retry).await;
            self.notes.extend(note);
        }
        self.io.set_unfinished(None);
        self.result()
    }

    /// Sends `ENDGATHER` if the board gathers. Returns the note for the owner.
    async fn end_gather(&mut self, retry: &mut EndRetry) -> Option<String> {
        loop {
            // If this gather has started only the report, ENDGATHER undoes that. A full buffer ends a gather, and so
            // may another sender: ENDGATHER would then end the servo report.
            if self.begun == Begun::Gathering {
                let asked = self.io.ask("???").await;
                if may_ask_again(asked.outcome) && self.tries_again(retry, asked.outcome, false).await {
                    continue;
                }
                match asked.result {
                    Ok(lines) if self.gathers(&lines) => {}
                    Ok(_) if self.has_ended_early() => {
                        let check = self.io.check().await;
                        let was_reset = check.result.is_ok() && self.was_reset(check.resets);
                        return Some(self.was_ended(was_reset));
                    }
                    Ok(_) => return None,
                    Err(error) => {
                        return Some(format!(
                            "the board may still gather, it could not be asked ({error}); `pmacctl gather --stop` ends that"
                        ));
                    }
                }
            }
            let sent = self.io.line("ENDGATHER").await;
            // Another sender may end the gather meanwhile.
            if sent.outcome.is_unsent() && self.tries_again(retry, sent.outcome, false).await {
                continue;
            }
            self.ended = sent.result.is_ok();
            let error = sent.result.err()?;
            return Some(format!("ENDGATHER: {error}; the board may still gather"));
        }
    }

    /// Puts I19 back if it still has this gather's value. Returns the note for the owner.
    async fn put_back(&mut self, retry: &mut EndRetry) -> Option<String> {
        let period = format!("I{}", self.family.i.gather_period);
        let old = self.period.clone();
        let ours = self.call.map(|call| call.buffer.period.to_string());
        let old_text = old.as_deref().unwrap_or_default();
        let failed = |error| format!("{period}={old_text}: {error}; {period} may not be {old_text} again");
        if retry.is_kept_back() {
            self.io.set_unfinished(self.unfinished(true));
        }
        loop {
            let asked = self.io.ask(&period).await;
            if may_ask_again(asked.outcome) && self.tries_again(retry, asked.outcome, true).await {
                continue;
            }
            let found = match asked.result {
                Ok(lines) => first(&lines).to_owned(),
                Err(error) => return self.period_sent.then(|| failed(error)),
            };
            let is_other = self.period_sent && old.as_ref().is_some_and(|old| *old != found);
            if !is_other || Some(&found) != ours.as_ref() {
                let note = is_other.then(|| was_set_meanwhile(&period, &found));
                self.period = Some(found);
                return note;
            }
            let sent = self.io.line(&format!("{period}={old_text}")).await;
            // Another sender may set another period meanwhile.
            if sent.outcome.is_unsent() && self.tries_again(retry, sent.outcome, true).await {
                continue;
            }
            return sent.result.err().map(failed);
        }
    }

    /// Whether to try a step of the end again after this `outcome`; rests before. The step is that of I19 if
    /// `is_period`, or an earlier one.
    async fn tries_again(&mut self, retry: &mut EndRetry, outcome: Outcome, is_period: bool) -> bool {
        let io = self.io.clone();
        retry.rests(&io, outcome, self.unfinished(is_period), || self.result()).await
    }

    /// The work that an open program buffer keeps back.
    fn unfinished(&self, is_period: bool) -> Option<String> {
        let period = self.family.i.gather_period;
        let ours = self.call.map_or(0, |call| call.buffer.period);
        let old = self.period.as_deref().unwrap_or_default();
        if is_period {
            return Some(is_kept_back(&format!("I{period}"), &ours.to_string(), old, "gather"));
        }
        Some(format!(
            "the board still gathers for nobody; pmacd ends that, and sets I{period} to {old} again, when the open program \
             buffer is closed"
        ))
    }

    /// Whether the board, now with this count of `resets`, was reset since the last check.
    fn was_reset(&mut self, resets: u64) -> bool {
        self.resets.replace(resets).is_some_and(|before| before != resets)
    }

    /// The cause of the gather's end: a reset of the board, or a client; possible causes, if the cause is unknown.
    fn was_ended(&self, was_reset: bool) -> String {
        match (was_reset, self.io.ended_by().as_deref()) {
            (true, Some(by)) => format!("the board was reset, which ended the gather: {by}"),
            (true, None) => "the board was reset, which ended the gather".to_owned(),
            (false, Some(by)) => format!("the board gathers no more: {by}"),
            (false, None) => "the board gathers no more, and no client of pmacd ended that: the serial port, another host or a program \
                              of the board did, or the board was reset"
                .to_owned(),
        }
    }

    /// Whether a gather that wraps round is over without a known cause.
    fn has_ended_early(&self) -> bool {
        let wraps = self.call.is_some_and(|call| call.buffer.mode == GatherMode::Wrap);
        wraps && self.started && self.failure.is_none()
    }

    /// Checks that the report comes often enough to wait for it.
    ///
    /// # Errors
    /// The report comes too seldom.
    fn check_report_is_frequent(&self, call: &GatherCall) -> Result<(), CallError> {
        let two = self.two_periods(call);
        if !self.reports || two <= LONGEST_REPORT {
            return Ok(());
        }
        let (i, found) = (&self.family.i, self.period.as_deref().unwrap_or_default());
        Err(CallError::refused(format!(
            "the servo report would come once in {} s (I{} is {found}, this gather takes {}), and pmacd waits at most {} s to \
             see it: gather more often, set a smaller I{}, or switch the report off (I{}=0); nothing was sent",
            two.as_secs() / 2,
            i.gather_period,
            call.buffer.period,
            LONGEST_REPORT.as_secs() / 2,
            i.gather_period,
            i.servo_enable
        )))
    }

    /// Two periods of the report: a period may just have begun.
    fn two_periods(&self, call: &GatherCall) -> Duration {
        let cycles = self.period.as_deref().and_then(answer::integer).unwrap_or(1);
        let cycles = u64::try_from(cycles.max(call.buffer.period.into())).unwrap_or(1);
        let cycle_ns = call.servo_period_ns.unwrap_or(500_000);
        Duration::from_nanos(cycles.saturating_mul(2).saturating_mul(cycle_ns))
    }

    fn gathers(&self, reply: &[String]) -> bool {
        reply.first().is_some_and(|reply| reply_has(reply, self.family.status.global, "data_gathering_on"))
    }

    fn explain(&self, text: &str, error: CallError) -> CallError {
        match error {
            CallError::Board { .. } if text.starts_with("DEFINE") => {
                let and_more = match self.family.servo.start {
                    ReportStart::Gather => " (and the servo report where none waits: GATHER starts it again)",
                    ReportStart::Enable => "",
                };
                CallError::refused(format!(
                    "{text}: {error}; if a gather waits for its trigger, `pmacctl send ENDGATHER` ends that{and_more}"
                ))
            }
            CallError::Board { .. } => CallError::refused(format!("{text}: {error}")),
            error => error,
        }
    }

    /// The clock that counts the board's turns in its buffer.
    fn clock(&self, call: &GatherCall) -> Result<GatherClock, CallError> {
        match call.servo_period_ns.and_then(GatherClock::host) {
            _ if self.reports || call.buffer.mode == GatherMode::Stop => Ok(GatherClock::Report),
            Some(clock) => Ok(clock),
            None if self.family.servo.start == ReportStart::Gather => Err(CallError::refused(format!(
                "the servo report is off and I10 is not known, so turns of the buffer cannot be counted; switch the report on \
                 (I{}=1), or gather --once",
                self.family.i.servo_enable
            ))),
            None => Err(CallError::refused(
                "I10 is not known, so turns of the buffer cannot be counted; write i10 into pmacd's configuration, or \
                 gather --once",
            )),
        }
    }

    /// The last reply to the owner.
    fn result(&mut self) -> Result<Reply, CallError> {
        let mut notes = std::mem::take(&mut self.notes);
        notes.extend(self.io.unfinished());
        notes.iter().for_each(|note| warn!("the end of a gather: {note}"));
        let reason = self.io.ending().map(|why| why.to_string());
        match self.failure.take() {
            Some(error) => Err(with_notes(error, &notes)),
            None if self.call.is_some() && !self.started => Err(CallError::refused(format!(
                "the gather was ended before it began: {}",
                reason.unwrap_or_default()
            ))),
            None => Reply::with(&GatherStopReply {
                gathered: self.call.is_some() || self.ended,
                uid: self.owner.uid.as_raw(),
                pid: self.owner.pid,
                reason,
                period: self.period.clone(),
                notes,
            }),
        }
    }
}

/// Whether the daemon may ask a question with this outcome again.
const fn may_ask_again(outcome: Outcome) -> bool {
    outcome.is_unsent() || matches!(outcome, Outcome::TimedOut)
}
