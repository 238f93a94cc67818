//! A script: an `async` function that reads like the conversation with the board.
//!
//! Each wait of the function is a [`Step`]. The service carries out the step and polls the function again with the
//! outcome ([`Script::next`]). There is no runtime and no waker, and the same outcomes always give the same steps.
//!
//! An end cuts a script at a step: [`Io::until_ended`] drops the part that it runs at the first step which that part
//! would begin after the end. The code behind `until_ended` is the end of the script; nothing cuts it.

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

/// The values that a script and the service exchange, and the script's news of itself.
#[derive(Debug, Default)]
struct Exchange {
    now: Option<Instant>,
    step: Option<Step>,
    done: Option<Done>,
    /// The owner's call, unless it asks for the end.
    asked: Option<Asked>,
    dropped: Option<Text<REASON_MAX>>,
    ending: Option<Ending>,
    /// The owner has asked for the end.
    is_stopped: bool,
    /// The end has begun.
    is_end: bool,
    /// The client that has ended the script's work on the board, as of the latest outcome.
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

/// The script's side of the exchange: asks for steps and receives their outcomes.
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

    /// Why the script ends, if neither the script nor its owner has ended it.
    pub(super) fn ending(&self) -> Option<Ending> {
        self.with(|exchange| exchange.ending)
    }

    /// The client that has ended the script's work on the board, as far as the daemon knows.
    pub(super) fn ended_by(&self) -> Option<String> {
        self.with(|exchange| exchange.ended_by.clone())
    }

    /// The work that the end still has to do on the board, while it waits for another client.
    pub(super) fn unfinished(&self) -> Option<String> {
        self.with(|exchange| exchange.unfinished.clone())
    }

    pub(super) fn set_unfinished(&self, unfinished: Option<String>) {
        self.with(|exchange| exchange.unfinished = unfinished);
    }

    /// Whether an end has come for the script.
    pub(super) fn is_ended(&self) -> bool {
        self.with(|exchange| exchange.is_ended())
    }

    /// Why the script may send only the lines of its end, once a client has stopped all motion.
    pub(super) fn dropped(&self) -> Option<Text<REASON_MAX>> {
        self.with(|exchange| exchange.dropped)
    }

    /// Notes whether the lines so far have opened a program buffer and have not closed it.
    pub(super) fn set_inside(&self, is_inside: bool) {
        self.with(|exchange| exchange.is_inside = is_inside);
    }

    /// The end leaves this many lines that no client expects, in the rotary buffers of the coordinate systems that the
    /// script feeds.
    pub(super) fn leaves(&self, lines: u64) {
        self.with(|exchange| exchange.leaves = Some(lines));
    }

    /// Whether the owner has called since the last check.
    pub(super) fn take_asked(&self) -> bool {
        self.with(|exchange| exchange.asked.take().is_some())
    }

    /// Runs `part` until it fails, or until the script is ended and `part` would begin another step. Then the end
    /// begins. Returns the failure, if `part` failed.
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

    /// Begins the end: all later steps belong to it.
    pub(super) fn begin_end(&self) {
        self.with(|exchange| (exchange.step, exchange.is_end) = (None, true));
    }

    /// Has the bus thread carry out a request, and returns the outcome.
    pub(super) async fn request(&self, request: Request) -> Done {
        let timeout = if self.with(|exchange| exchange.is_end) { END_STEP } else { STEP };
        self.request_within(request, timeout).await
    }

    /// As [`Self::request`], within `timeout`.
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

    /// Finds out whether the board was reset since the last check.
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

    /// Answers the owner's call and every client that waits for the end: the end goes on without them.
    pub(super) async fn answer_end(&self, reply: Result<Reply, CallError>) {
        self.pass(Step::AnswerEnd(reply)).await;
    }

    /// Waits until the moment `until`, or until the owner calls.
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

    /// Waits for `pause`, or until the owner calls.
    pub(super) async fn rest(&self, pause: Duration) {
        self.rest_until(self.now() + pause).await;
    }

    /// Waits until the owner calls or an end comes. Returns the call.
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

/// The service's side of a script.
pub struct Script {
    resource: Resource,
    name: String,
    feeds: Systems,
    io: Io,
    run: Run,
}

impl Script {
    /// The script `run`, before its first step.
    pub(super) fn new<F>(resource: Resource, name: &str, run: impl FnOnce(Io) -> F) -> Self
    where
        F: Future<Output = Result<Reply, CallError>> + Send + 'static,
    {
        let io = Io::default();
        let name = name.to_owned();
        Self { resource, name, feeds: Systems::NONE, run: Box::pin(run(io.clone())), io }
    }

    /// Marks the script as feeding the programs of these coordinate systems.
    pub(super) fn feeding(self, feeds: Systems) -> Self {
        Self { feeds, ..self }
    }

    /// The part of the board that the script holds.
    pub const fn resource(&self) -> Resource {
        self.resource
    }

    /// The script's name for people: `download`, `gather`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The coordinate systems whose programs the script feeds. An abort of any of them ends the script.
    pub const fn feeds(&self) -> Systems {
        self.feeds
    }

    /// Whether the script's lines so far have opened a program buffer and have not closed it. If another sender has
    /// closed the buffer, the daemon refuses the script's next line: the board would carry it out at once.
    pub fn is_inside(&self) -> bool {
        self.io.with(|exchange| exchange.is_inside)
    }

    /// How many lines that no client expects the end leaves in the rotary buffers of the coordinate systems that the
    /// script feeds; `None` if the script has changed nothing there. Known once the script is over.
    pub fn leaves(&self) -> Option<u64> {
        self.io.with(|exchange| exchange.leaves)
    }

    /// The work that the end still has to do on the board, if it waits for another client.
    pub fn unfinished(&self) -> Option<String> {
        self.io.unfinished()
    }

    /// The next step. `done` is the outcome of the bus thread's last step; `None` at the beginning, and after every
    /// other step.
    pub fn next(&mut self, done: Option<Done>, now: Instant) -> Step {
        let is_answered = self.io.with(|exchange| {
            exchange.now = Some(now);
            exchange.done = done.or(exchange.done.take());
            exchange.is_end && exchange.asked.take().is_some()
        });
        if is_answered {
            // The owner learns by its call for the end how the script ended.
            return Step::Answer(Ok(Reply::done()));
        }
        match self.run.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
            Poll::Ready(reply) => Step::Over(reply),
            Poll::Pending => self.io.with(|exchange| exchange.step.take()).unwrap_or(Step::Rest),
        }
    }

    /// The owner calls: the steps that follow are for this call.
    ///
    /// # Errors
    /// The answer to the owner instead; nothing changes then.
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

    /// A client has stopped all motion, and the daemon drops the lines that wait, for this reason. The script must not
    /// send its later lines either.
    pub fn drop_lines(&self, reason: Text<REASON_MAX>) {
        self.io.with(|exchange| exchange.dropped = Some(reason));
    }

    /// Ends the script, for this reason. The service calls this once.
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
