//! What the end of a sequence of lines puts back.
//!
//! A line `NAME=VALUE` puts back a variable: the board is asked what it is after each line that sets it, and again at the end.
//! It is put back where it still is what the sequence has set, and left alone where somebody has set another value meanwhile.
//! While somebody has a program buffer open the line would enter that: it is sent when the buffer is closed.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use super::end_retry::{EndRetry, is_kept_back, was_set_meanwhile};
use super::{Done, END_STEP, Step, ask};
use crate::daemon::shared::queue::{LINE_MAX, Outcome, Text};
use crate::protocol::answer;

/// How long what is known not to have been sent is tried.
const PATIENCE: Duration = Duration::from_secs(10);

/// A line of the end.
#[derive(Debug)]
struct Entry {
    line: Text<LINE_MAX>,
    /// The variable that it puts back, and its value.
    variable: Option<(String, String)>,
    /// What the board has said of the variable after the sequence had set it.
    ours: Option<String>,
    is_set: bool,
}

impl Entry {
    fn new(line: Text<LINE_MAX>) -> Self {
        let variable = variable_of(&line);
        Self { line, variable, ours: None, is_set: false }
    }

    fn is_back(&self) -> bool {
        self.variable.as_ref().is_some_and(|(_, old)| self.ours.as_ref() == Some(old))
    }
}

/// The variable that `line` sets, and the value.
fn variable_of(line: &Text<LINE_MAX>) -> Option<(String, String)> {
    let text = line.to_string();
    let (name, value) = text.split_once('=')?;
    let is_name = name.bytes().all(|byte| byte.is_ascii_alphanumeric());
    is_name.then(|| (name.to_ascii_uppercase(), value.trim().to_owned()))
}

/// The lines of the end, and how far it is with them.
#[derive(Debug)]
pub(super) struct PutBack {
    entries: VecDeque<Entry>,
    /// The line of the first entry is under way, not the question.
    sends: bool,
    retry: EndRetry,
    notes: Vec<String>,
}

impl PutBack {
    /// These lines.
    pub(super) fn new(lines: VecDeque<Text<LINE_MAX>>) -> Self {
        let entries = lines.into_iter().map(Entry::new).collect();
        Self { entries, sends: false, retry: EndRetry::new(PATIENCE, true), notes: Vec::new() }
    }

    /// The same end, as a later call names it.
    pub(super) fn renewed(&mut self, lines: VecDeque<Text<LINE_MAX>>) {
        let mut old = std::mem::take(&mut self.entries);
        self.entries = lines.into_iter().map(Entry::new).collect();
        for entry in &mut self.entries {
            if let Some(known) = old.iter_mut().find(|known| *known.line == *entry.line) {
                (entry.ours, entry.is_set) = (known.ours.take(), known.is_set);
            }
        }
    }

    /// The sequence has sent `line`.
    pub(super) fn sent(&mut self, line: &Text<LINE_MAX>) {
        let Some((name, _)) = variable_of(line) else { return };
        let is_it = |entry: &&mut Entry| entry.variable.as_ref().is_some_and(|(other, _)| *other == name);
        if let Some(entry) = self.entries.iter_mut().find(is_it) {
            (entry.ours, entry.is_set) = (None, true);
        }
    }

    /// What is to be asked after the lines so far.
    pub(super) fn question(&self) -> Option<Step> {
        let (name, _) = self.entries.iter().find(|entry| entry.is_set)?.variable.as_ref()?;
        Some(ask(name, END_STEP))
    }

    /// The answer to that. Where there is none, what is found at the end counts as set by the sequence.
    pub(super) fn learn(&mut self, done: &Done) {
        if let Some(entry) = self.entries.iter_mut().find(|entry| entry.is_set) {
            entry.is_set = false;
            entry.ours = value(done);
        }
    }

    /// The next step of the end; `None` when nothing is left to do.
    pub(super) fn step(&mut self) -> Option<Step> {
        let entry = self.entries.front()?;
        match &entry.variable {
            Some((name, _)) if !self.sends => Some(ask(name, END_STEP)),
            _ => {
                self.sends = true;
                Some(Step::Line { line: entry.line, timeout: END_STEP })
            }
        }
    }

    /// What became of it. When to go on, if not now: `is_last` where nothing can be tried again.
    pub(super) fn take(&mut self, done: &Done, is_last: bool, now: Instant) -> Option<Instant> {
        let entry = self.entries.front()?;
        let sends = std::mem::take(&mut self.sends);
        let can_be_tried = done.outcome.is_unsent() || !sends && done.outcome == Outcome::TimedOut;
        if can_be_tried && !is_last && entry.variable.is_some() && !entry.is_back() {
            // Somebody may set another value meanwhile: the board is asked again.
            let again = self.retry.again(done.outcome, now);
            if again.is_some() {
                return again;
            }
        }
        let note = match (&entry.variable, &done.result) {
            (Some((name, old)), Ok(_)) if !sends => match value(done) {
                Some(found) if found == *old => None,
                Some(found) if entry.ours.as_ref().is_some_and(|ours| *ours != found) => {
                    Some(was_set_meanwhile(name, &found))
                }
                _ => {
                    self.sends = true;
                    return None;
                }
            },
            (_, Ok(_)) => None,
            (_, Err(_)) if entry.is_back() => None,
            (_, Err(error)) => {
                Some(format!("{:?}, which puts the board back, failed: {error}", &*entry.line))
            }
        };
        self.notes.extend(note);
        self.entries.pop_front();
        None
    }

    /// Whether the owner is to be told now: he does not wait for what may take long.
    pub(super) fn tells_now(&mut self) -> bool {
        self.retry.tells_now()
    }

    /// What could not be done.
    pub(super) fn notes(&self) -> &[String] {
        &self.notes
    }

    /// What waits for an open program buffer, of a sequence of this kind.
    pub(super) fn unfinished(&self, kind: &str) -> Option<String> {
        if !self.retry.is_kept_back() {
            return None;
        }
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
