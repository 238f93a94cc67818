//! Which motors and fields of the servo and background reports the daemon reads into the segment.
//!
//! Bus accesses are the cost on real hardware, so a site can leave out unneeded data in the configuration. The reply
//! of `GetSettings` has the same tables. The names that they may hold depend on the board's family.

use serde::{Deserialize, Serialize};

use crate::map::{Family, Selection, block_fields};

/// The spare words of a motor's servo block.
const SPARE: &str = "spare";

/// The parts of the servo report that the daemon reads. The daemon always reads the two global status words: they tell
/// whether the board would take a command line as a program line.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct ServoSettings {
    /// The motors, as far as the board reports them.
    pub motors: Vec<u32>,
    /// The fields of each motor, as the register table names them.
    pub fields: Vec<String>,
    /// Whether the daemon reads a motor's spare words, if `fields` has them.
    pub spare_words: bool,
}

impl ServoSettings {
    /// Everything that a board of `family` reports.
    #[must_use]
    pub fn all(family: &Family) -> Self {
        let motors = family.servo.motors.count as u32;
        Self { motors: (1..=motors).collect(), fields: field_names(family, "servo"), spare_words: true }
    }

    /// The words that the daemon reads of a board of `family`.
    #[must_use]
    pub fn selection(&self, family: &Family) -> Selection {
        let fields = self.fields.iter().filter(|name| self.spare_words || *name != SPARE);
        selection(family, "servo", fields, &self.motors)
    }
}

/// The parts of the background report that the daemon reads. The daemon always reads the board's ports.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct BackgroundSettings {
    /// The motors and the coordinate systems of the same numbers, as far as the board reports them.
    pub motors: Vec<u32>,
    /// The fields of each motor and coordinate system, as the register table names them.
    pub fields: Vec<String>,
}

impl BackgroundSettings {
    /// Everything that a board of `family` reports.
    #[must_use]
    pub fn all(family: &Family) -> Self {
        let numbers = family.background.blocks.count as u32;
        Self { motors: (1..=numbers).collect(), fields: field_names(family, "background") }
    }

    /// The words that the daemon reads of a board of `family`.
    #[must_use]
    pub fn selection(&self, family: &Family) -> Selection {
        selection(family, "background", self.fields.iter(), &self.motors)
    }
}

/// The fields of a block of `function`, in the order of the register table.
fn field_names(family: &Family, function: &str) -> Vec<String> {
    block_fields(family, function).map(|field| field.name.to_owned()).collect()
}

fn selection<'a>(
    family: &Family,
    function: &str,
    names: impl Iterator<Item = &'a String>,
    numbers: &[u32],
) -> Selection {
    let words = names
        .filter_map(|name| block_fields(family, function).find(|field| field.name == name))
        .map(|field| field.words);
    Selection::new(words, numbers.iter().map(|number| *number as usize))
}
