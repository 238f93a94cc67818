//! The lines that the end of a sequence puts back.
//!
//! A line `NAME=VALUE` puts back a variable: the daemon asks the board for its value after each line that sets it, and
//! again at the end. The end puts the variable back if it still has the sequence's value, and leaves it alone if
//! another sender has set another value meanwhile. While a program buffer is open the line would enter that buffer: the
//! daemon sends the line once the buffer is closed.

use std::collections::VecDeque;
use std::time::Duration;

use super::end_retry::{EndRetry, is_kept_back, was_set_meanwhile};
use super::script::Io;
use super::{Done, Request};
use crate::daemon::shared::queue::{Line, Outcome};
use crate::protocol::{CallError, Reply, answer};

/// How long the end retries lines that the daemon has certainly not sent.
const PUT_BACK_TRIED: Duration = Duration::from_secs(10);

/// A line of the end.
#[derive(Debug)]
struct Entry {
    line: Line,
    /// The variable that the line puts back, and its value.
    variable: Option<(String, String)>,
    /// The board's value of the variable after the sequence had set it.
    ours: Option<String>,
    is_set: bool,
}

impl Entry {
    fn new(line: Line) -> Self {
        let variable = variable_of(&line);
        Self { line, variable, ours: None, is_set: false }
    }

    fn is_back(&self) -> bool {
        self.variable.as_ref().is_some_and(|(_, old)| self.ours.as_ref() == Some(old))
    }

    /// Sends the line. A line that puts back a variable goes only if the variable still has the sequence's value.
    /// Returns the note for the owner, and the outcome of a step that may be tried again.
    async fn carry_out(&self, io: &Io) -> (Option<String>, Option<Outcome>) {
        if let Some((name, old)) = &self.variable {
            let asked = io.ask(name).await;
            let found = match &asked.result {
                Ok(_) => value(&asked),
                Err(error) => {
                    let may_go = asked.outcome.is_unsent() || asked.outcome == Outcome::TimedOut;
                    return (self.failed(error), may_go.then_some(asked.outcome));
                }
            };
            match found {
                Some(found) if found == *old => return (None, None),
                Some(found) if self.ours.as_ref().is_some_and(|ours| *ours != found) => {
                    return (Some(was_set_meanwhile(name, &found)), None);
                }
                _ => {}
            }
        }
        let sent = io.line(&self.line).await;
        let note = sent.result.err().and_then(|error| self.failed(&error));
        (note, sent.outcome.is_unsent().then_some(sent.outcome))
    }

    fn failed(&self, error: &CallError) -> Option<String> {
        let text = &*self.line;
        (!self.is_back()).then(|| format!("{text:?}, which puts the board back, failed: {error}"))
    }
}

/// The variable that `line` sets, and the value.
fn variable_of(line: &Line) -> Option<(String, String)> {
    let text = line.to_string();
    let (name, value) = text.split_once('=')?;
    let is_name = name.bytes().all(|byte| byte.is_ascii_alphanumeric());
    is_name.then(|| (name.to_ascii_uppercase(), value.trim().to_owned()))
}

/// The lines of the end that the board has not carried out.
#[derive(Debug, Default)]
pub(super) struct PutBack {
    entries: VecDeque<Entry>,
    notes: Vec<String>,
}

impl PutBack {
    /// These lines.
    pub(super) fn new(lines: VecDeque<Line>) -> Self {
        let entries = lines.into_iter().map(Entry::new).collect();
        Self { entries, notes: Vec::new() }
    }

    /// The lines for the same end in a later call.
    pub(super) fn renewed(&mut self, lines: VecDeque<Line>) {
        let mut old = std::mem::take(&mut self.entries);
        self.entries = lines.into_iter().map(Entry::new).collect();
        for entry in &mut self.entries {
            if let Some(known) = old.iter_mut().find(|known| *known.line == *entry.line) {
                (entry.ours, entry.is_set) = (known.ours.take(), known.is_set);
            }
        }
    }

    /// The sequence has sent `line`.
    pub(super) fn sent(&mut self, line: &Line) {
        let Some((name, _)) = variable_of(line) else { return };
        let is_it = |entry: &&mut Entry| entry.variable.as_ref().is_some_and(|(other, _)| *other == name);
        if let Some(entry) = self.entries.iter_mut().find(is_it) {
            (entry.ours, entry.is_set) = (None, true);
        }
    }

    /// The question to the board after the lines so far.
    pub(super) fn question(&self) -> Option<Request> {
        let (name, _) = self.entries.iter().find(|entry| entry.is_set)?.variable.as_ref()?;
        Some(Request::Ask(Line::of(name)))
    }

    /// Takes the answer to that question. Without an answer, the value found at the end counts as set by the sequence.
    pub(super) fn learn(&mut self, done: &Done) {
        if let Some(entry) = self.entries.iter_mut().find(|entry| entry.is_set) {
            entry.is_set = false;
            entry.ours = value(done);
        }
    }

    /// Carries the lines out, for a sequence of this `kind`. If that takes long, the owner hears the `result` of the
    /// notes so far.
    pub(super) async fn carry_out(
        &mut self,
        io: &Io,
        kind: &str,
        result: impl Fn(Vec<String>) -> Result<Reply, CallError>,
    ) {
        let mut retry = EndRetry::new(PUT_BACK_TRIED, true);
        while let Some(entry) = self.entries.front() {
            let (note, may_go) = entry.carry_out(io).await;
            if let Some(outcome) = may_go.filter(|_| entry.variable.is_some() && !entry.is_back())
                && retry.rests(io, outcome, self.unfinished(kind), || result(self.notes.clone())).await
            {
                // Another sender may have set another value meanwhile: asks the board again.
                continue;
            }
            self.notes.extend(note);
            self.entries.pop_front();
            if retry.is_kept_back() {
                io.set_unfinished(self.unfinished(kind));
            }
        }
    }

    /// The notes on steps that failed.
    pub(super) fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    /// The work of a sequence of this `kind` that waits for an open program buffer.
    fn unfinished(&self, kind: &str) -> Option<String> {
        let kept = self.entries.iter().filter(|entry| !entry.is_back()).filter_map(|entry| {
            let (name, old) = entry.variable.as_ref()?;
            Some(is_kept_back(name, entry.ours.as_deref().unwrap_or("set"), old, kind))
        });
        let kept: Vec<String> = kept.collect();
        (!kept.is_empty()).then(|| kept.join("; "))
    }
}

fn value(done: &Done) -> Option<String> {
    let lines = done.result.as_ref().ok()?;
    lines.first().map(|line| answer::text(line).to_owned())
}
