//! `pmacctl download`: program and command files, line by line; errors name file and line.
//!
//! The daemon runs the lines as one sequence. Lines that follow an `OPEN` go into a buffer until `CLOSE`. The daemon
//! closes a buffer that an error, an interruption, the end of the file or the end of this process leaves open. While
//! another client has a buffer open, the daemon leaves that buffer alone and sends no line.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use serde_json::json;

use super::mistakes::mistaken;
use super::prologue::{self, Clears};
use super::prose;
use crate::cli::args::values::line_timeout;
use crate::cli::console::input::read;
use crate::cli::console::{Interrupt, Progress, note};
use crate::cli::context::{Context, Failure, Verdict};
use crate::cli::files::sequence::left;
use crate::client::Connection;
use crate::client::circles::{self, is_circle};
use crate::client::command::lines::LinesOptions;
use crate::format::Visible;
use crate::language::lexer::{Kind, tokens};
use crate::preprocess::{Place, SourceLine, preprocess};
use crate::protocol::board::RunLinesReply;

/// Largest file.
const LARGEST_FILE: u64 = 64 << 20;

/// `download`.
#[derive(Debug, Args)]
pub struct Download {
    /// Files of command lines. Comments (; // /* */) are removed, #include "FILE" and #define NAME text are resolved; - is
    /// stdin
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// First send CLOSE and DELETE GATHER; with =plcs also DISABLE PLC 0..31, with =undefine UNDEFINE ALL, after asking
    #[arg(long, value_name = "plcs,undefine", num_args = 0.., require_equals = true, value_delimiter = ',')]
    pub prologue: Option<Vec<Clears>>,
    /// Print the lines and send none
    #[arg(long)]
    pub dry_run: bool,
    /// Go on after a line that the board refuses
    #[arg(long)]
    pub keep_going: bool,
    /// Also send a file in which most lines are no commands of PMAC
    #[arg(long)]
    pub force: bool,
    /// Time limit of a line, in seconds; slow lines such as SAVE have longer limits
    #[arg(long, value_name = "S", default_value = "10", value_parser = line_timeout, allow_negative_numbers = true)]
    pub timeout: Duration,
    /// Also send lines that pmacd refuses otherwise: I58=0, which ends command lines for everybody; $$$ and SAVE while
    /// other users' work runs. Do not ask before a prologue
    #[arg(long)]
    pub yes: bool,
}

pub fn run(context: &mut Context, options: &Download) -> Result<Verdict, Failure> {
    let mut lines = preprocess(&options.files, &|path| read(path, LARGEST_FILE))
        .map_err(|mistakes| mistaken(&mistakes))?;
    if !options.force {
        prose::check(&lines).map_err(|mistake| mistaken(&[mistake]))?;
    }
    if let Some(clears) = &options.prologue {
        lines.splice(0..0, prologue::lines(clears));
    }
    if options.dry_run {
        return dry_run(context, &lines);
    }
    if let Some(clears) = &options.prologue
        && !prologue::tell(context, clears, options.yes)?
    {
        return Ok(Verdict::No);
    }
    let stop = Interrupt::listen()?;
    let connection = context.connection()?.confirming(options.yes);
    let mut download = Downloading { lines: &lines, failed: Vec::new(), taken: 0 };
    let outcome = download.send(context, connection, options, &stop);
    download.report(context)?;
    outcome?;
    Ok(download.failed.is_empty().into())
}

fn dry_run(context: &mut Context, lines: &[SourceLine]) -> Result<Verdict, Failure> {
    if context.output.is_json() {
        let document = |line: &SourceLine| json!({ "file": line.place.file, "line": line.place.line, "text": line.text });
        context.output.json(&lines.iter().map(document).collect::<Vec<_>>())?;
    } else {
        lines.iter().try_for_each(|line| context.output.line(&line.text))?;
    }
    Ok(Verdict::Yes)
}

/// The first circle for each addressed coordinate system, and the first in lines without an address.
fn circles_of(lines: &[SourceLine]) -> BTreeMap<Option<u32>, &Place> {
    let mut circles = BTreeMap::new();
    let mut system = None;
    for SourceLine { place, text } in lines {
        let addressed = tokens(text.as_bytes()).filter_map(|token| match token.kind {
            Kind::System(number @ 1..) => Some(number),
            _ => None,
        });
        system = addressed.last().or(system);
        if is_circle(text) {
            circles.entry(system).or_insert(place);
        }
    }
    circles
}

/// A line that the board refused or did not answer, or that never reached the board.
struct Failed {
    line: SourceLine,
    /// The number of `ERRnnn`.
    code: Option<u16>,
    text: String,
}

/// A download, running or over.
struct Downloading<'a> {
    lines: &'a [SourceLine],
    failed: Vec<Failed>,
    taken: u64,
}

impl Downloading<'_> {
    fn send(
        &mut self,
        context: &mut Context,
        mut connection: Connection,
        options: &Download,
        stop: &Interrupt,
    ) -> Result<(), Failure> {
        let sequence =
            LinesOptions { kind: "download", timeout: options.timeout, keep_going: options.keep_going };
        let texts: Vec<&str> = self.lines.iter().map(|line| line.text.as_str()).collect();
        let mut progress = Progress::on_terminal();
        let mut next = 0;
        let mut printed = Ok(());
        let over = connection.run_lines(sequence, &texts, |reply| {
            progress.show(|_| format!("{} of {} lines", reply.taken, texts.len()));
            next += 1;
            let outcome = self.told(context, &mut progress, reply);
            printed = std::mem::replace(&mut printed, Ok(())).and(outcome);
            printed.is_ok() && !stop.came()
        });
        progress.clear();
        let place = self.lines.get(next).map(|line| &line.place);
        let over = over.map_err(|error| match place {
            Some(place) => Failure::from(error).at(place),
            None => error.into(),
        })?;
        printed?;
        self.taken = over.taken;
        self.line_failed(&over);
        let is_whole = next == texts.len() && self.failed.is_empty();
        if is_whole {
            // Ask now: the file may have set the variable.
            for (system, place) in circles_of(self.lines) {
                if let Some(warning) = circles::warning(&mut connection, place, system) {
                    note(format_args!("{warning}"));
                }
            }
        }
        self.leave(&over.notes, is_whole);
        match (place, self.failed.last()) {
            (Some(place), None) => Err(Failure::Refused(format!("{place}: interrupted before this line"))),
            _ => Ok(()),
        }
    }

    /// Prints the outcome of a line.
    fn told(
        &mut self,
        context: &mut Context,
        progress: &mut Progress,
        reply: &RunLinesReply,
    ) -> Result<(), Failure> {
        self.taken = reply.taken;
        if !reply.lines.is_empty() && !context.output.is_json() {
            progress.clear();
            reply.lines.iter().try_for_each(|line| context.output.line(line))?;
        }
        if reply.failure.is_some() {
            progress.clear();
        }
        self.line_failed(reply);
        Ok(())
    }

    /// Notes the failure in `reply`, if any.
    fn line_failed(&mut self, reply: &RunLinesReply) {
        let line = reply.line.and_then(|number| self.lines.get(usize::try_from(number).ok()?));
        if let (Some(failure), Some(line)) = (&reply.failure, line) {
            note(format_args!("{}: {}: {}", line.place, Visible(&failure.message), line.text));
            self.failed.push(Failed {
                line: line.clone(),
                code: failure.code,
                text: failure.message.clone(),
            });
        }
    }

    /// Says which lines are on the board now.
    fn leave(&self, notes: &[String], is_whole: bool) {
        if is_whole {
            notes.iter().for_each(|warning| note(format_args!("warning: {warning}")));
        } else {
            note(left(self.taken, self.lines.len(), notes));
        }
    }

    fn report(&self, context: &mut Context) -> Result<(), Failure> {
        if context.output.is_json() {
            let errors: Vec<_> = self
                .failed
                .iter()
                .map(|failed| {
                    let SourceLine { place, text } = &failed.line;
                    json!({ "file": place.file, "line": place.line, "text": text, "code": failed.code,
                            "message": failed.text })
                })
                .collect();
            context
                .output
                .json(&json!({ "lines": self.lines.len(), "taken": self.taken, "errors": errors }))?;
            context.output.flush()?;
        }
        Ok(())
    }
}
