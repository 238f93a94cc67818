//! What kind of board is simulated, and how it answers when asked.

use crate::map::Readings;
use crate::sim::board::firmware::FirmwareTables;
use crate::sim::board::processor::Processor;

/// A kind of board.
#[derive(Debug, Clone)]
pub struct Identity {
    /// What its family's firmware knows.
    pub tables: &'static FirmwareTables,
    /// `VERSION`, e.g. `1.16D`.
    pub firmware: String,
    /// `DATE`.
    pub date_text: &'static str,
    /// How many motors there are, from 1 to those of the family.
    pub motors: usize,
    /// Its processor and memory, which a Turbo board tells.
    pub processor: Processor,
    /// Whether MACRO stations are on its ring.
    pub stations: bool,
    /// What it makes of the sentences that can be read two ways.
    pub readings: Readings,
}

impl Identity {
    /// A board of the family of `tables`, with all its motors, that answers `firmware` to `VERSION`.
    #[must_use]
    pub fn new(tables: &'static FirmwareTables, firmware: &str) -> Self {
        Self {
            tables,
            firmware: firmware.into(),
            date_text: "07/17/1999",
            motors: tables.family.motors,
            processor: Processor::default(),
            stations: false,
            readings: Readings::default(),
        }
    }
}
