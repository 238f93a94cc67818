//! The one question about a board that no text answers and nobody may guess: a wrong guess would move the machine to
//! another place.
//!
//! The table `[readings]` of the daemon's configuration answers it. `docs/evidence.md` has this question, and every
//! other uncertain format with the driver's reading.

use serde::{Deserialize, Serialize};

/// The place of CODE2 of ABS, INC and FRAX in word 1 of a binary rotary command (DPRAM manual p. 33, diagrams B and C).
/// With a wrong guess an INC acts as an ABS: the machine moves to another place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RotaryCode2 {
    /// In bits 13-12, beside the start-of-line bit, as in the other commands with a sub-code.
    Bit12,
    /// From bit 16 on, above the unused field that the diagrams draw between it and the start-of-line bit.
    Bit16,
}

impl RotaryCode2 {
    /// Both places, the likelier first, by their names in the configuration.
    pub const ALL: [(Self, &str); 2] = [(Self::Bit16, "bit16"), (Self::Bit12, "bit12")];

    /// The lowest bit of the field.
    #[must_use]
    pub const fn lowest_bit(self) -> u32 {
        match self {
            Self::Bit12 => 12,
            Self::Bit16 => 16,
        }
    }
}

/// The table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Readings {
    /// The place of CODE2 of ABS, INC and FRAX; unknown unless the configuration has it.
    // Left out while unknown: clients of an earlier state read the name as text.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rotary_code2: Option<RotaryCode2>,
}
