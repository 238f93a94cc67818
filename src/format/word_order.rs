//! The order of the two bytes in a 16-bit word as the bus delivers them.

/// Whether the bus between the board and this machine swaps the bytes of each 16-bit word.
///
/// A setting of the bus, independent of [`super::TextOrder`]: a VME bridge may swap words, the text may need a swap, or
/// both. Boards in production show every combination.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum WordOrder {
    /// Words arrive as the board holds them (ISA, PCI).
    #[default]
    Little,
    /// The two bytes of each word arrive swapped (some VME bridges).
    Swapped,
}

impl WordOrder {
    /// Converts a bus word to a board word, or back: the operation is its own inverse.
    #[inline]
    #[must_use]
    pub const fn apply(self, word: u16) -> u16 {
        match self {
            Self::Little => word,
            Self::Swapped => word.swap_bytes(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::WordOrder;

    #[test]
    fn swapping_twice_changes_no_word() {
        for word in 0..=u16::MAX {
            assert_eq!(WordOrder::Little.apply(word), word);
            assert_eq!(WordOrder::Swapped.apply(WordOrder::Swapped.apply(word)), word);
        }
        assert_eq!(WordOrder::Swapped.apply(0x1234), 0x3412);
    }

    #[test]
    fn names_in_settings_are_kebab_case() {
        assert_eq!(serde_json::to_string(&WordOrder::Swapped).unwrap(), "\"swapped\"");
        assert_eq!(serde_json::from_str::<WordOrder>("\"little\"").unwrap(), WordOrder::Little);
    }
}
