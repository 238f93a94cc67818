//! Where the manual can be read two ways: the readings by name.
//!
//! The board does one or the other, and no text says which. [`READINGS`] is the one list of names and values: the
//! simulator plays each value (`pmac-sim --reading NAME=VALUE`), the daemon is told by `[readings]` in its configuration
//! what it cannot find out by itself, and `docs/readings.md` has a row for each. The first value is the one that fits
//! the manuals best.

use serde::{Deserialize, Serialize};

/// A name of [`Readings`] and the values it takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reading {
    /// The name.
    pub name: &'static str,
    /// The values, the default first.
    pub values: &'static [&'static str],
    /// The daemon finds out by itself which one the board takes, so that no setting is needed.
    pub found_out: bool,
}

const fn found_out(name: &'static str, values: &'static [&'static str]) -> Reading {
    Reading { name, values, found_out: true }
}

/// Every reading.
pub static READINGS: &[Reading] = &[
    found_out("reply_count", &["with_nul", "without_nul"]),
    found_out("control_flag", &["own", "line"]),
    found_out("line_flag", &["taken", "done"]),
    found_out("reply_end", &["ack", "silence"]),
];

/// What the word before a reply counts (0x06D2; DPRAM manual p. 29).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ReplyCount {
    /// The characters and their NUL: the register map has "# of ASCII characters + 1".
    #[default]
    WithNul,
    /// The characters: step 3 of "To read a response" has "the number of characters in the response".
    WithoutNul,
}

/// What makes the board take a control character (DPRAM manual p. 28).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ControlFlag {
    /// The character in its register (0x062E) is enough.
    #[default]
    Own,
    /// The flag of a line (0x062C) has to be set too: "the read/write procedure is exactly as described above".
    Line,
}

/// When the board clears the flag of a line (0x062C; DPRAM manual p. 29).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LineFlag {
    /// When it has taken the line out of the buffer.
    #[default]
    Taken,
    /// When it has carried the line out: "set to 0 by PMAC when it has processed a command string".
    Done,
}

/// How the end of a reply shows (DPRAM manual p. 27 and 28).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ReplyEnd {
    /// By a control word `<ACK>`, whatever I3 is: "until the Host-Input Control Word contains an `<ACK>`".
    #[default]
    Ack,
    /// By `<ACK>` only where I3 is 2 or 3, the handshakes that have one; else by nothing but silence.
    Silence,
}

/// One value of each reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Readings {
    /// What the word before a reply counts.
    pub reply_count: ReplyCount,
    /// What makes the board take a control character.
    pub control_flag: ControlFlag,
    /// When the board clears the flag of a line.
    pub line_flag: LineFlag,
    /// How the end of a reply shows.
    pub reply_end: ReplyEnd,
}

/// A name or value that is none.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("reading {given}: {reason}")]
pub struct UnknownReading {
    given: String,
    reason: String,
}

impl Readings {
    /// These readings, but for the one that `given` names as NAME=VALUE.
    ///
    /// # Errors
    /// An unknown name or value, with those there are.
    pub fn with(self, given: &str) -> Result<Self, UnknownReading> {
        let fail = |reason: String| UnknownReading { given: given.to_owned(), reason };
        let (name, value) = given.split_once('=').ok_or_else(|| fail("write NAME=VALUE".to_owned()))?;
        let mut all = serde_json::to_value(self).map_err(|error| fail(error.to_string()))?;
        all[name] = value.into();
        serde_json::from_value(all).map_err(|error| fail(error.to_string()))
    }

    /// The value of the reading `name`.
    #[must_use]
    pub fn value(&self, name: &str) -> Option<String> {
        let all = serde_json::to_value(self).ok()?;
        all[name].as_str().map(str::to_owned)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_list_has_every_name_and_value_there_is() {
        let defaults = serde_json::to_value(Readings::default()).unwrap();
        assert_eq!(defaults.as_object().unwrap().len(), READINGS.len());
        for reading in READINGS {
            assert_eq!(Readings::default().value(reading.name).as_deref(), Some(reading.values[0]));
            for value in reading.values {
                let readings = Readings::default().with(&format!("{}={value}", reading.name)).unwrap();
                assert_eq!(readings.value(reading.name).as_deref(), Some(*value));
            }
            // The error of a value that is none lists those there are.
            let error = Readings::default().with(&format!("{}=x", reading.name)).unwrap_err().to_string();
            assert_eq!(error.matches('`').count(), 2 * (1 + reading.values.len()), "{error}");
        }
    }

    #[test]
    fn one_reading_leaves_the_others_and_nonsense_is_refused_with_the_list() {
        let readings = Readings::default().with("reply_end=silence").unwrap();
        let readings = readings.with("line_flag=done").unwrap();
        assert_eq!((readings.reply_end, readings.line_flag), (ReplyEnd::Silence, LineFlag::Done));
        assert_eq!(readings.control_flag, ControlFlag::Own);
        let error = readings.with("line_flg=done").unwrap_err().to_string();
        assert!(
            error.starts_with("reading line_flg=done: unknown field `line_flg`, expected one of"),
            "{error}"
        );
        assert!(error.contains("`line_flag`"), "{error}");
        assert_eq!(
            readings.with("line_flag").unwrap_err().to_string(),
            "reading line_flag: write NAME=VALUE"
        );
    }
}
