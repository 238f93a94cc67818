//! A sequence of command lines: a download, a restore, a backup, a set-up.
//!
//! The lines come in batches. Each is sent when the board has answered the one before, and its reply is told. A line
//! that fails ends the sequence, unless it goes on after lines that the board refuses. A buffer that its lines have opened
//! is closed at the end, whatever the end is.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use super::{Done, END_STEP, Ending, Resource, Sequence, SequenceCall, Step, is_unsent};
use crate::daemon::shared::queue::{DEFAULT_TIMEOUT, LINE_MAX, Outcome, Text};
use crate::protocol::board::{LineFailure, LineOutcome, RunLinesReply};
use crate::protocol::{CallError, OpenBuffer, RUN_LINES_MAX, Reply, calls, check_line};

/// How often `CLOSE` is tried at the end, while it is known not to have been sent, and how long after the last try.
const CLOSE_TRIES: u32 = 3;
const CLOSE_AGAIN: Duration = Duration::from_millis(100);
/// The longest name of a sequence.
const NAME_MAX: usize = 20;

/// Lines to send, and how.
#[derive(Debug)]
pub struct Batch {
    kind: String,
    lines: VecDeque<Text<LINE_MAX>>,
    timeout: Duration,
    keep_going: bool,
    last: bool,
}

impl Batch {
    /// The batch that `call` asks for.
    ///
    /// # Errors
    /// What is wrong with it; nothing is sent then.
    pub(in crate::daemon::socket) fn of(call: calls::RunLines) -> Result<Self, CallError> {
        let calls::RunLines { kind, lines, timeout_ms, keep_going, last } = call;
        let is_name =
            (1..=NAME_MAX).contains(&kind.len()) && kind.bytes().all(|byte| byte.is_ascii_lowercase());
        if !is_name {
            return Err(CallError::invalid("kind", format_args!("1 to {NAME_MAX} lower-case letters")));
        }
        if lines.len() > RUN_LINES_MAX {
            let expected = format_args!("at most {RUN_LINES_MAX} lines a call, not {}", lines.len());
            return Err(CallError::invalid("lines", expected));
        }
        let checked = lines.iter().map(|line| {
            check_line(line)
                .map_err(|reason| CallError::InvalidLine { reason: format!("{line:?}: {reason}") })?;
            Ok(Text::from_bytes(line.as_bytes()))
        });
        Ok(Self {
            lines: checked.collect::<Result<_, _>>()?,
            kind,
            timeout: timeout_ms.map_or(DEFAULT_TIMEOUT, Duration::from_millis),
            keep_going: keep_going.unwrap_or(false),
            last: last.unwrap_or(true),
        })
    }
}

/// How far it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// Lines are sent.
    Sending,
    /// The line under way is sent.
    UnderWay(Text<LINE_MAX>),
    /// `CLOSE` has been tried so often.
    Closing(u32),
    /// As before, and it is tried again soon.
    ClosingAgain(u32),
}

/// The sequence.
#[derive(Debug)]
pub(in crate::daemon::socket) struct Lines {
    batch: Batch,
    phase: Phase,
    /// The number of the line that is sent next, or is under way.
    number: u64,
    taken: u64,
    /// What its lines have opened.
    buffer: OpenBuffer,
    /// Lines that the open buffer has taken.
    entered: u64,
    /// A line has failed.
    failed: bool,
    ending: Option<Ending>,
    notes: Vec<String>,
}

impl Lines {
    /// Begins with this batch.
    pub(in crate::daemon::socket) fn new(batch: Batch) -> Self {
        Self {
            batch,
            phase: Phase::Sending,
            number: 0,
            taken: 0,
            buffer: OpenBuffer::default(),
            entered: 0,
            failed: false,
            ending: None,
            notes: Vec::new(),
        }
    }

    /// The board has answered the line under way, or not.
    fn line_done(&mut self, line: Text<LINE_MAX>, done: Done) -> Reply {
        let number = self.number;
        self.number += 1;
        let was_open = self.buffer.is_open();
        if !is_unsent(done.outcome) {
            // Counted as open even if the board refuses the line: an error may follow what opened it.
            self.buffer.follow(line.as_bytes());
        }
        let (lines, failure) = match done.result {
            Ok(lines) => (lines, None),
            Err(mut error) => {
                let lines = error.take_lines();
                (lines, Some(failure_of(done.outcome, &error)))
            }
        };
        self.taken += u64::from(failure.is_none());
        match (was_open, self.buffer.is_open()) {
            (true, true) => self.entered += u64::from(failure.is_none()),
            _ => self.entered = 0,
        }
        let goes_on = self.batch.keep_going && matches!(done.outcome, Outcome::Error(_));
        self.failed |= failure.is_some() && !goes_on;
        reply(&RunLinesReply {
            line: Some(number),
            lines,
            failure,
            taken: self.taken,
            ..RunLinesReply::default()
        })
    }

    /// What comes when no line is sent any more: `CLOSE`, if a buffer is open, then the end.
    fn close(&mut self, tries: u32) -> Step {
        if self.buffer.is_open() && tries < CLOSE_TRIES {
            self.phase = Phase::Closing(tries + 1);
            return Step::Line { line: Text::from_bytes(b"CLOSE"), timeout: END_STEP };
        }
        let notes = std::mem::take(&mut self.notes);
        Step::Over(Ok(reply(&RunLinesReply {
            taken: self.taken,
            notes,
            over: true,
            ..RunLinesReply::default()
        })))
    }

    /// `CLOSE` has been answered, or not.
    fn closed(&mut self, tries: u32, done: &Done, now: Instant) -> Step {
        let entered = self.entered;
        let note = match &done.result {
            Err(_) if is_unsent(done.outcome) && tries < CLOSE_TRIES => {
                self.phase = Phase::ClosingAgain(tries);
                return Step::Wait(now + CLOSE_AGAIN);
            }
            Err(error) => format!(
                "the program buffer that it opened may still be open, with {entered} lines of it taken: CLOSE failed ({error}); \
                 send CLOSE"
            ),
            Ok(_) if self.failed || self.ending.is_some() => format!(
                "the program buffer that it opened is closed now and incomplete: {entered} lines entered it"
            ),
            Ok(_) => "a buffer was left open; it is closed now".to_owned(),
        };
        self.notes.push(note);
        self.buffer = OpenBuffer::default();
        self.close(tries)
    }
}

impl Sequence for Lines {
    fn resource(&self) -> Resource {
        Resource::Lines
    }

    fn name(&self) -> &str {
        &self.batch.kind
    }

    fn next(&mut self, done: Option<Done>, now: Instant) -> Step {
        match (self.phase, done) {
            (Phase::UnderWay(line), Some(done)) => {
                self.phase = Phase::Sending;
                return Step::Tell(self.line_done(line, done));
            }
            (Phase::Closing(tries), Some(done)) => return self.closed(tries, &done, now),
            (Phase::ClosingAgain(tries), _) => return self.close(tries),
            _ => {}
        }
        if self.failed || self.ending.is_some() {
            return self.close(0);
        }
        match self.batch.lines.pop_front() {
            Some(line) => {
                self.phase = Phase::UnderWay(line);
                Step::Line { line, timeout: self.batch.timeout }
            }
            None if self.batch.last => self.close(0),
            None => Step::Answer(Ok(reply(&RunLinesReply { taken: self.taken, ..RunLinesReply::default() }))),
        }
    }

    fn asked(&mut self, call: SequenceCall, _: Instant) -> Result<(), CallError> {
        match call {
            SequenceCall::Lines(batch) if batch.kind == self.batch.kind => {
                self.batch = batch;
                Ok(())
            }
            _ => Err(CallError::Refused {
                reason: format!("this connection has a {}, which must end first", self.name()),
            }),
        }
    }

    fn end(&mut self, why: Ending) {
        self.ending = Some(why);
    }
}

/// What a step's failure means for its line.
fn failure_of(outcome: Outcome, error: &CallError) -> LineFailure {
    let (outcome, code) = match outcome {
        Outcome::Error(code) => (LineOutcome::Refused, Some(code)),
        outcome if is_unsent(outcome) => (LineOutcome::NotSent, None),
        _ => (LineOutcome::Uncertain, None),
    };
    LineFailure { outcome, code, message: error.to_string() }
}

/// A reply, which always serialises as an object.
fn reply(content: &RunLinesReply) -> Reply {
    Reply::with(content).unwrap_or_default()
}
