//! The absolute position that the words of a format's registers hold (see [`super`]).

use std::fmt;
use std::str::FromStr;

use super::{AbsoluteFormat, Kind, MemoryAddress};
use crate::map::{Space, number};

/// The content of a 24-bit register, as typed: `Y:$078D00=$123456`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Word {
    /// `X` or `Y`.
    pub space: Space,
    /// The number after the `$`.
    pub number: u32,
    /// The 24 bits.
    pub value: u32,
}

impl fmt::Display for Word {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:${:X}=${:06X}", self.space, self.number, self.value)
    }
}

/// Text that is no register with its content.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BadWord {
    /// Another shape.
    #[error("{text:?} is not a register with its content; write Y:$078D00=$123456")]
    Shape {
        /// The text.
        text: String,
    },
    /// A content of more than 24 bits.
    #[error("{value} in {text:?} does not fit a 24-bit register (-$800000 to $FFFFFF)")]
    Value {
        /// The text.
        text: String,
        /// The part that is wrong.
        value: String,
    },
}

impl FromStr for Word {
    type Err = BadWord;

    /// Reads `SPACE:ADDRESS=VALUE`; the value may be negative, which is the same as its 24-bit two's complement.
    fn from_str(text: &str) -> Result<Self, BadWord> {
        let shape = || BadWord::Shape { text: text.to_owned() };
        let (address, value) = text.split_once('=').ok_or_else(shape)?;
        let (space, number) = address.trim().split_once(':').ok_or_else(shape)?;
        let space = match space {
            "X" | "x" => Space::X,
            "Y" | "y" => Space::Y,
            _ => return Err(shape()),
        };
        let number = number::parse(number).map_err(|_| shape())?;
        let (negative, digits) = match value.trim().strip_prefix('-') {
            Some(digits) => (true, digits),
            None => (false, value),
        };
        let magnitude = number::parse(digits).map_err(|_| shape())?;
        if magnitude > if negative { 0x80_0000 } else { 0xFF_FFFF } {
            return Err(BadWord::Value { text: text.to_owned(), value: value.trim().to_owned() });
        }
        let value = if negative { magnitude.wrapping_neg() & 0xFF_FFFF } else { magnitude };
        Ok(Self { space, number, value })
    }
}

/// Why words give no position.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PositionError {
    /// The source is not in PMAC's memory, or its bits are not documented.
    #[error("{}: its bits are not documented, so no position can be worked out of words", kind.title())]
    NotDocumented {
        /// The kind of source.
        kind: Kind,
    },
    /// The user did not give a needed register.
    #[error("the content of {address} is missing; the position needs {needed}")]
    Missing {
        /// The register.
        address: MemoryAddress,
        /// All that are needed.
        needed: String,
    },
    /// The user gave a register that the format does not use.
    #[error("{word} is none of the registers the position is in; these are {needed}")]
    NotPartOfIt {
        /// The word.
        word: Word,
        /// All that are needed.
        needed: String,
    },
    /// The user gave a register twice.
    #[error("{address} is given twice")]
    Twice {
        /// The register.
        address: MemoryAddress,
    },
}

impl AbsoluteFormat {
    /// The position in these words, in counts of the sensor, without subtracting Ix26.
    ///
    /// # Errors
    /// [`PositionError`] unless `words` holds each register of the format once, and nothing else.
    pub fn position(&self, words: &[Word]) -> Result<i64, PositionError> {
        let (Some(bits), false) = (self.bits, self.registers.is_empty()) else {
            return Err(PositionError::NotDocumented { kind: self.kind });
        };
        let needed =
            || self.registers.iter().map(|part| part.address.to_string()).collect::<Vec<_>>().join(", ");
        let is_at = |word: &Word, at: MemoryAddress| (word.space, word.number) == (at.space, at.number);
        if let Some(word) =
            words.iter().find(|word| !self.registers.iter().any(|part| is_at(word, part.address)))
        {
            return Err(PositionError::NotPartOfIt { word: *word, needed: needed() });
        }
        let (mut raw, mut shift) = (0_i64, 0);
        for part in &self.registers {
            let mut found = words.iter().filter(|word| is_at(word, part.address));
            let word = found
                .next()
                .ok_or_else(|| PositionError::Missing { address: part.address, needed: needed() })?;
            if found.next().is_some() {
                return Err(PositionError::Twice { address: part.address });
            }
            let piece = word.value >> part.from_bit & ((1 << part.bits) - 1);
            raw |= i64::from(piece) << shift;
            shift += part.bits;
        }
        // At most 48 bits, so the sign bit can be moved up to the top and back.
        Ok(if self.signed { raw << (64 - bits) >> (64 - bits) } else { raw })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn words(texts: &[&str]) -> Vec<Word> {
        texts.iter().map(|text| text.parse().unwrap()).collect()
    }

    fn turbo(ixx10: u32, ixx95: u32, texts: &[&str]) -> Result<i64, PositionError> {
        AbsoluteFormat::turbo(ixx10, ixx95).unwrap().position(&words(texts))
    }

    #[test]
    fn positions_in_one_and_more_words() {
        assert_eq!(turbo(0x07_8D00, 0x20_0000, &["Y:$078D00=$123456", "Y:$078D01=$ABCD89"]), Ok(0x8912_3456));
        // The order of the words does not matter, and $FF of the unused bits neither.
        let signed = turbo(0x07_8D00, 0xA0_0000, &["y:$78D01=0xFFFF89", "Y:$078D00=0x123456"]);
        assert_eq!(signed, Ok(0x8912_3456 - (1 << 32)));
        assert_eq!(turbo(0x07_8C00, 0x10_0004, &["Y:$078C00=$FFFF34", "Y:$078C01=$FFFF12"]), Ok(0x1234));
        let middle = ["Y:$079E03=$FF56FF", "Y:$079E04=$FF34FF", "Y:$079E05=$FFFEFF"];
        assert_eq!(turbo(0x07_9E03, 0x12_0005, &middle), Ok(0x2_3456));
        assert_eq!(turbo(0x07_9E03, 0x92_0005, &middle), Ok(0x2_3456 - 0x4_0000));
        assert_eq!(turbo(0x07_8C00, 0x08_0006, &["Y:$078C00=$A5FFFF"]), Ok(0xA5));
        assert_eq!(turbo(0x07_8000, 0x54_0000, &["X:$078000=$FABCDE"]), Ok(0xA_BCDE));
        assert_eq!(turbo(0x07_8005, 0xB1_0000, &["Y:$078005=$FFFE77"]), Ok(-2));
        assert_eq!(turbo(0x07_8005, 0x31_0000, &["Y:$078005=-1"]), Ok(0xFFFF));
        let pmac = AbsoluteFormat::pmac(0xB0_FFD0).unwrap();
        let full = words(&["Y:$FFD0=$000000", "Y:65489=$800000"]);
        assert_eq!(pmac.position(&full), Ok(-(1 << 47)));
    }

    #[test]
    fn words_too_few_or_too_many_are_refused() {
        let refused = |texts: &[&str]| turbo(0x07_8D00, 0x20_0000, texts).unwrap_err().to_string();
        assert_eq!(
            refused(&["Y:$078D00=1"]),
            "the content of Y:$078D01 is missing; the position needs Y:$078D00, Y:$078D01"
        );
        assert!(refused(&["X:$078D00=1", "Y:$078D01=1"]).starts_with("X:$78D00=$000001 is none of"));
        assert_eq!(refused(&["Y:$078D00=1", "Y:$78D00=1", "Y:$078D01=1"]), "Y:$078D00 is given twice");
        assert!(turbo(0x08, 0, &["Y:$08=1"]).unwrap_err().to_string().contains("not documented"));
    }

    #[test]
    fn what_is_no_word_is_refused() {
        for text in
            ["", "Y:$1", "=1", "Y:$1=", "Y:=1", "L:$1=1", "$1=1", "Y:$1=x", "Y:$1=--1", "Y:-1=1", "é:1=1"]
        {
            assert!(matches!(text.parse::<Word>(), Err(BadWord::Shape { .. })), "{text}");
        }
        for text in ["Y:$1=$1000000", "Y:$1=-$800001", "Y:$1=16777216"] {
            assert!(matches!(text.parse::<Word>(), Err(BadWord::Value { .. })), "{text}");
        }
        assert_eq!("Y:$1=-8388608".parse::<Word>().unwrap().value, 0x80_0000);
    }

    /// Puts the position into the registers bit by bit, and noise into all other bits.
    fn encode(format: &AbsoluteFormat, position: i64, noise: u32) -> Vec<Word> {
        let mut next = 0;
        format
            .registers
            .iter()
            .map(|part| {
                let mut value = noise & 0xFF_FFFF;
                for bit in part.from_bit..part.from_bit + part.bits {
                    value &= !(1 << bit);
                    value |= u32::from(position >> next & 1 == 1) << bit;
                    next += 1;
                }
                Word { space: part.address.space, number: part.address.number, value }
            })
            .collect()
    }

    proptest! {
        #[test]
        fn an_encoded_position_comes_back(
            bits in 8u32..=48, x in any::<bool>(), signed in any::<bool>(), sub in prop::sample::select(vec![0, 4, 5, 6]),
            address in 1u32..0x07_FFF0, any in any::<i64>(), noise in any::<u32>(),
        ) {
            let ixx95 = (bits + if x { 0x40 } else { 0 } + if signed { 0x80 } else { 0 }) << 16 | sub;
            let format = AbsoluteFormat::turbo(address, ixx95).unwrap();
            let position = if signed { any >> (64 - bits) } else { any & ((1 << bits) - 1) };
            let mut words = encode(&format, position, noise);
            prop_assert_eq!(format.position(&words), Ok(position));
            words.reverse();
            prop_assert_eq!(format.position(&words), Ok(position));
        }

        #[test]
        fn an_encoded_position_comes_back_on_classic_boards(
            code in prop::sample::select(vec![0x08u32, 0x18, 0x19, 0x30, 0x31, 0x48, 0x70, 0x88, 0xB0, 0xB1, 0xF0]),
            address in 0u32..0xFFF0, any in any::<i64>(), noise in any::<u32>(),
        ) {
            let format = AbsoluteFormat::pmac(code << 16 | address).unwrap();
            let bits = format.bits.unwrap();
            let position = if code >= 0x80 { any >> (64 - bits) } else { any & ((1 << bits) - 1) };
            prop_assert_eq!(format.position(&encode(&format, position, noise)), Ok(position));
        }

        #[test]
        fn a_printed_word_reads_back(x in any::<bool>(), number in any::<u32>(), value in 0u32..0x100_0000) {
            let word = Word { space: if x { Space::X } else { Space::Y }, number, value };
            prop_assert_eq!(word.to_string().parse(), Ok(word));
        }

        #[test]
        fn nothing_panics(text in "\\PC{0,20}", one in any::<u32>(), other in any::<u32>()) {
            let _ = text.parse::<Word>();
            let _ = AbsoluteFormat::pmac(one);
            let _ = AbsoluteFormat::turbo(one, other);
        }
    }
}
