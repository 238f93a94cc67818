//! Characters packed two a word, as the ASCII buffers hold them (DPRAM manual p. 29).

/// Which half of a 16-bit word holds the first character of a pair.
///
/// Independent of the bus's word order: VME boards in production need one, the other, or both.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum TextOrder {
    /// First character in bits 7-0, as the manual says.
    #[default]
    LowFirst,
    /// First character in bits 15-8.
    HighFirst,
}

impl TextOrder {
    /// Packs two characters, in reading order, into a word.
    #[must_use]
    pub const fn pack(self, first: u8, second: u8) -> u16 {
        match self {
            Self::LowFirst => u16::from_le_bytes([first, second]),
            Self::HighFirst => u16::from_be_bytes([first, second]),
        }
    }

    /// The two characters of a word in reading order. Inverse of [`TextOrder::pack`].
    #[must_use]
    pub const fn unpack(self, word: u16) -> [u8; 2] {
        match self {
            Self::LowFirst => word.to_le_bytes(),
            Self::HighFirst => word.to_be_bytes(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_orders_pack_every_pair_both_ways() {
        for first in 0..=u8::MAX {
            for second in 0..=u8::MAX {
                let low = TextOrder::LowFirst.pack(first, second);
                let high = TextOrder::HighFirst.pack(first, second);
                assert_eq!(low, u16::from(second) << 8 | u16::from(first));
                assert_eq!(high, low.swap_bytes());
                assert_eq!(TextOrder::LowFirst.unpack(low), [first, second]);
                assert_eq!(TextOrder::HighFirst.unpack(high), [first, second]);
            }
        }
    }

    #[test]
    fn orders_have_names_in_settings() {
        assert_eq!(serde_json::to_string(&TextOrder::HighFirst).unwrap(), "\"high-first\"");
        assert_eq!(TextOrder::default(), TextOrder::LowFirst);
    }
}
