//! Where the manual can be read two ways: the readings by name.
//!
//! The board does one or the other, and no text says which. [`READINGS`] is the one list of names and values: the
//! simulator plays each value (`pmac-sim --reading NAME=VALUE`), the daemon is told by `[readings]` in its configuration
//! what it cannot find out by itself, and `docs/readings.md` has a row for each. The first value is the one that fits
//! the manuals best.

use serde::{Deserialize, Serialize};

use super::functions::rotary_header;

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
    set("rotary_code2", &["bit12", "bit16"]),
    set("rotary_bit_codes", &["diagram", "table"]),
    set("rotary_header", &["size_first", "start_first"]),
    set("rotary_end_marker", &["two_longs", "one_long"]),
    found_out("rotary_index", &["below_size", "up_to_size"]),
    found_out("mailbox_bell", &["with_text", "alone"]),
];

/// Where CODE2 of ABS, INC and FRAX stands in word 1 of a binary rotary command (DPRAM manual p. 33, diagrams B and C).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RotaryCode2 {
    /// In bits 13-12, beside the start-of-line bit, as in the other commands with a sub-code.
    #[default]
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

/// Which of two printed code assignments applies to the bit-wise assignments of M-variables (DPRAM manual p. 31 and 35).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BitCodes {
    /// 1 is `^=`, 2 is `&=`: the field diagram and its note (two places out of three).
    #[default]
    Diagram,
    /// 1 is `&=`, 2 is `^=`: the summary table of type 2.
    Table,
}

/// What stands in Y:$D1FE and X:$D1FE, the last two words of a rotary header (DPRAM manual p. 30).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RotaryHeader {
    /// The size, then the start: the vendor's own headers.
    #[default]
    SizeFirst,
    /// The start, then the size: "the start and size … in 0x07F8 and 0x07FA".
    StartFirst,
}

impl RotaryHeader {
    /// Which words of the header hold start and size.
    #[must_use]
    pub const fn start_and_size(self) -> [usize; 2] {
        match self {
            Self::SizeFirst => [rotary_header::START, rotary_header::SIZE],
            Self::StartFirst => [rotary_header::SIZE, rotary_header::START],
        }
    }
}

/// What stands at the host's index of a rotary buffer (DPRAM manual p. 30, rule 5).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EndMarker {
    /// $800 in one 32-bit long and $FFFF in the next, as the two words of a command.
    #[default]
    TwoLongs,
    /// $800 and $FFFF in the two 16-bit words of one long.
    OneLong,
}

/// PMAC's index once it has read a rotary buffer up to its end (0x07F6; DPRAM manual p. 30).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RotaryIndex {
    /// 0, as rule 3 has it for the host's: "% buffer_size".
    #[default]
    BelowSize,
    /// The size, until the next line is read.
    UpToSize,
}

/// What goes with the `<BELL>` of an error in the VME mailboxes (User Manual p. 267).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MailboxBell {
    /// What I6 has after it, up to the next `<CR>`.
    #[default]
    WithText,
    /// Nothing: it ends a group, as `<CR>` and `<ACK>` do ("looking for `<CR>`, `<ACK>`, or `<BELL>`").
    Alone,
}

}

/// One value of each reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Readings {
    /// Where CODE2 of ABS, INC and FRAX stands.
    pub rotary_code2: RotaryCode2,
    /// The codes of `^=` and `&=`.
    pub rotary_bit_codes: BitCodes,
    /// What the last two words of a rotary header are.
    pub rotary_header: RotaryHeader,
    /// What stands at the host's index of a rotary buffer.
    pub rotary_end_marker: EndMarker,
    /// PMAC's index at a rotary buffer's end.
    pub rotary_index: RotaryIndex,
    /// What goes with the `<BELL>` in the mailboxes.
    pub mailbox_bell: MailboxBell,
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
