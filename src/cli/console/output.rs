//! Where results go, and in which form.

use std::fmt;
use std::io::{self, BufWriter, IsTerminal, Stdout, Write};

use serde::Serialize;

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

    /// One line.
    pub fn line(&mut self, text: impl fmt::Display) -> io::Result<()> {
        if self.quiet { Ok(()) } else { writeln!(self.stdout, "{text}") }
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
