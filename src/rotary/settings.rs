//! The points of the binary rotary format that the manuals leave open, one named setting each.
//!
//! The manual prints the fields of a command, but neither the bias of its exponent nor all bits of its axis masks. The
//! defaults agree best with the rest; no board has confirmed them. The place of CODE2 of ABS, INC and FRAX has no
//! default: a wrong place would move the machine elsewhere.

use serde::{Deserialize, Serialize};

use crate::map::readings::RotaryCode2;
use crate::map::{DEFAULT_FAMILY, Family};

/// The open points of the format, for both directions.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Bias of the 6-bit exponent: value = mantissa * 2^(exponent - bias). 0 to 63; no manual prints it. With 31, PMAC
    /// could widen the field to its 12-bit exponent by setting fixed bits.
    pub exponent_bias: u8,
    /// The exponent field of zero, 0 to 63.
    pub zero_exponent: u8,
    /// Where CODE2 of ABS, INC and FRAX stands, if the site has said it. The daemon's configuration has this under
    /// `readings`.
    #[serde(skip)]
    pub rotary_code2: Option<RotaryCode2>,
    /// HOME and HOMEZ can name motors 1 to this one. The board's family decides.
    #[serde(skip)]
    pub home_motors: u16,
    /// Lowest bit of CODE2 in word 1 of the mode commands (CODE1 30, sub-code 0), 12 to 19. The diagram shows the field
    /// without bit numbers; in type 0 it is at 16.
    pub mode_code_bit: u8,
    /// Bit of axis A in the axis mask of ABS and INC, 0 to 7; B, C, U, V, W, X, Y, Z follow at every second bit.
    pub abs_inc_axis_bit: u8,
    /// Bit of R, the circle vectors, in the axis mask of ABS and INC, 0 to 23.
    pub abs_inc_vector_bit: u8,
    /// Bit of axis A in the axis mask of FRAX, 0 to 7; the others follow as for ABS.
    pub frax_axis_bit: u8,
    /// The number for coordinate system 1 in a buffer's header: 0 or 1.
    pub coordinate_system_base: u8,
    /// Size of the DPRAM buffer for the program, in 32-bit words: even, 6 to 3584. The compiler refuses a longer line.
    /// 3584 is the whole area for buffers of variable size ($D200-$DFFF).
    pub buffer_words: u32,
}

/// Smallest buffer in 32-bit words: it holds one command per line (manual p. 30).
pub const LEAST_BUFFER_WORDS: u32 = 6;
/// Largest buffer in 32-bit words.
pub const MOST_BUFFER_WORDS: u32 = 3584;

impl Default for Settings {
    fn default() -> Self {
        Self {
            exponent_bias: 31,
            zero_exponent: 0,
            rotary_code2: None,
            home_motors: DEFAULT_FAMILY.rotary.home_motors,
            mode_code_bit: 16,
            abs_inc_axis_bit: 6,
            abs_inc_vector_bit: 5,
            frax_axis_bit: 7,
            coordinate_system_base: 1,
            buffer_words: MOST_BUFFER_WORDS,
        }
    }
}

/// A setting out of range.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{name} = {value}: {allowed}")]
pub struct SettingsError {
    /// The setting's name.
    pub name: &'static str,
    /// Its value.
    pub value: u32,
    /// The allowed values.
    pub allowed: &'static str,
}

impl Settings {
    /// Checks every setting against its field.
    ///
    /// # Errors
    /// The first setting out of range.
    pub fn check(&self) -> Result<(), SettingsError> {
        let vector = self.abs_inc_vector_bit;
        let axes = self.abs_inc_axis_bit..=self.abs_inc_axis_bit.saturating_add(16);
        let on_an_axis = axes.contains(&vector) && (vector - self.abs_inc_axis_bit).is_multiple_of(2);
        let size = self.buffer_words;
        let size_fits = (LEAST_BUFFER_WORDS..=MOST_BUFFER_WORDS).contains(&size) && size.is_multiple_of(2);
        let rules: [(&'static str, u32, bool, &'static str); 8] = [
            ("exponent_bias", self.exponent_bias.into(), self.exponent_bias <= 63, "0 to 63"),
            ("zero_exponent", self.zero_exponent.into(), self.zero_exponent <= 63, "0 to 63"),
            ("mode_code_bit", self.mode_code_bit.into(), (12..=19).contains(&self.mode_code_bit), "12 to 19"),
            ("abs_inc_axis_bit", self.abs_inc_axis_bit.into(), self.abs_inc_axis_bit <= 7, "0 to 7"),
            (
                "abs_inc_vector_bit",
                vector.into(),
                vector <= 23 && !on_an_axis,
                "0 to 23, and not the bit of an axis",
            ),
            ("frax_axis_bit", self.frax_axis_bit.into(), self.frax_axis_bit <= 7, "0 to 7"),
            (
                "coordinate_system_base",
                self.coordinate_system_base.into(),
                self.coordinate_system_base <= 1,
                "0 or 1",
            ),
            ("buffer_words", size, size_fits, "an even number from 6 to 3584"),
        ];
        match rules.into_iter().find(|(_, _, holds, _)| !holds) {
            Some((name, value, _, allowed)) => Err(SettingsError { name, value, allowed }),
            None => Ok(()),
        }
    }

    /// These settings for boards of `family`.
    #[must_use]
    pub fn of(self, family: &Family) -> Self {
        Self { home_motors: family.rotary.home_motors, ..self }
    }

    /// The bits of word 2 that HOME and HOMEZ use.
    pub(super) const fn home_mask(&self) -> u32 {
        (1 << self.home_motors) - 1
    }

    /// Most commands of one text line: the end marker takes one place, and a buffer already counts as full with one
    /// more place left (manual p. 30, rules 2 and 3).
    #[must_use]
    pub fn most_commands_a_line(&self) -> usize {
        (self.buffer_words as usize / 2).saturating_sub(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_hold_and_each_bound_is_kept() {
        assert_eq!(Settings::default().check(), Ok(()));
        let wrong: [(&str, Settings); 9] = [
            ("exponent_bias", Settings { exponent_bias: 64, ..Settings::default() }),
            ("zero_exponent", Settings { zero_exponent: 64, ..Settings::default() }),
            ("mode_code_bit", Settings { mode_code_bit: 20, ..Settings::default() }),
            ("abs_inc_axis_bit", Settings { abs_inc_axis_bit: 8, ..Settings::default() }),
            ("abs_inc_vector_bit", Settings { abs_inc_vector_bit: 8, ..Settings::default() }),
            ("frax_axis_bit", Settings { frax_axis_bit: 200, ..Settings::default() }),
            ("coordinate_system_base", Settings { coordinate_system_base: 2, ..Settings::default() }),
            ("buffer_words", Settings { buffer_words: 7, ..Settings::default() }),
            ("buffer_words", Settings { buffer_words: 4, ..Settings::default() }),
        ];
        for (name, settings) in wrong {
            assert_eq!(settings.check().unwrap_err().name, name);
        }
    }

    #[test]
    fn the_smallest_buffer_takes_one_command_a_line() {
        let lines = |buffer_words| Settings { buffer_words, ..Settings::default() }.most_commands_a_line();
        assert_eq!((lines(6), lines(8), lines(3584)), (1, 2, 1790));
    }

    #[test]
    fn settings_are_written_by_name() {
        let settings: Settings = toml::from_str("exponent_bias = 30\n").unwrap();
        assert_eq!(settings.exponent_bias, 30);
        assert_eq!(settings.frax_axis_bit, 7);
        assert!(toml::from_str::<Settings>("bias = 1").is_err());
    }
}
