//! `pmacctl download`: sends program and command files line by line, and reports errors by file and line.
//!
//! Lines after an `OPEN` go into a buffer until `CLOSE`. A buffer left open earlier would swallow every line, so CLOSE goes
//! first. If an error, a signal or the end of the file leaves a buffer open, the download closes it.

use std::io::{self, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use clap::Args;
use serde_json::json;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

use super::mistakes::mistaken;
use crate::cli::act::lines::{LineError, Way};
use crate::cli::context::{Context, Failure, Verdict};
use crate::cli::files::preprocess::{SourceLine, preprocess};
use crate::format::Visible;
use crate::protocol::{OpenBuffer, TIMEOUT_MAX_MS};

/// Largest file.
const LARGEST: u64 = 64 << 20;
/// Closes the open buffer. Harmless if none is open.
const CLOSE: &str = "CLOSE";

/// `download`.
#[derive(Debug, Args)]
pub struct Download {
    /// Files of command lines: ; and // start comments, #include "FILE" and #define NAME text work; - is stdin
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// Print the lines that would be sent, and send none
    #[arg(long)]
    pub dry_run: bool,
    /// Go on if the board refuses a line
    #[arg(long)]
    pub keep_going: bool,
    /// Time limit of a line, in seconds; SAVE has a longer one
    #[arg(long, value_name = "S", default_value = "10", value_parser = crate::cli::args::values::seconds, allow_negative_numbers = true)]
    pub timeout: Duration,
}

pub fn run(context: &mut Context, options: &Download) -> Result<Verdict, Failure> {
    if options.timeout.as_millis() > TIMEOUT_MAX_MS.into() {
        let most = TIMEOUT_MAX_MS / 1000;
        return Err(Failure::Request(format!("--timeout is at most {most} s")));
    }
    let lines = preprocess(&options.files, &read).map_err(|mistakes| mistaken(&mistakes))?;
    if options.dry_run {
        return dry_run(context, &lines);
    }
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&stop)).map_err(Failure::request)?;
    }
    let way = Way::daemon(context)?;
    let mut download =
        Sender { way, timeout: options.timeout, buffer: OpenBuffer::default(), failed: Vec::new(), sent: 0 };
    let outcome = download.send_all(context, &lines, options.keep_going, &stop);
    let closing = download.close_buffer();
    download.report(context, lines.len())?;
    outcome?;
    closing?;
    Ok(download.failed.is_empty().into())
}

fn read(path: &Path) -> Result<Vec<u8>, String> {
    use std::io::Read;
    let mut bytes = Vec::new();
    let source: Box<dyn Read> = if path == Path::new("-") {
        Box::new(io::stdin().lock())
    } else {
        Box::new(std::fs::File::open(path).map_err(|error| error.to_string())?)
    };
    source.take(LARGEST + 1).read_to_end(&mut bytes).map_err(|error| error.to_string())?;
    if bytes.len() as u64 > LARGEST { Err(format!("longer than {} MiB", LARGEST >> 20)) } else { Ok(bytes) }
}

fn dry_run(context: &mut Context, lines: &[SourceLine]) -> Result<Verdict, Failure> {
    if context.output.is_json() {
        let document: Vec<_> = lines
            .iter()
            .map(|line| json!({ "file": line.place.file, "line": line.place.line, "text": line.text }))
            .collect();
        context.output.json(&document)?;
        return Ok(Verdict::Yes);
    }
    context.output.line(CLOSE)?;
    for line in lines {
        context.output.line(&line.text)?;
    }
    Ok(Verdict::Yes)
}

/// A line that the board refused, did not answer or did not receive.
struct Failed {
    line: SourceLine,
    /// The number of `ERRnnn`.
    code: Option<u16>,
    text: String,
}

struct Sender {
    way: Way,
    timeout: Duration,
    buffer: OpenBuffer,
    failed: Vec<Failed>,
    sent: usize,
}

impl Sender {
    fn send_all(
        &mut self,
        context: &mut Context,
        lines: &[SourceLine],
        keep_going: bool,
        stop: &AtomicBool,
    ) -> Result<(), Failure> {
        self.way.send(CLOSE, self.timeout)?;
        let mut progress = Progress::new(lines.len());
        for line in lines {
            if stop.load(Ordering::Relaxed) {
                progress.clear();
                return Err(Failure::Refused(format!("{}: interrupted before this line", line.place)));
            }
            progress.show(self.sent);
            // Assume that the buffer opens even if the board refuses the line: the error may come from the text after the OPEN.
            self.buffer.follow(line.text.as_bytes());
            let (replies, error) = match self.way.send(&line.text, self.timeout) {
                Ok(replies) => (replies, None),
                Err(mut error) => (error.take_lines(), Some(error)),
            };
            self.sent += usize::from(error.is_none());
            if !replies.is_empty() && !context.output.is_json() {
                progress.clear();
                for reply in &replies {
                    context.output.line(reply)?;
                }
            }
            let Some(error) = error else { continue };
            progress.clear();
            let (text, line) = (error.to_string(), line.clone());
            let LineError::Board { code, .. } = error else {
                let failure = Failure::from(error).at(&line.place);
                self.failed.push(Failed { line, code: None, text });
                return Err(failure);
            };
            // If stderr is closed, the message is lost.
            let _ = writeln!(io::stderr(), "{}: {}: {}", line.place, Visible(&text), line.text);
            self.failed.push(Failed { line, code, text });
            if !keep_going {
                break;
            }
        }
        progress.clear();
        Ok(())
    }

    fn close_buffer(&mut self) -> Result<(), Failure> {
        if !self.buffer.is_open() {
            return Ok(());
        }
        self.way.send(CLOSE, self.timeout)?;
        if self.failed.is_empty() {
            let _ = writeln!(io::stderr(), "warning: a buffer was left open; it is closed now");
        }
        Ok(())
    }

    fn report(&self, context: &mut Context, total: usize) -> Result<(), Failure> {
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
            context.output.json(&json!({ "lines": total, "taken": self.sent, "errors": errors }))?;
            context.output.flush()?;
        }
        Ok(())
    }
}

/// The progress, on a terminal.
struct Progress {
    total: usize,
    shown: bool,
    last: std::time::Instant,
}

impl Progress {
    /// Updates often enough to show movement.
    const EVERY: Duration = Duration::from_millis(100);

    fn new(total: usize) -> Self {
        Self { total, shown: false, last: std::time::Instant::now() }
    }

    fn show(&mut self, done: usize) {
        if self.last.elapsed() >= Self::EVERY && io::stderr().is_terminal() {
            self.last = std::time::Instant::now();
            self.shown = true;
            let _ = write!(io::stderr(), "\r{done} of {} lines\x1b[K", self.total);
        }
    }

    fn clear(&mut self) {
        if std::mem::take(&mut self.shown) {
            let _ = write!(io::stderr(), "\r\x1b[K");
        }
    }
}
