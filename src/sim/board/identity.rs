//! The kind of board that is simulated, and the board's answers about itself.

use crate::map::Readings;
use crate::sim::board::firmware::FirmwareTables;
use crate::sim::board::processor::Processor;

/// A kind of board.
#[derive(Debug, Clone)]
pub struct Identity {
    /// The firmware of the board's family.
    pub tables: &'static FirmwareTables,
    /// `VERSION`, e.g. `1.16D`.
    pub firmware: String,
    /// `DATE`.
    pub date_text: &'static str,
    /// The number of motors, from 1 to the family's.
    pub motors: usize,
    /// Its processor and memory, which a Turbo board tells.
    pub processor: Processor,
    /// Whether MACRO stations are on its ring.
    pub stations: bool,
    /// The board's choice for each sentence of the manuals that can be read two ways.
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
