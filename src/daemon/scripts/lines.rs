//! A sequence of command lines: a download, a restore, a backup, a set-up.
//!
//! The lines come in batches. The daemon sends each line once the board has answered the line before, and tells the
//! owner the reply. A line that fails ends the sequence, unless the owner lets the sequence go on after lines that the
//! board refuses. Every end closes a buffer that the sequence's lines have opened.
//!
//! While no buffer of its own is open, the sequence has the daemon check now and then, and at its beginning and end,
//! that the board was not reset: a reset erases the effect of earlier lines. The first check also finds out whether
//! another sender has a program buffer open.

use std::collections::VecDeque;
use std::time::Duration;

use log::warn;

use super::put_back::PutBack;
use super::script::{Io, Script};
use super::{Asked, Done, END_STEP, Request, Resource};
use crate::daemon::shared::open_buffer::{Barred, OpenBuffer, Writer};
use crate::daemon::shared::queue::{DEFAULT_TIMEOUT, Line, Outcome};
use crate::protocol::board::{LineFailure, LineOutcome, RunLinesReply};
use crate::protocol::cut_off;
use crate::protocol::{CallError, RUN_LINES_MAX, Reply, calls, check_line};

/// How often the end tries `CLOSE` while the daemon has certainly not sent it, and the pause between tries.
const CLOSE_TRIES: u32 = 3;
const CLOSE_AGAIN: Duration = Duration::from_millis(100);
/// Lines after which a check is due.
const CHECK_EVERY: u64 = 64;
/// The most lines for the end.
const AT_END_MAX: usize = 8;
/// The longest name of a sequence.
const NAME_MAX: usize = 20;

/// The error for a line of a buffer that the board has refused to open.
const NOT_OPENED: &str =
    "not sent, it would have been carried out at once: the board has not opened its program buffer";
/// No program buffer is open that would take the line. `LEARN` and lines for another kind of buffer get this error,
/// too.
const NO_BUFFER: u16 = 5;

/// Lines to send, and how.
#[derive(Debug, Default)]
pub struct Batch {
    kind: String,
    lines: VecDeque<Line>,
    timeout: Duration,
    keep_going: bool,
    at_end: Option<VecDeque<Line>>,
    last: bool,
    confirmed: bool,
}

impl Batch {
    /// Every line that the batch may send.
    pub fn all_lines(&self) -> impl Iterator<Item = &Line> {
        self.lines.iter().chain(self.at_end.iter().flatten())
    }

    /// The kind of the batch's sequence: `download`.
    pub fn kind(&self) -> &str {
        &self.kind
    }

    /// Whether the caller has confirmed the batch's effect on every user.
    pub const fn confirmed(&self) -> bool {
        self.confirmed
    }

    /// The batch that `call` asks for.
    ///
    /// # Errors
    /// The fault in the call; the daemon sends nothing then.
    pub fn of(call: calls::RunLines) -> Result<Self, CallError> {
        let calls::RunLines { kind, lines, timeout_ms, keep_going, at_end, last, confirmed } = call;
        let is_name =
            (1..=NAME_MAX).contains(&kind.len()) && kind.bytes().all(|byte| byte.is_ascii_lowercase());
        if !is_name {
            return Err(CallError::invalid("kind", format_args!("1 to {NAME_MAX} lower-case letters")));
        }
        if lines.len() > RUN_LINES_MAX {
            let expected = format_args!("at most {RUN_LINES_MAX} lines a call, not {}", lines.len());
            return Err(CallError::invalid("lines", expected));
        }
        if at_end.as_ref().is_some_and(|lines| lines.len() > AT_END_MAX) {
            return Err(CallError::invalid("at_end", format_args!("at most {AT_END_MAX} lines")));
        }
        let confirmed = confirmed == Some(true);
        let (lines, at_end) = (checked(&lines)?, at_end.map(|lines| checked(&lines)).transpose()?);
        let mut all = lines.iter().chain(at_end.iter().flatten());
        if let Some(line) = all.find(|line| line.meaning.settings.cuts_off.is_certain() && !confirmed) {
            return Err(cut_off::refusal(line, line.meaning.settings.cuts_off));
        }
        Ok(Self {
            lines,
            at_end,
            kind,
            timeout: timeout_ms.map_or(DEFAULT_TIMEOUT, Duration::from_millis),
            keep_going: keep_going.unwrap_or(false),
            last: last.unwrap_or(true),
            confirmed,
        })
    }

    /// Whether the batch only ends its sequence.
    pub fn only_ends(&self) -> bool {
        self.lines.is_empty() && self.last
    }
}

/// Checks `lines`, and returns them in the form to send.
fn checked(lines: &[String]) -> Result<VecDeque<Line>, CallError> {
    let checked = lines.iter().map(|line| {
        check_line(line)
            .map_err(|reason| CallError::InvalidLine { reason: format!("{line:?}: {reason}") })?;
        Ok(Line::of(line))
    });
    checked.collect()
}

/// The state of a sequence of lines.
#[derive(Default)]
struct Lines {
    io: Io,
    kind: String,
    batch: Batch,
    /// The number of the line to send next, or under way.
    number: u64,
    taken: u64,
    /// The buffer that the lines have opened.
    buffer: OpenBuffer,
    /// The board has refused the line that was to open the buffer. The error may come from a later command of the line:
    /// the buffer counts as open until the board tells.
    open_refused: bool,
    /// The daemon leaves out the lines up to the next that opens or closes a buffer: the board did not open theirs.
    leaves_out: bool,
    /// Lines that the open buffer has taken.
    entered: u64,
    /// A line has failed.
    failed: bool,
    /// A reset may be the cause: the board has neither refused the line itself nor said that no buffer is open for it.
    is_unexplained: bool,
    /// The number of resets that the first answered check told; `None` before it.
    resets: Option<u64>,
    /// The sequence's own line has reset the board: the daemon checks no more.
    has_reset: bool,
    /// The lines sent at the last check, if there was one, and the doubts then.
    checked: Option<u64>,
    doubts: u64,
    /// The doubts at the last answer.
    doubts_now: u64,
    /// The board was reset, or may have been.
    reset: Option<LineFailure>,
    /// A buffer that the sequence's lines opened, and the note on its end, except for a reset.
    buffer_left: Option<(String, String)>,
    put_back: PutBack,
}

/// The script of a sequence that begins with this batch.
pub fn lines(mut batch: Batch) -> Script {
    let kind = batch.kind.clone();
    let put_back = PutBack::new(batch.at_end.take().unwrap_or_default());
    Script::new(Resource::Lines, &kind.clone(), move |io| async move {
        let mut lines = Lines { io, kind, batch, put_back, ..Lines::default() };
        lines.send_batches().await?;
        lines.end().await
    })
}

impl Lines {
    /// Sends the lines of batch after batch, until the last line is done, a line has failed, or the sequence ends.
    ///
    /// # Errors
    /// Why the sequence cannot begin.
    async fn send_batches(&mut self) -> Result<(), CallError> {
        while !self.failed && !self.io.is_ended() {
            if let Some(question) = self.put_back.question() {
                let asked = self.io.request_within(question, END_STEP).await;
                self.put_back.learn(&asked);
                continue;
            }
            if let Some(reason) = self.io.dropped()
                && self.batch.lines.pop_front().is_some()
            {
                self.failed = true;
                self.leave_out(reason.to_string()).await;
                continue;
            }
            self.leaves_out &= self.batch.lines.front().is_none_or(|line| line.meaning.buffer.is_none());
            if self.leaves_out && self.batch.lines.pop_front().is_some() {
                self.leave_out(NOT_OPENED.to_owned()).await;
                continue;
            }
            if self.check_is_due() {
                self.check().await?;
                continue;
            }
            if let Some(line) = self.batch.lines.pop_front() {
                let timeout = line.meaning.deadline(self.batch.timeout);
                let done = self.io.request_within(Request::Line(line), timeout).await;
                let told = self.line_done(line, done);
                self.io.tell(told).await;
            } else if self.batch.last {
                break;
            } else {
                let taken = RunLinesReply { taken: self.taken, ..RunLinesReply::default() };
                self.io.answer(Ok(reply(&taken))).await;
                self.next_batch().await;
            }
        }
        Ok(())
    }

    /// Rests until the owner sends more lines, or the sequence ends.
    async fn next_batch(&mut self) {
        if let Some(Asked::Lines(mut batch)) = self.io.asked().await {
            if let Some(lines) = batch.at_end.take() {
                self.put_back.renewed(lines);
            }
            self.batch = batch;
        }
    }

    /// Checks whether the board was reset, before the next line.
    ///
    /// # Errors
    /// Why the sequence cannot begin.
    async fn check(&mut self) -> Result<(), CallError> {
        let done = self.io.check().await;
        // The user who stops all motion also means the line after the check.
        if let Outcome::Dropped(_) = done.outcome
            && let Some(line) = self.batch.lines.pop_front()
        {
            let told = self.line_done(line, done);
            self.io.tell(told).await;
            return Ok(());
        }
        self.check_done(done).map_or(Ok(()), Err)
    }

    /// The board has answered the line under way, or has failed to.
    fn line_done(&mut self, line: Line, done: Done) -> Reply {
        let number = self.number;
        self.number += 1;
        self.doubts_now = done.doubts;
        self.has_reset |= line.meaning.resets;
        let was_open = self.buffer.is_open();
        if !done.outcome.is_unsent() {
            self.buffer.begin(&line.meaning, Writer::Question, self.io.now());
            self.put_back.sent(&line);
        }
        match done.outcome {
            Outcome::Done => self.buffer.done(&line.meaning),
            // `FOO CLOSE`: whether the board has closed the buffer is not known.
            Outcome::Error(code) => self.buffer.refused(&line.meaning, code),
            _ => {}
        }
        if line.meaning.opens() {
            self.open_refused = matches!(done.outcome, Outcome::Error(_));
        }
        let is_unopened = self.open_refused && done.outcome == Outcome::Barred(Barred::Closed);
        if done.outcome == Outcome::Barred(Barred::Closed) {
            let by = done.ended_by.as_deref();
            self.leave_buffer(|name, entered| {
                if is_unopened { not_opened(name) } else { closed_by_others(name, entered, by) }
            });
        }
        let (lines, failure) = match done.result {
            Ok(lines) => (lines, None),
            // A board that resets need not acknowledge it.
            Err(_) if done.outcome == Outcome::TimedOut && line.meaning.resets => (Vec::new(), None),
            Err(mut error) => {
                let mut failure = failure_of(done.outcome, &error);
                if is_unopened {
                    failure.message = NOT_OPENED.to_owned();
                }
                (error.take_lines(), Some(failure))
            }
        };
        self.io.set_inside(self.buffer.is_open());
        self.taken += u64::from(failure.is_none());
        match (was_open, self.buffer.is_open()) {
            (true, true) => self.entered += u64::from(failure.is_none()),
            _ => self.entered = 0,
        }
        self.leaves_out = self.batch.keep_going && is_unopened;
        let goes_on = self.batch.keep_going && (is_unopened || matches!(done.outcome, Outcome::Error(_)));
        self.failed |= failure.is_some() && !goes_on;
        self.is_unexplained = failure.is_some()
            && match done.outcome {
                Outcome::Error(code) => was_open && code == NO_BUFFER,
                _ => true,
            };
        reply(&RunLinesReply {
            line: Some(number),
            lines,
            failure,
            taken: self.taken,
            ..RunLinesReply::default()
        })
    }

    /// Leaves out the next line.
    async fn leave_out(&mut self, message: String) {
        let failure = LineFailure { outcome: LineOutcome::NotSent, code: None, message };
        self.number += 1;
        let told = reply(&RunLinesReply {
            line: Some(self.number - 1),
            failure: Some(failure),
            taken: self.taken,
            ..RunLinesReply::default()
        });
        self.io.tell(told).await;
    }

    /// Whether to ask the board now if it was reset.
    fn check_is_due(&self) -> bool {
        let is_due = self.checked.is_none_or(|checked| self.number >= checked + CHECK_EVERY)
            || self.doubts_now != self.doubts;
        is_due && !self.has_reset && !self.buffer.is_open() && !self.batch.lines.is_empty()
    }

    /// Takes the outcome of a check. Returns the refusal if the sequence cannot begin.
    fn check_done(&mut self, done: Done) -> Option<CallError> {
        let checked = self.checked.replace(self.number).unwrap_or(0);
        let has_doubts = std::mem::replace(&mut self.doubts, done.doubts) != done.doubts;
        self.doubts_now = done.doubts;
        let Some(resets) = self.resets else {
            let is_barred = self.number == 0 && matches!(done.outcome, Outcome::Barred(_));
            // Without an answer, a reset that a later check finds may be older than the sequence.
            self.resets = done.result.is_ok().then_some(done.resets);
            return done.result.err().filter(|_| is_barred);
        };
        // A board that could not be asked may have been reset.
        let is_unknown = has_doubts && done.result.is_err();
        if done.resets != resets || is_unknown {
            let may = if is_unknown { "may have been" } else { "was" };
            if let Some((name, note)) = self.buffer_left.as_mut().filter(|_| !is_unknown) {
                *note = format!("{name}, which it opened, is closed: the reset took what entered it");
            }
            let message = format!(
                "the board {may} reset between line {} and line {} of the sequence; what lines up to there have set is gone unless \
                 it was saved",
                checked.max(1),
                self.number
            );
            self.reset = Some(LineFailure { outcome: LineOutcome::Reset, code: None, message });
            self.failed = true;
        }
        None
    }

    /// The end: `CLOSE` if a buffer is open, the last check, and the lines that put variables back.
    async fn end(mut self) -> Result<Reply, CallError> {
        self.io.begin_end();
        self.close().await;
        let is_explained = self.failed && !self.is_unexplained;
        let is_checked = self.checked.unwrap_or(0) == self.number;
        if !(self.has_reset || is_explained || self.io.is_ended() || is_checked) {
            let done = self.io.check().await;
            self.check_done(done);
        }
        if self.number > 0 {
            let mut put_back = std::mem::take(&mut self.put_back);
            let result = |notes| Ok(self.result(notes));
            put_back.carry_out(&self.io, &self.kind, result).await;
            self.put_back = put_back;
        }
        Ok(self.result(self.put_back.notes()))
    }

    /// Closes the buffer that the sequence's lines have opened.
    async fn close(&mut self) {
        for tries in 1..=CLOSE_TRIES {
            if !self.buffer.is_open() && !self.buffer.has_binary() {
                return;
            }
            let done = self.io.line("CLOSE").await;
            let is_barred = done.outcome == Outcome::Barred(Barred::Closed);
            if done.outcome.is_unsent() && !is_barred && done.result.is_err() && tries < CLOSE_TRIES {
                self.io.rest(CLOSE_AGAIN).await;
                continue;
            }
            self.closed(&done);
        }
    }

    /// Notes the buffer's end: the board has answered `CLOSE`, or has failed to.
    fn closed(&mut self, done: &Done) {
        let is_cut_short = self.failed || self.io.is_ended();
        let open_refused = self.open_refused;
        self.leave_buffer(|name, entered| match &done.result {
            _ if done.outcome == Outcome::Barred(Barred::Closed) && open_refused => not_opened(name),
            _ if done.outcome == Outcome::Barred(Barred::Closed) => {
                closed_by_others(name, entered, done.ended_by.as_deref())
            }
            Err(error) => format!(
                "{name}, which it opened, may still be open: {entered} entered it, and CLOSE failed ({error}); send CLOSE"
            ),
            Ok(_) if is_cut_short => format!(
                "{name}, which it opened, is incomplete: {entered} entered it; it is closed now"
            ),
            Ok(_) => format!("{name} was left open; it is closed now"),
        });
    }

    /// The owner's reply in the end.
    fn result(&self, mut notes: Vec<String>) -> Reply {
        notes.extend(self.io.unfinished());
        notes.iter().for_each(|note| warn!("the end of a {}: {note}", self.kind));
        notes.extend(self.buffer_left.as_ref().map(|(_, note)| note.clone()));
        let failure = self.reset.clone();
        reply(&RunLinesReply {
            line: failure.as_ref().map(|_| self.number.saturating_sub(1)),
            failure,
            taken: self.taken,
            notes,
            over: true,
            ..RunLinesReply::default()
        })
    }

    /// The sequence's buffer is no longer open, or the daemon can do no more about it. `note` makes the note of the
    /// buffer's name and the number of its lines.
    fn leave_buffer(&mut self, note: impl FnOnce(&str, &str) -> String) {
        let name = self.buffer.opened().map_or(String::new(), |opened| opened.name.to_string());
        let entered = self.entered;
        let note = note(&name, &format!("{entered} line{}", if entered == 1 { "" } else { "s" }));
        self.buffer_left = Some((name, note));
        self.buffer = OpenBuffer::default();
        self.io.set_inside(false);
    }
}

/// The note on a buffer that another sender has closed: `by`, if the daemon knows the sender.
fn closed_by_others(name: &str, entered: &str, by: Option<&str>) -> String {
    let by = by.map_or_else(String::new, |by| format!(" ({by})"));
    format!("{name}, which it opened, was closed by somebody else{by}: {entered} entered it")
}

/// The note on a buffer that the board has not opened, and for which the daemon has sent no line.
fn not_opened(name: &str) -> String {
    format!("{name} was not opened")
}

/// The meaning of a step's failure for its line.
fn failure_of(outcome: Outcome, error: &CallError) -> LineFailure {
    let (outcome, code) = match outcome {
        Outcome::Error(code) => (LineOutcome::Refused, Some(code)),
        outcome if outcome.is_unsent() => (LineOutcome::NotSent, None),
        _ => (LineOutcome::Uncertain, None),
    };
    LineFailure { outcome, code, message: error.to_string() }
}

/// A reply, which always serialises as an object.
fn reply(content: &RunLinesReply) -> Reply {
    Reply::with(content).unwrap_or_default()
}
