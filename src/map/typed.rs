//! Addresses as people type them: `Y:$D001`, `DP:$D200`, `l:$d09a`, or a host offset `0x0024`.

use super::{Family, HostOffset, PmacAddress, Space};

/// A place in the DPRAM and how to read it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TypedAddress {
    /// The half, or the way to read more. A host offset gives `Y` or `X`, the half that holds the offset.
    pub space: Space,
    /// The first word.
    pub offset: HostOffset,
}

/// Text that names no place in the DPRAM. Each message says what to write instead.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum AddressError {
    /// Neither a PMAC address nor a host offset.
    #[error("{text:?} is not an address; write {examples}{}", quote_hint(text))]
    Shape {
        /// The text.
        text: String,
        /// Addresses of the family.
        examples: String,
    },
    /// A character that is no digit, or a number of more than 32 bits.
    #[error("{digits:?} in address {text:?} is not a {base} number{}", quote_hint(text))]
    Digits {
        /// The text.
        text: String,
        /// The wrong part.
        digits: String,
        /// The right form.
        base: &'static str,
    },
    /// An odd host offset.
    #[error("host offset {text} is odd; DPRAM words lie at even offsets")]
    Odd {
        /// The text.
        text: String,
    },
    /// A place the DPRAM does not have.
    #[error("{text} lies outside the DPRAM of a {family}, which has {first} to {last}")]
    Outside {
        /// The text.
        text: String,
        /// The family's name.
        family: &'static str,
        /// The DPRAM's first address of the kind typed.
        first: String,
        /// Its last address of the kind typed.
        last: String,
    },
}

impl TypedAddress {
    /// Reads a typed address. Capitals do not matter; the colon is optional; a PMAC number without `$` is decimal, as
    /// for PMAC.
    ///
    /// # Errors
    /// [`AddressError`] if the text has another shape, or names a place outside the family's DPRAM.
    pub fn parse(text: &str, family: &Family) -> Result<Self, AddressError> {
        let text = text.trim();
        if let Some(digits) = host_digits(text) {
            return host(text, digits, family);
        }
        let (space, number) = split_space(text).ok_or_else(|| shape(text, family))?;
        let number = match number.strip_prefix(':') {
            Some(number) => number,
            // Without a colon only a number makes an address of a letter; "foo" is no `F` address.
            None if number.starts_with(|c: char| c == '$' || c.is_ascii_digit()) => number,
            None => return Err(shape(text, family)),
        };
        let number = match number.strip_prefix('$') {
            Some(digits) => parse_digits(text, digits, 16)?,
            None if number.is_empty() => return Err(shape(text, family)),
            None => parse_digits(text, number, 10)?,
        };
        let offset = family.host_offset(space, number).ok_or_else(|| pmac_outside(text, space, family))?;
        Ok(Self { space, offset })
    }

    /// Whether `text` is a host offset, which means the same word in every family.
    #[must_use]
    pub fn is_host_offset(text: &str) -> bool {
        host_digits(text.trim()).is_some()
    }

    /// The same place as a PMAC address.
    #[must_use]
    pub const fn pmac_address(self, family: &Family) -> PmacAddress {
        PmacAddress::new(self.space, family.pmac_number(self.offset))
    }
}

/// A hint for `text`, a wrong address whose number a shell may have removed: a shell turns `Y:$D001` without quotes
/// into `Y:`.
pub(super) fn quote_hint(text: &str) -> &'static str {
    if text.contains(':') && !text.contains('$') {
        "; the shell takes a $ and what follows for a variable: quote the address, as 'Y:$D001'"
    } else {
        ""
    }
}

/// The digits behind the `0x` of a host offset.
fn host_digits(text: &str) -> Option<&str> {
    text.strip_prefix("0x").or_else(|| text.strip_prefix("0X"))
}

fn host(text: &str, digits: &str, family: &Family) -> Result<TypedAddress, AddressError> {
    let bytes = parse_digits(text, digits, 16)?;
    let offset = HostOffset::checked(bytes).ok_or_else(|| AddressError::Odd { text: text.to_owned() })?;
    if bytes >= family.length {
        return Err(AddressError::Outside {
            text: text.to_owned(),
            family: family.title,
            first: HostOffset::new(0).to_string(),
            last: format!("0x{:04X}", family.length - 2),
        });
    }
    Ok(TypedAddress { space: family.half(offset), offset })
}

fn split_space(text: &str) -> Option<(Space, &str)> {
    Space::ALL.into_iter().find_map(|space| {
        let (letters, rest) = text.split_at_checked(space.name().len())?;
        letters.eq_ignore_ascii_case(space.name()).then_some((space, rest))
    })
}

fn shape(text: &str, family: &Family) -> AddressError {
    let places = [("Y", 1), ("X", 9), ("DP", 0x200), ("D", 0x14), ("L", 0x9A), ("F", 0x210)];
    let places =
        places.map(|(space, word)| format!("{space}:{}", family.print_number(family.base + word))).join(", ");
    AddressError::Shape { text: text.to_owned(), examples: format!("{places} or 0x0024") }
}

fn parse_digits(text: &str, digits: &str, radix: u32) -> Result<u32, AddressError> {
    // from_str_radix alone would take a sign.
    let plain = digits.chars().all(|digit| digit.is_digit(radix));
    let number = if plain { u32::from_str_radix(digits, radix).ok() } else { None };
    number.ok_or_else(|| AddressError::Digits {
        text: text.to_owned(),
        digits: digits.to_owned(),
        base: if radix == 16 { "hexadecimal" } else { "decimal" },
    })
}

fn pmac_outside(text: &str, space: Space, family: &Family) -> AddressError {
    // A 48-bit register takes two locations.
    let locations = space.words().div_ceil(2) as u32;
    AddressError::Outside {
        text: text.to_owned(),
        family: family.title,
        first: format!("{space}:{}", family.print_number(family.base)),
        last: format!("{space}:{}", family.print_number(family.base + family.length / 4 - locations)),
    }
}

#[cfg(test)]
mod tests {
    use super::super::{PMAC, TURBO2};
    use super::*;
    use proptest::prelude::*;

    fn parsed(text: &str) -> (Space, u32) {
        let location = TypedAddress::parse(text, &PMAC).unwrap_or_else(|error| panic!("{error}"));
        (location.space, location.offset.bytes())
    }

    fn refused(text: &str) -> String {
        TypedAddress::parse(text, &PMAC).unwrap_err().to_string()
    }

    #[test]
    fn every_shape_the_manual_prints_is_read() {
        assert_eq!(parsed("Y:$D001"), (Space::Y, 0x0004));
        assert_eq!(parsed("X:$D009"), (Space::X, 0x0026));
        assert_eq!(parsed("DP:$D200"), (Space::Dp, 0x0800));
        assert_eq!(parsed("D:$D014"), (Space::D, 0x0050));
        assert_eq!(parsed("L:$D09A"), (Space::L, 0x0268));
        assert_eq!(parsed("F:$D210"), (Space::F, 0x0840));
        assert_eq!(parsed("0x0024"), (Space::Y, 0x0024));
        assert_eq!(parsed("0X26"), (Space::X, 0x0026));
        assert_eq!(parsed(" dp:$dfff "), (Space::Dp, 0x3FFC));
        assert_eq!(parsed("x$d000"), (Space::X, 0x0002));
        assert_eq!(parsed("Y:53249"), (Space::Y, 0x0004));
    }

    #[test]
    fn what_is_wrong_is_said() {
        assert_eq!(refused("0x0025"), "host offset 0x0025 is odd; DPRAM words lie at even offsets");
        assert_eq!(refused("0x4000"), "0x4000 lies outside the DPRAM of a PMAC, which has 0x0000 to 0x3FFE");
        assert_eq!(
            refused("Y:$CFFF"),
            "Y:$CFFF lies outside the DPRAM of a PMAC, which has Y:$D000 to Y:$DFFF"
        );
        assert_eq!(
            refused("L:$DFFF"),
            "L:$DFFF lies outside the DPRAM of a PMAC, which has L:$D000 to L:$DFFE"
        );
        assert_eq!(refused("Y:$D0G1"), "\"D0G1\" in address \"Y:$D0G1\" is not a hexadecimal number");
        assert!(refused("Y:D001").starts_with("\"D001\" in address \"Y:D001\" is not a decimal number; "));
        // `Y:$D001` and `Y:$0770` as a shell hands them over.
        for taken in ["Y:", "Y:bash700", "Y:D001"] {
            assert!(
                refused(taken).ends_with("quote the address, as 'Y:$D001'"),
                "{taken}: {}",
                refused(taken)
            );
        }
        for word in ["foo", "yes", "dp", "X"] {
            assert!(refused(word).starts_with(&format!("{word:?} is not an address; write")), "{word}");
        }
        assert!(
            refused("foo")
                .ends_with("; write Y:$D001, X:$D009, DP:$D200, D:$D014, L:$D09A, F:$D210 or 0x0024")
        );
        let turbo = TypedAddress::parse("$060450", &TURBO2).unwrap_err().to_string();
        assert!(turbo.contains("write Y:$060001, X:$060009, DP:$060200"), "{turbo}");
        assert_eq!(refused("0x"), "\"\" in address \"0x\" is not a hexadecimal number");
        for text in ["", "$D001", "Z:$D001", "0024", "Y:", "Y", "é", "D"] {
            assert!(refused(text).contains("is not an address"), "{text}: {}", refused(text));
        }
    }

    proptest! {
        #[test]
        fn no_text_panics(text in "\\PC{0,12}") {
            let _ = TypedAddress::parse(&text, &PMAC);
        }

        #[test]
        fn a_printed_address_reads_back(space in 0usize..6, word in 0u32..0x0FFE) {
            let space = Space::ALL[space];
            let address = PmacAddress::new(space, PMAC.base + word);
            let location = TypedAddress::parse(&address.to_string(), &PMAC).unwrap();
            prop_assert_eq!(location.pmac_address(&PMAC), address);
        }
    }
}
