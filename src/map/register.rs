//! A register of PMAC's own memory: to gather, to watch, or to write in the background.

use std::fmt;
use std::str::FromStr;

use super::typed::quote_hint;
use super::{Family, PmacAddress, Space, VariableKind, number};

/// The highest address of any family: 19 bits.
const LAST_ADDRESS: u32 = (1 << 19) - 1;

/// A register as PMAC reads and writes it: `Y:` or `X:` for one word, `D:` or `L:` for two as a fixed or floating point
/// number. The spaces of the DPRAM alone (`DP:`, `F:`) are no registers in this sense.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct PmacRegister {
    address: PmacAddress,
}

/// Text that names no register.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "{text:?} is no register{}; write Y:$C000, X:$C001, D:$002B or L:$1005, with an address up to ${last:X}{}",
    if *in_dpram { " that PMAC copies, but a place in the DPRAM, which `pmacctl read` shows" } else { "" },
    quote_hint(text)
)]
pub struct BadRegister {
    /// The text.
    pub text: String,
    /// The last address.
    pub last: u32,
    /// The space exists only in the DPRAM.
    pub in_dpram: bool,
}

impl FromStr for PmacRegister {
    type Err = BadRegister;

    /// Reads a register of any family. With a family, [`PmacRegister::parse`] refuses registers that the family lacks.
    fn from_str(text: &str) -> Result<Self, BadRegister> {
        Self::up_to(text, LAST_ADDRESS)
    }
}

impl fmt::Display for PmacRegister {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.address.fmt(f)
    }
}

impl PmacRegister {
    /// The register at `address`, or `None` for a space or a number that is no register's.
    #[must_use]
    pub const fn new(address: PmacAddress) -> Option<Self> {
        match address.space {
            Space::Y | Space::X | Space::D | Space::L if address.number <= LAST_ADDRESS => {
                Some(Self { address })
            }
            _ => None,
        }
    }

    /// Reads a register of `family`.
    ///
    /// # Errors
    /// [`BadRegister`] for another shape or space, or an address of more bits than the family's have.
    pub fn parse(text: &str, family: &Family) -> Result<Self, BadRegister> {
        Self::up_to(text, family.last_address())
    }

    fn up_to(text: &str, last: u32) -> Result<Self, BadRegister> {
        let address = text.trim().split_once(':').and_then(|(letters, digits)| {
            let space = Space::ALL.into_iter().find(|space| space.name().eq_ignore_ascii_case(letters))?;
            Some(PmacAddress::new(space, number::parse(digits).ok()?))
        });
        let in_dpram = address.is_some_and(|address| matches!(address.space, Space::Dp | Space::F));
        let register = address.and_then(Self::new).filter(|register| register.address.number <= last);
        register.ok_or_else(|| BadRegister { text: text.to_owned(), last, in_dpram })
    }

    /// The register's address.
    #[must_use]
    pub const fn address(self) -> PmacAddress {
        self.address
    }

    /// Its kind in the tables of the variable functions. They do not tell `D:` from `L:`.
    #[must_use]
    pub const fn kind(self) -> VariableKind {
        match self.address.space {
            Space::Y => VariableKind::Y,
            Space::X => VariableKind::X,
            _ => VariableKind::Long,
        }
    }

    /// The form in a gather source's I-variable: the address, and in bits 23-22 how to read it: 0 Y, 1 X, 2 D, 3 L.
    #[must_use]
    pub const fn gather_code(self) -> u32 {
        let space = match self.address.space {
            Space::X => 1,
            Space::D => 2,
            Space::L => 3,
            _ => 0,
        };
        space << 22 | self.address.number
    }

    /// 32-bit DPRAM words of its value.
    #[must_use]
    pub const fn longs(self) -> u32 {
        self.kind().words() as u32 / 2
    }
}

#[cfg(test)]
mod tests {
    use super::super::PMAC;
    use super::*;

    #[test]
    fn the_four_spaces_and_their_codes() {
        let register = |text: &str| text.parse::<PmacRegister>().unwrap();
        let codes = [
            ("Y:$C003", 0xC003, VariableKind::Y),
            ("x:$0033", 0x40_0033, VariableKind::X),
            ("D:$002B", 0x80_002B, VariableKind::Long),
            ("L:$1005", 0xC0_1005, VariableKind::Long),
            // I5017 of a site's board (a dump in ls-cat-org/pgpmac).
            ("Y:$07A205", 0x7_A205, VariableKind::Y),
        ];
        for (text, code, kind) in codes {
            assert_eq!((register(text).gather_code(), register(text).kind()), (code, kind), "{text}");
        }
        assert_eq!((register("Y:1").longs(), register("L:1").longs()), (1, 2));
        assert_eq!(register("d:43").to_string(), "D:$002B");
        assert_eq!(register("x:$7a205").to_string(), "X:$07A205");
    }

    #[test]
    fn what_is_no_register_is_refused() {
        for text in ["", "D", "D:", "DP:$D200", "F:$D200", "Y:$80000", "Y:-1", "$002B"] {
            assert!(text.parse::<PmacRegister>().is_err(), "{text}");
        }
    }

    #[test]
    fn a_family_refuses_addresses_it_does_not_have() {
        let far = "Y:$10000";
        assert!(far.parse::<PmacRegister>().is_ok(), "another family has it");
        let error = PmacRegister::parse(far, &PMAC).unwrap_err().to_string();
        assert!(error.ends_with("with an address up to $FFFF"), "{error}");
        assert!(PmacRegister::parse("Y:$FFFF", &PMAC).is_ok());
    }
}
