//! The value at a typed address, read the way its space says.

use serde::Serialize;

use crate::format::{Float48Layout, fixed48, float32, join32};
use crate::map::{BitField, Space};

/// The value of a location.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Value {
    /// `Y:` and `X:`, a 16-bit word, unsigned.
    Word(u16),
    /// `DP:`, 32 bits, signed.
    Long(i32),
    /// `D:`, 48-bit fixed point.
    Fixed(i64),
    /// `F:` and `L:`, floating point. JSON has `null` for a value that is not finite.
    Float(f64),
}

impl Value {
    /// As a number with 53 bits, which hold every value but a large one of 64 bits.
    #[must_use]
    pub const fn number(self) -> f64 {
        match self {
            Self::Word(value) => value as f64,
            Self::Long(value) => value as f64,
            Self::Fixed(value) => value as f64,
            Self::Float(value) => value,
        }
    }
}

/// Decodes the words of a location, from its offset on; `None` if there are fewer than [`Space::words`].
#[must_use]
pub fn value(space: Space, words: &[u16], float48: Float48Layout) -> Option<Value> {
    match (space, words.get(..space.words())?) {
        (Space::Y | Space::X, &[word]) => Some(Value::Word(word)),
        (Space::Dp, &[low, high]) => Some(Value::Long(join32(low, high) as i32)),
        (Space::F, &[low, high]) => Some(Value::Float(float32::decode(low, high).into())),
        (Space::D, &[a, b, c, d]) => Some(Value::Fixed(fixed48::decode(join32(a, b), join32(c, d)))),
        (Space::L, &[a, b, c, d]) => Some(Value::Float(float48.decode(join32(a, b), join32(c, d)))),
        _ => None,
    }
}

/// The value of some bits of a location, which has one word or two; the highest bit is the sign if they are `signed`.
#[must_use]
pub fn bits(field: BitField, signed: bool, words: &[u16]) -> Option<Value> {
    let word = match *words {
        [word] => word.into(),
        [low, high] => join32(low, high),
        _ => return None,
    };
    let value = field.of(word);
    if signed {
        let unused = 32 - field.width;
        return Some(Value::Fixed((value << unused).cast_signed().wrapping_shr(unused).into()));
    }
    Some(u16::try_from(value).map_or(Value::Fixed(value.into()), Value::Word))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_space_reads_its_own_words() {
        let read = |space, words: &[u16]| value(space, words, Float48Layout::Register);
        assert_eq!(read(Space::X, &[0xFFFF, 1]), Some(Value::Word(0xFFFF)));
        assert_eq!(read(Space::Dp, &[0xFFFE, 0xFFFF]), Some(Value::Long(-2)));
        assert_eq!(read(Space::F, &[0, 0x4049]), Some(Value::Float(3.140_625)));
        assert_eq!(read(Space::D, &[0xF400, 0xFFFF, 0xFFFF, 0xFFFF]), Some(Value::Fixed(-3072)));
        assert_eq!(read(Space::L, &[0x0801, 0, 0, 0xFF98]), Some(Value::Float(-3.25)));
        for space in Space::ALL {
            assert_eq!(read(space, &[0; 4][..space.words() - 1]), None);
        }
    }

    #[test]
    fn bits_are_signed_where_that_is_said() {
        let field = |offset, width| BitField { offset, width };
        assert_eq!(bits(field(8, 4), false, &[0x0F00]), Some(Value::Word(15)));
        assert_eq!(bits(field(8, 4), true, &[0x0F00]), Some(Value::Fixed(-1)));
        assert_eq!(bits(field(0, 32), true, &[0, 0x8000]), Some(Value::Fixed(i32::MIN.into())));
        assert_eq!(bits(field(0, 32), false, &[0, 0x8000]), Some(Value::Fixed(0x8000_0000)));
        assert_eq!(bits(field(0, 4), false, &[0; 4]), None);
    }
}
