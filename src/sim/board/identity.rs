//! What kind of board is simulated, and how it answers when asked.

use crate::sim::board::family::{Family, MOTORS};

/// The answers to `TYPE`, by the name of the family (form: Software Reference p. 286).
const TYPES: [(&str, &str); 2] =
    [("pmac", "PMAC1, ISA, FLASH, PID, CLK X1"), ("pmac2", "PMAC2, ISA, FLASH, PID, CLK X2")];

/// A kind of board.
#[derive(Debug, Clone)]
pub struct Identity {
    /// What the language must know of the family.
    pub family: &'static Family,
    /// `VERSION`, e.g. `1.16D`.
    pub firmware: String,
    /// `TYPE`.
    pub type_text: &'static str,
    /// `DATE`.
    pub date_text: &'static str,
    /// How many motors there are, 1-8.
    pub motors: usize,
}

impl Identity {
    /// A board of `family` with eight motors that answers `firmware` to `VERSION`.
    #[must_use]
    pub fn new(family: &'static Family, firmware: &str) -> Self {
        let type_text =
            TYPES.iter().find(|(name, _)| *name == family.name).map_or(family.name, |(_, text)| text);
        Self { family, firmware: firmware.into(), type_text, date_text: "07/17/1999", motors: MOTORS }
    }
}
