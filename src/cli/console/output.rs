//! Prints results as text or JSON.

use std::borrow::Cow;
use std::fmt;
use std::io::{self, BufWriter, IsTerminal, Stdout, Write};

use serde::Serialize;

use crate::format::Visible;

/// The board's text, ready to print. Shows control characters as escapes, unless `raw`.
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

    /// Whether `--json` was given.
    pub fn is_json(&self) -> bool {
        self.json
    }

    /// Whether `--quiet` was given.
    pub fn is_quiet(&self) -> bool {
        self.quiet
    }

    /// Whether stdout is a terminal.
    pub fn is_terminal(&self) -> bool {
        !self.quiet && self.stdout.get_ref().is_terminal()
    }

    /// Prints one or more lines. They may contain the board's text, so the program shows control characters as escapes.
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

    /// Text, unchanged.
    pub fn text(&mut self, text: impl fmt::Display) -> io::Result<()> {
        if self.quiet { Ok(()) } else { write!(self.stdout, "{text}") }
    }

    /// One result: `document` with `--json`, else `text`, unchanged.
    pub fn show<T: fmt::Display>(
        &mut self,
        document: &impl Serialize,
        text: impl FnOnce() -> T,
    ) -> io::Result<()> {
        if self.json { self.json(document) } else { self.text(text()) }
    }

    /// One JSON document, indented.
    pub fn json(&mut self, document: &impl Serialize) -> io::Result<()> {
        if !self.quiet {
            writeln!(self.stdout, "{}", visible(&serde_json::to_string_pretty(document)?))?;
        }
        Ok(())
    }

    /// One JSON document on one line, in a series.
    pub fn json_line(&mut self, document: &impl Serialize) -> io::Result<()> {
        if !self.quiet {
            writeln!(self.stdout, "{}", visible(&serde_json::to_string(document)?))?;
        }
        Ok(())
    }

    pub fn flush(&mut self) -> io::Result<()> {
        self.stdout.flush()
    }
}

/// A document whose strings have no control characters. JSON allows them from U+007F on, but a terminal obeys CSI
/// (U+009B).
fn visible(document: &str) -> Cow<'_, str> {
    let acts = |c: char| ('\u{7f}'..='\u{9f}').contains(&c);
    if !document.contains(acts) {
        return Cow::Borrowed(document);
    }
    let escaped = |c: char| if acts(c) { format!("\\u{:04x}", u32::from(c)) } else { c.to_string() };
    Cow::Owned(document.chars().map(escaped).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_escaped_in_json() {
        let text = "a\u{9b}2J\u{7f}\u{1b}é";
        let document = serde_json::to_string(text).unwrap();
        let shown = visible(&document);
        assert_eq!(shown, "\"a\\u009b2J\\u007f\\u001bé\"");
        assert_eq!(serde_json::from_str::<String>(&shown).unwrap(), text, "it means the same");
        assert!(matches!(visible("{}"), Cow::Borrowed(_)));
    }
}
