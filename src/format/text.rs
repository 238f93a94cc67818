//! Characters packed two a word, as the ASCII buffers hold them (DPRAM manual p. 29).

/// Which half of a 16-bit word holds the first character of a pair.
///
/// A setting of its own, apart from the word order of the bus: VME boards in production need one, the other, or both.
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
