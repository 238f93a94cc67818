//! Where results go, and in which form.

use std::borrow::Cow;
use std::fmt;
use std::io::{self, BufWriter, IsTerminal, Stdout, Write};

use serde::Serialize;

use crate::format::Visible;

/// The board's words as they are to be printed: its control characters are shown, unless they are wanted as they are.
pub fn reply(text: &str, raw: bool) -> Cow<'_, str> {
    if raw { Cow::Borrowed(text) } else { Cow::Owned(Visible(text).to_string()) }
}

/// Stdout, buffered.
pub struct Output {
    json: bool,
    quiet: bool,
    stdout: BufWriter<Stdout>,
}

impl Output {
    pub fn new(json: bool, quiet: bool) -> Self {
        Self { json, quiet, stdout: BufWriter::new(io::stdout()) }
    }

    /// Whether JSON is wanted.
    pub fn is_json(&self) -> bool {
        self.json
    }

    /// Whether only errors are wanted.
    pub fn is_quiet(&self) -> bool {
        self.quiet
    }

    /// Whether a person looks at it.
    pub fn is_terminal(&self) -> bool {
        !self.quiet && self.stdout.get_ref().is_terminal()
    }

    /// One line, or several. The board's words may be in it, so control characters are shown.
    pub fn line(&mut self, text: impl fmt::Display) -> io::Result<()> {
        if self.quiet {
            return Ok(());
        }
        text.to_string().split('\n').try_for_each(|line| writeln!(self.stdout, "{}", Visible(line)))
    }

    /// A line of the board's reply.
    pub fn reply(&mut self, line: &str, raw: bool) -> io::Result<()> {
        if raw { self.text(format_args!("{line}\n")) } else { self.line(line) }
    }

    /// Text as it is.
    pub fn text(&mut self, text: impl fmt::Display) -> io::Result<()> {
        if self.quiet { Ok(()) } else { write!(self.stdout, "{text}") }
    }

    /// One JSON document, laid out for people as well.
    pub fn json(&mut self, document: &impl Serialize) -> io::Result<()> {
        if !self.quiet {
            serde_json::to_writer_pretty(&mut self.stdout, document)?;
            writeln!(self.stdout)?;
        }
        Ok(())
    }

    /// One JSON document in one line, one of many.
    pub fn json_line(&mut self, document: &impl Serialize) -> io::Result<()> {
        if !self.quiet {
            serde_json::to_writer(&mut self.stdout, document)?;
            writeln!(self.stdout)?;
        }
        Ok(())
    }

    pub fn flush(&mut self) -> io::Result<()> {
        self.stdout.flush()
    }
}
