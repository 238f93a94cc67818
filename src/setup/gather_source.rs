//! A source of data gathering, as I21 to I44 hold it: an address and, in bits 23-22, how to read it.

use std::fmt;
use std::str::FromStr;

use super::number;
use crate::map::{PmacAddress, Space};

/// A register to gather, `Y:`, `X:`, `D:` or `L:` and a 16-bit address.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GatherSource {
    space: Space,
    number: u32,
}

/// Text that names no register that can be gathered.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{text:?} cannot be gathered; write Y:$C000, X:$C001, D:$002B or L:$1005, with at most four digits")]
pub struct BadSource {
    /// The text.
    pub text: String,
}

impl FromStr for GatherSource {
    type Err = BadSource;

    fn from_str(text: &str) -> Result<Self, BadSource> {
        let bad = || BadSource { text: text.to_owned() };
        let (letter, address) = text.trim().split_once(':').ok_or_else(bad)?;
        let space = [Space::Y, Space::X, Space::D, Space::L]
            .into_iter()
            .find(|space| space.name().eq_ignore_ascii_case(letter))
            .ok_or_else(bad)?;
        match number::parse(address) {
            Ok(number @ 0..=0xFFFF) => Ok(Self { space, number }),
            _ => Err(bad()),
        }
    }
}

impl fmt::Display for GatherSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        PmacAddress::new(self.space, self.number).fmt(f)
    }
}

impl GatherSource {
    /// The register at `address`, or `None` for a space or a number that cannot be gathered.
    #[must_use]
    pub const fn new(address: PmacAddress) -> Option<Self> {
        let PmacAddress { space, number } = address;
        match space {
            Space::Y | Space::X | Space::D | Space::L if number <= 0xFFFF => Some(Self { space, number }),
            _ => None,
        }
    }

    /// The register.
    #[must_use]
    pub const fn address(self) -> PmacAddress {
        PmacAddress::new(self.space, self.number)
    }

    /// The value of the I-variable: $0aaaa for Y, $40aaaa for X, $80aaaa for D, $C0aaaa for L.
    #[must_use]
    pub const fn code(self) -> u32 {
        let how = match self.space {
            Space::X => 1,
            Space::D => 2,
            Space::L => 3,
            _ => 0,
        };
        how << 22 | self.number
    }

    /// How many 32-bit DPRAM words a value takes.
    #[must_use]
    pub const fn longs(self) -> u32 {
        match self.space {
            Space::D | Space::L => 2,
            _ => 1,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_four_codes() {
        let source = |text: &str| text.parse::<GatherSource>().unwrap();
        let codes =
            [("Y:$C003", 0xC003), ("x:$0033", 0x40_0033), ("D:$002B", 0x80_002B), ("L:$1005", 0xC0_1005)];
        for (text, code) in codes {
            assert_eq!(source(text).code(), code, "{text}");
        }
        assert_eq!((source("Y:1").longs(), source("L:1").longs()), (1, 2));
        assert_eq!(source("d:43").to_string(), "D:$002B");
    }

    #[test]
    fn what_cannot_be_gathered_is_refused() {
        for text in ["", "D", "D:", "DP:$D200", "F:$D200", "Y:$10000", "Y:-1", "$002B"] {
            assert!(text.parse::<GatherSource>().is_err(), "{text}");
        }
    }
}
