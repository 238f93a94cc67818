//! A command's meaning, and its two 24-bit words (DPRAM manual pp. 31-35).
//!
//! Word 1: bits 5-0 exponent or sub-code, bits 10-6 CODE1, bit 11 start of line (set by the line, not the command),
//! bits 23-12 the low mantissa bits, CODE2, a variable's number or PLCs 0-7. Word 2: mantissa or data.

use super::codes::{self, AXES, CODES, Code, DATA, MODES, Shape};
use super::float::{Float, Width};
use super::program::START_OF_LINE;
use super::settings::Settings;

/// A command's operand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Argument {
    /// No operand.
    None,
    /// A number: letters, CALL, times, marks.
    Number(Float),
    /// A variable's number, 0 to 1023, and its value.
    Assignment(u16, Float),
    /// A whole number, 0 to 1023.
    Count(u16),
    /// Axes: bit k is axis [`AXES`]`[k]`, bit 9 is R.
    Axes(u16),
    /// Motors: bit n-1 is motor n.
    Motors(u32),
    /// PLC programs: bit n is PLC n.
    Plcs(u32),
}

/// In [`Argument::Axes`]: all nine axes, without R.
pub const ALL_AXES: u16 = 0x1FF;
/// In [`Argument::Axes`]: R, the circle vectors.
pub const VECTORS: u16 = 0x200;

/// A command and its operand, built by the compiler or from words. The operand has the shape of the code.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Item {
    /// The command.
    pub code: &'static Code,
    /// Its operand.
    pub argument: Argument,
}

/// Why two words are no command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NoCommand {
    /// No command has these codes.
    #[error("no command has CODE1 {code1} and these codes")]
    Code {
        /// CODE1.
        code1: u8,
    },
    /// ABS, INC or FRAX, if the settings do not say where their code stands.
    #[error(
        "it is ABS, INC or FRAX, and which one depends on rotary_code2; set that to bit12 or bit16 (pmacctl rotary check finds out)"
    )]
    Untold,
    /// WAIT.
    #[error("WAIT is not implemented in PMAC")]
    Wait,
    /// The data of a list or count that have no text.
    #[error("the data ${data:06X} of {name} name nothing")]
    Data {
        /// The command.
        name: &'static str,
        /// Word 2.
        data: u32,
    },
}

const WORD: u32 = 0x00FF_FFFF;

impl Item {
    /// The two words, without the start-of-line bit. `None` for ABS, INC and FRAX if the settings do not say where
    /// their code stands, and for an operand of another shape than the code's.
    #[must_use]
    pub fn words(&self, settings: &Settings) -> Option<(u32, u32)> {
        let first = |code1: u8, low: u8| u32::from(code1) << 6 | u32::from(low);
        Some(match (self.code.shape, self.argument) {
            (Shape::Letter { code1, .. }, Argument::Number(float)) => (
                (float.mantissa as u32 & 0xFFF) << 12 | first(code1, float.exponent),
                (float.mantissa >> 12) as u32 & WORD,
            ),
            (Shape::Data { code2 } | Shape::Mark { code2 }, Argument::Number(float)) => {
                (u32::from(code2) << 16 | first(DATA, float.exponent), float.mantissa as u32 & WORD)
            }
            (Shape::Assignment { code1, code2, .. }, Argument::Assignment(number, float)) => (
                u32::from(number & 0x3FF) << 14 | u32::from(code2) << 12 | first(code1, float.exponent),
                float.mantissa as u32 & WORD,
            ),
            (Shape::Count { code2 }, Argument::Count(count)) => {
                (mode_code(code2, settings) | first(MODES, 0), if count == 0 { 1024 } else { count.into() })
            }
            (Shape::Bare { code2 }, _) => (mode_code(code2, settings) | first(MODES, 0), 0),
            (Shape::Axes { code2, .. }, Argument::Axes(axes)) => {
                let code = u32::from(code2) << settings.rotary_code2?.lowest_bit();
                (code | first(MODES, 2), axis_mask(code2, axes, settings))
            }
            (Shape::Motors { subcode }, Argument::Motors(motors)) => (first(MODES, subcode), motors),
            (Shape::Plcs { code2 }, Argument::Plcs(plcs)) => {
                ((plcs & 0xFF) << 16 | u32::from(code2) << 12 | first(MODES, 1), plcs >> 8)
            }
            _ => return None,
        })
    }

    /// The command of two words, of which the low 24 bits count. Ignores the start-of-line bit and unused bits.
    ///
    /// # Errors
    /// When no command has these codes, or a list or count is empty or out of range.
    pub fn from_words(word1: u32, word2: u32, settings: &Settings) -> Result<Self, NoCommand> {
        let (word1, word2) = (word1 & WORD & !START_OF_LINE, word2 & WORD);
        let code1 = (word1 >> 6 & 0x1F) as u8;
        let low = (word1 & 0x3F) as u8;
        let high = (word1 >> 16) as u8;
        let two_bits = (word1 >> 12 & 3) as u8;
        let is_axes = code1 == MODES && low == 2;
        let axes = settings.rotary_code2.map(|place| (word1 >> place.lowest_bit() & 3) as u8);
        let mode = (word1 >> settings.mode_code_bit & 0x1F) as u8;
        let is_wait = code1 == MODES && low == 0 && mode == 8;
        let code = CODES.iter().find(|code| match code.shape {
            Shape::Letter { code1: own, .. } => code1 == own,
            Shape::Data { code2 } | Shape::Mark { code2 } => code1 == DATA && high == code2,
            Shape::Assignment { code1: own, code2, .. } => code1 == own && two_bits == code2,
            Shape::Count { code2 } | Shape::Bare { code2 } => code1 == MODES && low == 0 && mode == code2,
            Shape::Axes { code2, .. } => is_axes && axes == Some(code2),
            Shape::Motors { subcode } => code1 == MODES && low == subcode,
            Shape::Plcs { code2 } => code1 == MODES && low == 1 && two_bits & 1 == code2,
        });
        let code = code.ok_or(match () {
            () if is_axes && axes.is_none() => NoCommand::Untold,
            () if is_wait => NoCommand::Wait,
            () => NoCommand::Code { code1 },
        })?;
        let short = Float { mantissa: sign_extend(word2, 24), exponent: low, width: Width::Short };
        let nothing = NoCommand::Data { name: code.name, data: word2 };
        let argument = match code.shape {
            Shape::Letter { .. } => Argument::Number(Float {
                mantissa: sign_extend(word2, 24) << 12 | i64::from(word1 >> 12),
                exponent: low,
                width: Width::Long,
            }),
            Shape::Data { .. } | Shape::Mark { .. } => Argument::Number(short),
            Shape::Assignment { .. } => Argument::Assignment((word1 >> 14) as u16, short),
            Shape::Bare { .. } => Argument::None,
            Shape::Count { .. } => match word2 {
                1..=1023 => Argument::Count(word2 as u16),
                1024 => Argument::Count(0),
                _ => return Err(nothing),
            },
            Shape::Axes { code2, vectors } => {
                let bits = ALL_AXES | if vectors { VECTORS } else { 0 };
                let set = (0..10).filter(|&k| bits >> k & 1 == 1).map(|k| 1u16 << k);
                let axes = set.filter(|&axis| word2 & axis_mask(code2, axis, settings) != 0).sum::<u16>();
                if axes == 0 {
                    return Err(nothing);
                }
                Argument::Axes(axes)
            }
            Shape::Motors { .. } => match word2 & settings.home_mask() {
                0 => return Err(nothing),
                motors => Argument::Motors(motors),
            },
            Shape::Plcs { .. } => match word2 << 8 | u32::from(high) {
                0 => return Err(nothing),
                plcs => Argument::Plcs(plcs),
            },
        };
        Ok(Self { code, argument })
    }
}

const fn mode_code(code2: u8, settings: &Settings) -> u32 {
    (code2 as u32) << settings.mode_code_bit & WORD
}

/// The bits of `axes` (see [`Argument::Axes`]) in word 2 of ABS, INC (`code2` 0, 1) or FRAX (2).
fn axis_mask(code2: u8, axes: u16, settings: &Settings) -> u32 {
    let lowest = if code2 == 2 { settings.frax_axis_bit } else { settings.abs_inc_axis_bit };
    let of_axes: u32 =
        (0..AXES.len()).map(|k| u32::from(axes >> k & 1) << (usize::from(lowest) + 2 * k)).sum();
    of_axes | u32::from(axes & VECTORS != 0) << settings.abs_inc_vector_bit
}

fn sign_extend(word: u32, bits: u32) -> i64 {
    i64::from((word << (32 - bits)) as i32 >> (32 - bits))
}

/// The letter of an axis bit, R for [`VECTORS`].
pub(super) fn axis_letter(bit: usize) -> char {
    AXES.get(bit).map_or('R', |&letter| letter.into())
}

/// The bit of an axis letter or R in [`Argument::Axes`].
pub(super) fn axis_bit(code: &codes::Code) -> Option<u16> {
    match (code.name.as_bytes(), AXES.iter().position(|letter| code.name.as_bytes() == [*letter])) {
        (_, Some(place)) => Some(1 << place),
        (b"R", None) => Some(VECTORS),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::readings::RotaryCode2;
    use proptest::prelude::*;

    fn with(place: RotaryCode2) -> Settings {
        Settings { rotary_code2: Some(place), ..Settings::default() }
    }

    #[test]
    fn words_of_no_command_are_refused() {
        let settings = with(RotaryCode2::Bit12);
        let read = |word1, word2| Item::from_words(word1, word2, &settings);
        assert_eq!(read(0x000800, 0x00FFFF), Err(NoCommand::Code { code1: 0 }));
        assert_eq!(read(29 << 6, 0), Err(NoCommand::Code { code1: 29 }));
        assert_eq!(read(31 << 6, 0), Err(NoCommand::Code { code1: 31 }));
        assert_eq!(read(0x080F80, 0), Err(NoCommand::Wait));
        assert_eq!(read(0x030F00, 0), Err(NoCommand::Code { code1: 28 }));
        assert_eq!(read(0x000F84, 1), Err(NoCommand::Code { code1: 30 }));
        // Empty lists, and counts outside 1 to 1024.
        for (word1, word2) in
            [(0x000F83, 0x100), (0x000F81, 0), (0x000F82, 1), (0x000F80, 0), (0x0C0F80, 1025)]
        {
            assert!(matches!(read(word1, word2), Err(NoCommand::Data { .. })), "{word1:06X} {word2:06X}");
        }
    }

    #[test]
    fn the_settings_move_their_fields() {
        let abs = Item { code: codes::find("ABS").unwrap(), argument: Argument::Axes(1 | VECTORS) };
        let moved = Settings { abs_inc_axis_bit: 2, abs_inc_vector_bit: 1, ..with(RotaryCode2::Bit12) };
        assert_eq!(abs.words(&moved), Some((0x000782, 0x000006)));
        let linear = Item { code: codes::find("LINEAR").unwrap(), argument: Argument::None };
        assert_eq!(linear.words(&Settings { mode_code_bit: 19, ..Settings::default() }), Some((0x080780, 0)));
    }

    #[test]
    fn code2_of_the_axis_lists_stands_where_it_was_told_and_nowhere_before() {
        for (rotary_code2, words) in [
            (RotaryCode2::Bit12, [0x000782, 0x001782, 0x002782]),
            (RotaryCode2::Bit16, [0x000782, 0x010782, 0x020782]),
        ] {
            let settings = with(rotary_code2);
            for (name, word1) in ["ABS", "INC", "FRAX"].into_iter().zip(words) {
                let item = Item { code: codes::find(name).unwrap(), argument: Argument::Axes(1 << 6) };
                let (first, second) = item.words(&settings).unwrap();
                assert_eq!(first, word1, "{rotary_code2:?} {name}");
                assert_eq!(Item::from_words(first, second, &settings), Ok(item));
                assert_eq!(item.words(&Settings::default()), None);
                assert_eq!(Item::from_words(first, second, &Settings::default()), Err(NoCommand::Untold));
            }
        }
    }

    #[test]
    fn codes_fit_what_they_are_called_by() {
        assert_eq!(codes::ASSIGN, b'N' - b'A' + 1);
        assert_eq!(codes::LATER, b'O' - b'A' + 1);
        assert_eq!(axis_bit(codes::find("Z").unwrap()), Some(1 << 8));
        assert_eq!(axis_bit(codes::find("R").unwrap()), Some(VECTORS));
        assert_eq!(axis_bit(codes::find("F").unwrap()), None);
    }

    proptest! {
        #[test]
        fn what_words_mean_is_what_its_words_mean(word1 in any::<u32>(), word2 in any::<u32>()) {
            let settings = with(RotaryCode2::Bit16);
            if let Ok(item) = Item::from_words(word1, word2, &settings) {
                let (a, b) = item.words(&settings).unwrap();
                prop_assert!(a & !WORD == 0 && b & !WORD == 0 && a & START_OF_LINE == 0);
                prop_assert_eq!(Item::from_words(a, b, &settings), Ok(item));
            }
        }
    }
}
