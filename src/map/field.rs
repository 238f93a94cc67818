//! Bit fields as people type them: `Y:$D800,8,4` is four bits from bit 8 on; without the comma, all of the place.

use super::{AddressError, Family, Space, TypedAddress};

/// Some or all bits of a place in the DPRAM.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Field {
    /// The place.
    pub location: TypedAddress,
    /// The lowest bit and the width of a part of the place; `None`: the whole place.
    pub bits: Option<BitField>,
}

/// A stretch of bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct BitField {
    /// The lowest bit, from 0.
    pub offset: u32,
    /// How many bits, at least 1.
    pub width: u32,
}

impl BitField {
    /// The mask of the field.
    #[must_use]
    pub const fn mask(self) -> u32 {
        (u32::MAX >> (32 - self.width)) << self.offset
    }

    /// The field's value in `word`, unsigned.
    #[must_use]
    pub const fn of(self, word: u32) -> u32 {
        (word & self.mask()) >> self.offset
    }
}

/// Text that names no bits in the DPRAM.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FieldError {
    /// The text before the comma is no address.
    #[error(transparent)]
    Address(#[from] AddressError),
    /// The text after the place is no offset and width.
    #[error("{text:?}: after the address come the field's lowest bit and its width, as in Y:$D800,8,4")]
    Shape {
        /// The text.
        text: String,
    },
    /// A field beyond the place.
    #[error("{text:?}: the field does not lie in the {bits} bits of {space}:")]
    Outside {
        /// The text.
        text: String,
        /// The place's space.
        space: Space,
        /// How many bits the place has.
        bits: u32,
    },
    /// A place without bit fields.
    #[error("{text:?}: only Y:, X: and DP: have bit fields")]
    Whole {
        /// The text.
        text: String,
    },
}

impl Field {
    /// Reads an address with or without a bit field.
    ///
    /// # Errors
    /// [`FieldError`].
    pub fn parse(text: &str, family: &Family) -> Result<Self, FieldError> {
        let text = text.trim();
        let Some((address, field)) = text.split_once(',') else {
            return Ok(Self { location: TypedAddress::parse(text, family)?, bits: None });
        };
        let location = TypedAddress::parse(address, family)?;
        let said = || text.to_owned();
        let available = match location.space {
            Space::Y | Space::X => 16,
            Space::Dp => 32,
            _ => return Err(FieldError::Whole { text: said() }),
        };
        let number = |digits: &str| {
            let plain = !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit());
            digits.parse::<u32>().ok().filter(|_| plain)
        };
        let parts = field.split_once(',').and_then(|(offset, width)| {
            Some(BitField { offset: number(offset.trim())?, width: number(width.trim())? })
        });
        let bits = parts.ok_or_else(|| FieldError::Shape { text: said() })?;
        let end = bits.offset.checked_add(bits.width);
        if bits.width == 0 || end.is_none_or(|end| end > available) {
            return Err(FieldError::Outside { text: said(), space: location.space, bits: available });
        }
        Ok(Self { location, bits: Some(bits) })
    }
}

#[cfg(test)]
mod tests {
    use super::super::PMAC;
    use super::*;

    #[test]
    fn fields_are_read_and_bounded() {
        let field = Field::parse("Y:$D800,8,4", &PMAC).unwrap();
        assert_eq!(field.bits, Some(BitField { offset: 8, width: 4 }));
        assert_eq!(field.location, TypedAddress::parse("Y:$D800", &PMAC).unwrap());
        assert_eq!(Field::parse("F:$D800", &PMAC).unwrap().bits, None);
        assert_eq!(Field::parse("DP:$D800, 0, 32", &PMAC).unwrap().bits.unwrap().mask(), u32::MAX);
        let bits = BitField { offset: 8, width: 4 };
        assert_eq!((bits.mask(), bits.of(0x0A5F)), (0x0F00, 0xA));
        for (wrong, expected) in [
            ("Y:$D800,8", "lowest bit and its width"),
            ("Y:$D800,8,4,1", "lowest bit and its width"),
            ("Y:$D800,-1,4", "lowest bit and its width"),
            ("Y:$D800,+1,4", "lowest bit and its width"),
            ("Y:$D800,13,4", "16 bits of Y"),
            ("Y:$D800,0,0", "16 bits of Y"),
            ("DP:$D800,4294967295,1", "32 bits of DP"),
            ("F:$D800,0,4", "only Y:, X: and DP:"),
            ("Q:$D800,0,4", "not an address"),
        ] {
            let error = Field::parse(wrong, &PMAC).unwrap_err().to_string();
            assert!(error.contains(expected), "{wrong}: {error}");
        }
    }
}
