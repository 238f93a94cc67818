//! The facts about a board that the manuals leave open, the places of the daemon's buffers, and the data that the
//! daemon reads: one named setting each.
//!
//! The daemon's configuration file (TOML) and the reply of `GetSettings` have the same tables, so that a client works
//! by the same settings as the daemon. The defaults are the readings that fit the manuals best; no board has confirmed
//! them.

use serde::{Deserialize, Serialize};

use super::{BackgroundSettings, Functions, ServoSettings};
use crate::map::{BufferSettings, Family, Firmware, Layout, Readings};
use crate::rotary;

/// All settings.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BoardSettings {
    /// The functions that the daemon uses.
    pub functions: Functions,
    /// Those of them that the daemon uses although M-variables of the board point into their words.
    pub shared_functions: Functions,
    /// The parts of the servo report that the daemon reads.
    pub servo: ServoSettings,
    /// The parts of the background report that the daemon reads.
    pub background: BackgroundSettings,
    /// Sizes and places of the buffers in the user area.
    pub plan: BufferSettings,
    /// How background variables are read.
    pub variables: VariablesSettings,
    /// The meaning of ambiguous sentences of the manual.
    pub readings: Readings,
    /// The binary rotary format.
    pub rotary: rotary::Settings,
}

impl Default for BoardSettings {
    fn default() -> Self {
        Self {
            functions: Functions::default(),
            shared_functions: Functions::none(),
            servo: ServoSettings::default(),
            background: BackgroundSettings::default(),
            plan: BufferSettings::default(),
            variables: VariablesSettings::default(),
            readings: Readings::default(),
            rotary: rotary::Settings::default(),
        }
    }
}

impl BoardSettings {
    /// The register map of a board of `family` with `firmware` and these readings.
    #[must_use]
    pub fn layout(&self, family: &'static Family, firmware: Option<Firmware>) -> Layout {
        Layout::new(family, firmware)
    }

    /// The binary rotary format, with its reading.
    #[must_use]
    pub fn rotary_format(&self) -> rotary::Settings {
        rotary::Settings { rotary_code2: self.readings.rotary_code2, ..self.rotary.clone() }
    }
}

/// How background variables are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VariablesSettings {
    /// The buffer's mode (DPRAM manual p. 22).
    pub mode: VariableMode,
}

/// The two modes of the variable-read buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum VariableMode {
    /// One ready bit for the whole table: the values of a report belong together.
    #[default]
    SingleUser,
    /// A ready bit an entry: values come one by one, and other hosts may use entries of the table.
    MultiUser,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::readings::RotaryCode2;

    #[test]
    fn the_tables_are_written_by_name_and_come_back() {
        let text = "[readings]\nrotary_code2 = \"bit16\"\n[variables]\nmode = \"multi-user\"\n\
                    [plan]\nrotary_start = [0xDE00, 0]\n[rotary]\nexponent_bias = 30\n";
        let settings: BoardSettings = toml::from_str(text).unwrap();
        assert_eq!(settings.readings.rotary_code2, Some(RotaryCode2::Bit16));
        assert_eq!(settings.variables.mode, VariableMode::MultiUser);
        assert_eq!(
            (settings.plan.rotary_start.as_slice(), settings.plan.gather_longs),
            ([0xDE00, 0].as_slice(), 0x5C0)
        );
        assert_eq!(settings.rotary.exponent_bias, 30);
        let json = serde_json::to_string(&settings).unwrap();
        assert_eq!(serde_json::from_str::<BoardSettings>(&json).unwrap(), settings);
        assert!(toml::from_str::<BoardSettings>("[plan]\nplace = 1\n").is_err());
    }

    /// Earlier clients read each reading as text, and refuse a null.
    #[test]
    fn an_unknown_reading_is_left_out_of_the_reply() {
        let json = serde_json::to_value(BoardSettings::default()).unwrap();
        assert_eq!(json["readings"], serde_json::json!({}));
    }
}
