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

use super::{Asked, CHECK, Done, END_STEP, Ending, Request, Resource, STEP, Step};
use crate::daemon::shared::job::Job;
use crate::daemon::shared::queue::{Line, REASON_MAX, Text};
use crate::map::masks::Systems;
use crate::protocol::{CallError, Reply};

/// What passes between a script and the service, and what the script tells of itself.
#[derive(Debug, Default)]
struct Exchange {
    now: Option<Instant>,
    step: Option<Step>,
    done: Option<Done>,
    /// What the owner calls, besides for the end.
    asked: Option<Asked>,
    dropped: Option<Text<REASON_MAX>>,
    ending: Option<Ending>,
    /// The owner has asked for the end.
    is_stopped: bool,
    /// The end has begun.
    is_end: bool,
    /// The client that has ended on the board what the script does, as of the latest outcome.
    ended_by: Option<String>,
    is_inside: bool,
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

    /// Whether the script is ended.
    pub(super) fn is_ended(&self) -> bool {
        self.with(|exchange| exchange.is_ended())
    }

    /// Why no line is sent any more but those of the end, once a client has stopped all motion.
    pub(super) fn dropped(&self) -> Option<Text<REASON_MAX>> {
        self.with(|exchange| exchange.dropped)
    }

    /// Whether the lines so far have opened a program buffer that they have not closed.
    pub(super) fn set_inside(&self, is_inside: bool) {
        self.with(|exchange| exchange.is_inside = is_inside);
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
            Poll::Pending if self.is_ended() => Poll::Ready(Ok(())),
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

    /// Has the bus thread do this. What became of it.
    pub(super) async fn request(&self, request: Request) -> Done {
        let timeout = if self.with(|exchange| exchange.is_end) { END_STEP } else { STEP };
        self.request_within(request, timeout).await
    }

    /// The same, within so long.
    pub(super) async fn request_within(&self, request: Request, timeout: Duration) -> Done {
        self.with(|exchange| exchange.step = Some(Step::Board(request, timeout)));
        let done = poll_fn(|_| self.with(|exchange| exchange.done.take().map_or(Poll::Pending, Poll::Ready)));
        let done = done.await;
        self.with(|exchange| exchange.ended_by.clone_from(&done.ended_by));
        done
    }

    /// Sends a line.
    pub(super) async fn line(&self, text: &str) -> Done {
        self.request(Request::Line(Line::of(text))).await
    }

    /// Asks the board, unless a program buffer is open.
    pub(super) async fn ask(&self, text: &str) -> Done {
        self.request(Request::Ask(Line::of(text))).await
    }

    /// Has the bus thread do a job.
    pub(super) async fn job(&self, job: Job) -> Done {
        self.request(Request::Job(Box::new(job))).await
    }

    /// Finds out whether the board has been reset since a check before.
    pub(super) async fn check(&self) -> Done {
        self.request_within(Request::Check, CHECK).await
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

    /// Tells the owner something, as one of several replies.
    pub(super) async fn tell(&self, reply: Reply) {
        self.pass(Step::Tell(reply)).await;
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

    /// Does nothing until the owner calls, which it gives, or an end comes.
    pub(super) async fn asked(&self) -> Option<Asked> {
        poll_fn(|_| {
            self.with(|exchange| {
                let asked = exchange.asked.take();
                if asked.is_some() || exchange.is_ended() {
                    return Poll::Ready(asked);
                }
                exchange.step = Some(Step::Rest);
                Poll::Pending
            })
        })
        .await
    }
}

type Run = Pin<Box<dyn Future<Output = Result<Reply, CallError>> + Send>>;

/// The service's side.
pub struct Script {
    resource: Resource,
    name: String,
    feeds: Systems,
    io: Io,
    run: Run,
}

impl Script {
    /// The script `run`, of which nothing has been done.
    pub(super) fn new<F>(resource: Resource, name: &str, run: impl FnOnce(Io) -> F) -> Self
    where
        F: Future<Output = Result<Reply, CallError>> + Send + 'static,
    {
        let io = Io::default();
        let name = name.to_owned();
        Self { resource, name, feeds: Systems::NONE, run: Box::pin(run(io.clone())), io }
    }

    /// The same, of a script that feeds the programs of these coordinate systems.
    pub(super) fn feeding(self, feeds: Systems) -> Self {
        Self { feeds, ..self }
    }

    /// What it has of the board.
    pub const fn resource(&self) -> Resource {
        self.resource
    }

    /// What people call it: `download`, `gather`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The coordinate systems whose programs it feeds. An abort of one of them ends it.
    pub const fn feeds(&self) -> Systems {
        self.feeds
    }

    /// Whether its lines so far have opened a program buffer that they have not closed. Its next line is refused if somebody else
    /// has closed it: the board would carry it out at once.
    pub fn is_inside(&self) -> bool {
        self.io.with(|exchange| exchange.is_inside)
    }

    /// How many lines its end leaves that nobody expects, in the rotary buffers of the coordinate systems that it feeds; `None` where
    /// it has changed nothing there. Told when it is over.
    pub fn leaves(&self) -> Option<u64> {
        self.io.with(|exchange| exchange.leaves)
    }

    /// What its end still has to do on the board, if it waits for another client with that.
    pub fn unfinished(&self) -> Option<String> {
        self.io.unfinished()
    }

    /// The next step. `done` is what became of a step that the bus thread does; `None` at the beginning, and after every other step.
    pub fn next(&mut self, done: Option<Done>, now: Instant) -> Step {
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

    /// Its owner calls: the steps that follow are for this call.
    ///
    /// # Errors
    /// What to answer instead; nothing changes then.
    pub fn ask(&mut self, asked: Asked) -> Result<(), CallError> {
        let name = &self.name;
        self.io.with(|exchange| {
            match asked {
                Asked::Lines(batch) if batch.kind() != name || exchange.is_end => {
                    let reason = format!("this connection has a {name}, which must end first");
                    return Err(CallError::refused(reason));
                }
                Asked::Stop => exchange.is_stopped = true,
                asked => exchange.asked = Some(asked),
            }
            Ok(())
        })
    }

    /// Somebody has stopped all motion, and the lines that wait are not sent any more, for this reason: nor are those that
    /// would follow here.
    pub fn drop_lines(&self, reason: Text<REASON_MAX>) {
        self.io.with(|exchange| exchange.dropped = Some(reason));
    }

    /// It ends, for this reason. Told once.
    pub fn end(&self, why: Ending) {
        self.io.with(|exchange| exchange.ending = Some(why));
    }
}

impl fmt::Debug for Script {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut shown = f.debug_struct("Script");
        self.io.with(|exchange| shown.field("name", &self.name).field("exchange", exchange).finish())
    }
}
