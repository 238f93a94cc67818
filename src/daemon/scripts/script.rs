//! A script: an `async` function that reads as the conversation with the board goes.
//!
//! Each wait of the function is a [`Step`]. The service carries the step out and polls the function again when the outcome is there
//! ([`Script::next`]). There is no runtime and no waker, and the same outcomes always give the same steps.
//!
//! An end cuts a script at a step: [`Io::until_ended`] drops the part that it runs at the first step which that part would begin
//! after the end. The code behind `until_ended` is the end of the script; nothing cuts it.

use std::fmt;
use std::future::poll_fn;
use std::pin::{Pin, pin};
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll, Waker};
use std::time::{Duration, Instant};

use super::{Done, END_STEP, Ending, Resource, STEP, Sequence, SequenceCall, Step, ask, line};
use crate::daemon::shared::job::Job;
use crate::map::HostOffset;
use crate::map::masks::Systems;
use crate::protocol::{CallError, Reply};

/// What passes between a script and the service, and what the script tells of itself.
#[derive(Debug, Default)]
struct Exchange {
    now: Option<Instant>,
    step: Option<Step>,
    done: Option<Done>,
    /// What the owner calls, besides for the end.
    asked: Option<SequenceCall>,
    ending: Option<Ending>,
    /// The owner has asked for the end.
    is_stopped: bool,
    /// The end has begun.
    is_end: bool,
    /// The client that has ended on the board what the script does, as of the latest outcome.
    ended_by: Option<String>,
    unfinished: Option<String>,
    leaves: Option<u64>,
}

impl Exchange {
    const fn is_ended(&self) -> bool {
        self.is_stopped || self.ending.is_some()
    }
}

/// The script's side: it asks for steps and hears of their outcomes.
#[derive(Clone, Default)]
pub(super) struct Io(Arc<Mutex<Exchange>>);

impl Io {
    fn with<T>(&self, with: impl FnOnce(&mut Exchange) -> T) -> T {
        with(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// The time.
    pub(super) fn now(&self) -> Instant {
        self.with(|exchange| *exchange.now.get_or_insert_with(Instant::now))
    }

    /// Why the script ends, once something else than the script or its owner has ended it.
    pub(super) fn ending(&self) -> Option<Ending> {
        self.with(|exchange| exchange.ending)
    }

    /// The client that has ended on the board what the script does, as far as known.
    pub(super) fn ended_by(&self) -> Option<String> {
        self.with(|exchange| exchange.ended_by.clone())
    }

    /// What the end still has to do on the board, while it waits for another client.
    pub(super) fn unfinished(&self) -> Option<String> {
        self.with(|exchange| exchange.unfinished.clone())
    }

    pub(super) fn set_unfinished(&self, unfinished: Option<String>) {
        self.with(|exchange| exchange.unfinished = unfinished);
    }

    /// The end leaves so many lines that nobody expects, in the rotary buffers of the coordinate systems that the script feeds.
    pub(super) fn leaves(&self, lines: u64) {
        self.with(|exchange| exchange.leaves = Some(lines));
    }

    /// Whether the owner has called since this was asked before.
    pub(super) fn take_asked(&self) -> bool {
        self.with(|exchange| exchange.asked.take().is_some())
    }

    /// Runs `part` until it fails, or until the script is ended and `part` would begin another step. Then the end begins. The
    /// failure, if it was one.
    pub(super) async fn until_ended(
        &self,
        part: impl Future<Output = Result<(), CallError>>,
    ) -> Option<CallError> {
        let mut part = pin!(part);
        let result = poll_fn(|context| match part.as_mut().poll(context) {
            Poll::Pending if self.with(|exchange| exchange.is_ended()) => Poll::Ready(Ok(())),
            other => other,
        });
        let result = result.await;
        self.begin_end();
        result.err()
    }

    /// What follows is the end.
    pub(super) fn begin_end(&self) {
        self.with(|exchange| (exchange.step, exchange.is_end) = (None, true));
    }

    /// Has the bus thread do `step`. What became of it.
    pub(super) async fn board(&self, step: Step) -> Done {
        self.with(|exchange| exchange.step = Some(step));
        let done = poll_fn(|_| self.with(|exchange| exchange.done.take().map_or(Poll::Pending, Poll::Ready)));
        let done = done.await;
        self.with(|exchange| exchange.ended_by.clone_from(&done.ended_by));
        done
    }

    fn timeout(&self) -> Duration {
        if self.with(|exchange| exchange.is_end) { END_STEP } else { STEP }
    }

    /// Sends a line.
    pub(super) async fn line(&self, text: impl fmt::Display) -> Done {
        self.board(line(text, self.timeout())).await
    }

    /// Asks the board, unless a program buffer is open.
    pub(super) async fn ask(&self, text: impl fmt::Display) -> Done {
        self.ask_within(text, self.timeout()).await
    }

    /// The same, and the board may take so long.
    pub(super) async fn ask_within(&self, text: impl fmt::Display, timeout: Duration) -> Done {
        self.board(ask(text, timeout)).await
    }

    /// Has the bus thread do a job.
    pub(super) async fn job(&self, job: Job) -> Done {
        self.board(Step::Job { job: Box::new(job), timeout: self.timeout() }).await
    }

    /// Sends a control character that has an answer.
    pub(super) async fn control(&self, character: u8) -> Done {
        self.board(Step::Control { character, timeout: self.timeout() }).await
    }

    /// Reads words of the DPRAM.
    pub(super) async fn read(&self, first: HostOffset, count: usize) -> Done {
        self.board(Step::Read { first, count, timeout: self.timeout() }).await
    }

    /// Finds out whether the board has been reset since a check before.
    pub(super) async fn check(&self) -> Done {
        self.board(Step::Check).await
    }

    /// Hands the service a step that has no outcome.
    async fn pass(&self, step: Step) {
        self.with(|exchange| exchange.step = Some(step));
        let mut is_passed = false;
        poll_fn(|_| match std::mem::replace(&mut is_passed, true) {
            true => Poll::Ready(()),
            false => Poll::Pending,
        })
        .await;
    }

    /// Answers the owner's call.
    pub(super) async fn answer(&self, reply: Result<Reply, CallError>) {
        self.pass(Step::Answer(reply)).await;
    }

    /// Answers the owner's call and everybody who waits for the end: it goes on without them.
    pub(super) async fn answer_end(&self, reply: Result<Reply, CallError>) {
        self.pass(Step::AnswerEnd(reply)).await;
    }

    /// Waits until then, or until the owner calls.
    pub(super) async fn rest_until(&self, until: Instant) {
        poll_fn(|_| {
            if self.now() >= until || self.with(|exchange| exchange.asked.is_some()) {
                return Poll::Ready(());
            }
            self.with(|exchange| exchange.step = Some(Step::Wait(until)));
            Poll::Pending
        })
        .await;
    }

    /// Waits for so long, or until the owner calls.
    pub(super) async fn rest(&self, pause: Duration) {
        self.rest_until(self.now() + pause).await;
    }

    /// Does nothing until an end comes.
    pub(super) async fn rest_until_ended(&self) {
        while self.with(|exchange| !exchange.is_ended()) {
            self.pass(Step::Rest).await;
        }
    }
}

type Run = Pin<Box<dyn Future<Output = Result<Reply, CallError>> + Send>>;

/// The service's side.
pub struct Script {
    resource: Resource,
    name: &'static str,
    feeds: Systems,
    io: Io,
    run: Run,
}

impl Script {
    /// The script `run`, of which nothing has been done.
    pub(super) fn new<F>(resource: Resource, name: &'static str, run: impl FnOnce(Io) -> F) -> Self
    where
        F: Future<Output = Result<Reply, CallError>> + Send + 'static,
    {
        let io = Io::default();
        Self { resource, name, feeds: Systems::NONE, run: Box::pin(run(io.clone())), io }
    }

    /// The same, of a script that feeds the programs of these coordinate systems.
    pub(super) fn feeding(self, feeds: Systems) -> Self {
        Self { feeds, ..self }
    }
}

impl fmt::Debug for Script {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut shown = f.debug_struct("Script");
        self.io.with(|exchange| shown.field("name", &self.name).field("exchange", exchange).finish())
    }
}

impl Sequence for Script {
    fn resource(&self) -> Resource {
        self.resource
    }

    fn name(&self) -> &str {
        self.name
    }

    fn feeds(&self) -> u32 {
        self.feeds.bits()
    }

    fn leaves(&self) -> Option<u64> {
        self.io.with(|exchange| exchange.leaves)
    }

    fn unfinished(&self) -> Option<String> {
        self.io.unfinished()
    }

    fn next(&mut self, done: Option<Done>, now: Instant) -> Step {
        let is_answered = self.io.with(|exchange| {
            exchange.now = Some(now);
            exchange.done = done.or(exchange.done.take());
            exchange.is_end && exchange.asked.take().is_some()
        });
        if is_answered {
            // The owner hears by his call for the end how it ended.
            return Step::Answer(Ok(Reply::done()));
        }
        match self.run.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
            Poll::Ready(reply) => Step::Over(reply),
            Poll::Pending => self.io.with(|exchange| exchange.step.take()).unwrap_or(Step::Rest),
        }
    }

    fn watches(&self) -> bool {
        true
    }

    fn asked(&mut self, call: SequenceCall, _: Instant) -> Result<(), CallError> {
        self.io.with(|exchange| match call {
            SequenceCall::GatherStop { .. } | SequenceCall::RotaryStop(_) => exchange.is_stopped = true,
            call => exchange.asked = Some(call),
        });
        Ok(())
    }

    fn end(&mut self, why: Ending) {
        self.io.with(|exchange| exchange.ending = Some(why));
    }
}
