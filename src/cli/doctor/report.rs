//! The checks of doctor, each with its level and its cure.

use std::fmt;

use serde::Serialize;

use crate::device::machine::candidates::Candidate;
use crate::device::machine::probe::Probe;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    Ok,
    Warn,
    Fail,
}

/// A check.
#[derive(Debug, Serialize)]
pub struct Check {
    pub check: &'static str,
    pub level: Level,
    pub text: String,
    /// A device that may be a board.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub candidate: Option<Candidate>,
    /// The content of the window.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub probe: Option<Probe>,
}

impl Check {
    pub fn new(level: Level, check: &'static str, text: impl Into<String>) -> Self {
        Self { check, level, text: text.into(), candidate: None, probe: None }
    }
}

impl fmt::Display for Check {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let level = match self.level {
            Level::Ok => "ok",
            Level::Warn => "warn",
            Level::Fail => "FAIL",
        };
        write!(formatter, "{level:<4}  {:<13} {}", self.check, self.text)
    }
}

#[derive(Debug, Default)]
pub struct Report(pub Vec<Check>);

impl Report {
    /// Whether no check failed and the board takes commands. A board that comes up may show warnings.
    pub fn is_well(&self) -> bool {
        let is_wrong = |check: &Check| match check.level {
            Level::Fail => true,
            Level::Warn => check.check == "commands",
            Level::Ok => false,
        };
        !self.0.iter().any(is_wrong)
    }

    /// Whether no check failed.
    pub fn is_passed(&self) -> bool {
        self.0.iter().all(|check| check.level != Level::Fail)
    }

    pub fn ok(&mut self, check: &'static str, text: impl Into<String>) {
        self.add(Level::Ok, check, text);
    }

    pub fn warn(&mut self, check: &'static str, text: impl Into<String>) {
        self.add(Level::Warn, check, text);
    }

    pub fn fail(&mut self, check: &'static str, text: impl Into<String>) {
        self.add(Level::Fail, check, text);
    }

    pub fn add(&mut self, level: Level, check: &'static str, text: impl Into<String>) {
        self.0.push(Check::new(level, check, text));
    }
}
