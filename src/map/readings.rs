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

const fn set(name: &'static str, values: &'static [&'static str]) -> Reading {
    Reading { name, values, found_out: false }
}

/// Every reading.
pub static READINGS: &[Reading] = &[
    set("rotary_code2", &["bit16", "bit12"]),
];

/// Where CODE2 of ABS, INC and FRAX stands in word 1 of a binary rotary command (DPRAM manual p. 33, diagrams B and C).
/// A wrong guess takes an INC for an ABS: the machine moves elsewhere.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RotaryCode2 {
    /// In bits 13-12, beside the start-of-line bit, as in the other commands with a sub-code.
    Bit12,
    /// From bit 16 on, above the unused field that the diagrams draw between it and the start-of-line bit.
    Bit16,
}

impl RotaryCode2 {
    /// The lowest bit of the field.
    #[must_use]
    pub const fn lowest_bit(self) -> u32 {
        match self {
            Self::Bit12 => 12,
            Self::Bit16 => 16,
        }
    }
}

}

}

/// One value of each reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Readings {
    /// Where CODE2 of ABS, INC and FRAX stands; nobody has said it unless the configuration does.
    pub rotary_code2: Option<RotaryCode2>,
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
#[path = "readings_tests.rs"]
mod tests;
