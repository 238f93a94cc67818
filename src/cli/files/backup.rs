//! `pmacctl backup`, `diff` and `restore`: a board's variables, axis definitions and programs as a readable file for version
//! control.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::check::check;
use super::differences::{differences, document, entries, held_of};
use crate::cli::console::sink;
use crate::cli::console::{board_of, confirm, note, sending};
use crate::cli::context::{Context, Failure, Verdict};
use crate::cli::files::listings;
use crate::cli::files::meaning;
use crate::cli::files::saved::{Saved, What, name};
use crate::cli::files::sequence::{begin, left};
use crate::cli::files::settings_file::{Entry, Item, keep_address};
use crate::client::Connection;
use crate::language::Meaning;
use crate::preprocess::shown;
use crate::protocol::board::{LineFailure, LineOutcome, RunLinesReply};
use crate::rotary::same_line;

/// The variables of the port over which the daemon sends these lines. A change could cut the restore off half-way, and
/// I58 sets the others.
const PORT: [u16; 4] = [3, 4, 6, 58];
/// The last motion program (Turbo Software Reference p. 381, `OPEN PROG`).
const LAST_PROGRAM: u16 = 32_767;

/// `backup`.
#[derive(Debug, Args)]
pub struct Backup {
    /// The file, written after everything is read [default: stdout]
    #[arg(long, short, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// The kinds to save. M: all definitions, and values of M-variables that point nowhere; MS: variables of MACRO stations;
    /// AXES: axis definitions (#1->); KIN: kinematic programs
    #[arg(
        long,
        value_name = "KINDS",
        value_delimiter = ',',
        default_value = "I,P,Q,M,MS,AXES,KIN,PROG,PLC",
        ignore_case = true
    )]
    pub what: Vec<What>,
    /// The motion programs to look for: boards do not tell which they have. The G, M, T and D codes are programs from 1000 on
    #[arg(long, value_name = "FIRST..LAST", default_value = "1..1010", value_parser = programs)]
    pub programs: (u16, u16),
    /// Compare the board with a file of an earlier backup instead, axis definitions and programs that the file lacks
    /// included, and list the differences. Exit status: 0 the same, 1 different, 2 not compared
    #[arg(long, value_name = "FILE", conflicts_with = "output")]
    pub check: Option<PathBuf>,
}

/// A range of motion programs.
fn programs(text: &str) -> Result<(u16, u16), String> {
    let ends = text.split_once("..").unwrap_or((text, text));
    let range = (ends.0.parse().ok()).zip(ends.1.parse().ok());
    range
        .filter(|(first, last)| 1 <= *first && first <= last && *last <= LAST_PROGRAM)
        .ok_or_else(|| format!("write 1..{LAST_PROGRAM} or a part of it"))
}

/// `diff`.
#[derive(Debug, Args)]
pub struct Diff {
    /// A file of lines like I100=1, as backup writes them; - is stdin
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// A second file [default: the board]
    #[arg(value_name = "FILE2")]
    pub other: Option<PathBuf>,
}

/// `restore`.
#[derive(Debug, Args)]
pub struct Restore {
    /// A file of lines like I100=1, as backup writes them
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// Print the lines and send none
    #[arg(long)]
    pub dry_run: bool,
    /// Send without asking
    #[arg(long)]
    pub yes: bool,
}

pub fn backup(context: &mut Context, options: &Backup) -> Result<Verdict, Failure> {
    if let Some(file) = &options.check {
        return check(context, file, &options.what, options.programs);
    }
    let mut connection = context.connection()?;
    let saved = Saved::ask(&mut connection, "backup", &options.what, options.programs, None)?;
    let text = if context.output.is_json() { saved.document()? } else { saved.text() };
    match &options.output {
        Some(path) if !sink::is_stdout(path) => sink::put(path, text.as_bytes())?,
        _ => context.output.text(text)?,
    }
    Ok(Verdict::Yes)
}

pub fn diff(context: &mut Context, options: &Diff) -> Result<Verdict, Failure> {
    let ours = entries(&options.file)?;
    let theirs: BTreeMap<Item, String> = match &options.other {
        Some(path) => entries(path)?.into_iter().map(|entry| (entry.item, entry.text)).collect(),
        None => held_of(context, "diff", ours.iter().map(|entry| entry.item))?,
    };
    let differences = differences(ours, &theirs);
    if context.output.is_json() {
        context.output.json(&document(&differences))?;
    } else {
        for (item, (one, other)) in &differences {
            for line in differing(*item, one.as_deref(), other.as_deref()) {
                context.output.line(line)?;
            }
        }
    }
    Ok(differences.is_empty().into())
}

/// The lines that differ, with their signs. Of a program, only the lines between its equal parts.
fn differing(item: Item, one: Option<&str>, other: Option<&str>) -> Vec<String> {
    let sides = [('-', one), ('+', other)];
    if !item.is_program() {
        let lines = |(mark, text): (char, Option<&str>)| {
            let lines = text.map(|text| item.lines(text)).unwrap_or_default();
            lines.into_iter().map(move |line| format!("{mark}{line}"))
        };
        return sides.into_iter().flat_map(lines).collect();
    }
    let [one, other] = [one, other].map(|text| meaning::program(text.unwrap_or_default()));
    let shorter = one.len().min(other.len());
    let before = one.iter().zip(&other).take_while(|(one, other)| same_line(one, other)).count();
    let same = one.iter().rev().zip(other.iter().rev()).take_while(|(one, other)| same_line(one, other));
    let behind = same.count().min(shorter - before);
    let lines = [('-', one), ('+', other)].into_iter().flat_map(|(mark, lines)| {
        let end = lines.len() - behind;
        let numbered = lines.into_iter().zip(1..).take(end).skip(before);
        numbered.map(move |(line, number)| format!("{mark}{item} line {number}: {line}")).collect::<Vec<_>>()
    });
    lines.collect()
}

pub fn restore(context: &mut Context, options: &Restore) -> Result<Verdict, Failure> {
    let entries = entries(&options.file)?;
    let file = shown(&options.file);
    let held = held_of(context, "restore", entries.iter().map(|entry| entry.item))?;
    let was = |item: Item| held.get(&item).map_or("", String::as_str);
    let changes = entries.iter().filter(|entry| !entry.item.same(&entry.text, was(entry.item)));
    let is_port = |entry: &&Entry| match entry.item {
        Item::I(number) if PORT.contains(&number) => true,
        item => item.lines(&entry.text).iter().any(|line| Meaning::of(line).settings.cuts_off.is_certain()),
    };
    let (port, changes): (Vec<&Entry>, Vec<&Entry>) = changes.partition(is_port);
    for entry in &port {
        note(format_args!(
            "{file}:{}: {} stays at {}: the link to the board depends on it",
            entry.line,
            entry.item,
            was(entry.item)
        ));
    }
    let mut report =
        Report { file, changes: &changes, skipped: &port, held: &held, sent: 0, errors: Vec::new() };
    if !context.output.is_json() {
        for entry in &changes {
            let was = was(entry.item);
            let lines = if entry.item.is_program() { was.lines().count() } else { 0 };
            let was = if entry.item.is_program() { format!("{lines} lines") } else { was.to_owned() };
            let mut behind = format!("  ; was {was}");
            for line in entry.item.lines(&entry.text) {
                context.output.line(format_args!("{line}{}", std::mem::take(&mut behind)))?;
            }
        }
        context.output.flush()?;
    }
    if options.dry_run || changes.is_empty() {
        report.print(context)?;
        return Ok(Verdict::Yes);
    }
    let lines: usize = changes.iter().map(|entry| entry.item.lines(&entry.text).len()).sum();
    if !confirm(&sending(lines, &board_of(context)?), options.yes)? {
        return Ok(Verdict::No);
    }
    let mut connection = context.connection()?;
    let ended = report.send(&mut connection);
    report.print(context)?;
    ended?;
    Ok(report.errors.is_empty().into())
}

/// The changes and the results of a restore.
struct Report<'a> {
    file: String,
    changes: &'a [&'a Entry],
    skipped: &'a [&'a Entry],
    held: &'a BTreeMap<Item, String>,
    sent: usize,
    errors: Vec<(&'a Entry, String)>,
}

impl Report<'_> {
    /// Sends the changes in the file's order, then reads the values back and compares.
    fn send(&mut self, connection: &mut Connection) -> Result<(), Failure> {
        let mut board = begin(connection, "restore", true);
        keep_address(&mut board, self.changes.iter().map(|entry| entry.item))?;
        let parts = self
            .changes
            .iter()
            .flat_map(|entry| entry.item.lines(&entry.text).into_iter().map(move |line| (*entry, line)));
        let (owners, lines): (Vec<&Entry>, Vec<String>) = parts.unzip();
        let mut parts = owners.iter().copied().zip(&lines);
        let mut refused: BTreeSet<Item> = BTreeSet::new();
        let mut done = BTreeSet::new();
        let mut stopped = None;
        let mut first = None;
        let mut taken = 0;
        let ran = board.run(&lines, |reply| {
            let Some((entry, line)) = parts.next() else { return false };
            first = first.or(reply.line);
            taken += u64::from(reply.failure.is_none());
            match &reply.failure {
                None => drop(done.insert(entry.item)),
                Some(failure) if failure.outcome == LineOutcome::Refused => {
                    refused.insert(entry.item);
                    self.fail(entry, failure.message.clone(), line);
                }
                // Skip the lines of a program whose OPEN the board refused.
                Some(_) if refused.contains(&entry.item) => {}
                Some(failure) => stopped = Some((entry, failure.clone())),
            }
            self.sent = done.difference(&refused).count();
            stopped.is_none()
        });
        if let (Err(error), Some((entry, _))) = (&ran, parts.next()) {
            let outcome = LineOutcome::Uncertain;
            stopped = Some((entry, LineFailure { outcome, code: None, message: error.to_string() }));
        }
        if let Some((entry, failure)) = stopped {
            let what = match failure.outcome {
                LineOutcome::NotSent => "stopped before this line",
                _ => "stopped at this line; the board may or may not have executed it",
            };
            note(format_args!("{}:{}: {what}", self.file, entry.line));
            self.errors.push((entry, failure.message.clone()));
            ran.inspect_err(|_| note(left(taken, lines.len(), &[])))?;
            let over = board.finish()?;
            self.reset(&over, first, &owners, &lines);
            note(left(taken, lines.len(), &over.notes));
            return Err(Failure::Refused(failure.message));
        }
        if !ran? {
            let over = board.finish()?;
            let was_reset = self.reset(&over, first, &owners, &lines);
            note(left(taken, lines.len(), &over.notes));
            let Some((entry, _)) = parts.next().filter(|_| !was_reset) else { return Ok(()) };
            let why = "pmacd ended the sequence before this line".to_owned();
            self.errors.push((entry, why.clone()));
            return Err(Failure::Refused(why).at(format_args!("{}:{}", self.file, entry.line)));
        }
        let accepted = || self.changes.iter().copied().filter(|entry| !refused.contains(&entry.item));
        let held = listings::read(&mut board, accepted().map(|entry| entry.item));
        let over = board.finish()?;
        if self.reset(&over, first, &owners, &lines) {
            note(left(taken, lines.len(), &over.notes));
            return Ok(());
        }
        over.notes.iter().for_each(note);
        let held = held?;
        for entry in accepted().collect::<Vec<_>>() {
            let now = held.get(&entry.item).map_or("", String::as_str);
            // A register that hardware also writes changes by itself. Report the difference all the same.
            if !entry.item.same(&entry.text, now) {
                let now = if entry.item.is_program() { "another program" } else { now };
                let lines = entry.item.lines(&entry.text);
                let first = lines.first().map_or("", String::as_str);
                self.fail(entry, format!("the board took the line but now holds {now}"), first);
            }
        }
        let plcs = self.changes.iter().filter(|entry| matches!(entry.item, Item::Plc(_)));
        let names: Vec<String> = plcs.map(|entry| entry.item.to_string()).collect();
        if !names.is_empty() {
            note(format_args!(
                "disabled since their OPEN, to be enabled by ENABLE PLC: {}",
                names.join(", ")
            ));
        }
        Ok(())
    }

    fn print(&self, context: &mut Context) -> Result<(), Failure> {
        if !context.output.is_json() {
            return Ok(());
        }
        let change = |entry: &&Entry| {
            let was = self.held.get(&entry.item);
            json!({ "variable": name(entry.item), "from": was, "to": entry.text, "line": entry.line })
        };
        let errors: Vec<_> = self
            .errors
            .iter()
            .map(|(entry, what)| json!({ "variable": name(entry.item), "line": entry.line, "message": what }))
            .collect();
        let changes: Vec<_> = self.changes.iter().map(change).collect();
        let skipped: Vec<_> = self.skipped.iter().map(change).collect();
        context
            .output
            .json(&json!({ "changes": changes, "skipped": skipped, "taken": self.sent, "errors": errors }))?;
        context.output.flush()?;
        Ok(())
    }
}

impl<'a> Report<'a> {
    fn fail(&mut self, entry: &'a Entry, what: String, line: &str) {
        note(format_args!("{}:{}: {what}: {line}", self.file, entry.line));
        self.errors.push((entry, what));
    }

    /// Notes a reset that the end of the sequence reports, at the line at which the daemon noticed the reset; `first`
    /// is the number of the first of `lines` in the sequence. True if there was a reset.
    fn reset(
        &mut self,
        over: &RunLinesReply,
        first: Option<u64>,
        owners: &[&'a Entry],
        lines: &[String],
    ) -> bool {
        let Some(failure) = &over.failure else { return false };
        let behind = over.line.unwrap_or(0).saturating_sub(first.unwrap_or(0));
        // If the daemon noticed the reset at a later question, the board took all lines: blame the last line.
        let number = usize::try_from(behind).unwrap_or(usize::MAX).min(lines.len().saturating_sub(1));
        match (owners.get(number), lines.get(number)) {
            (Some(entry), Some(line)) => self.fail(entry, failure.message.clone(), line),
            _ => note(format_args!("{}: {}", self.file, failure.message)),
        }
        true
    }
}
