//! Numbers as people type them for PMAC: `$7FA000` as its manuals write them, `0x7FA000`, or decimal.

/// Text that is no number.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{text:?} is not a number; write $7FA000, 0x7FA000 or decimal digits")]
pub struct BadNumber {
    /// The text.
    pub text: String,
}

/// Reads a number without sign, of at most 32 bits.
///
/// # Errors
/// [`BadNumber`] for anything else, a sign included.
pub fn parse(text: &str) -> Result<u32, BadNumber> {
    let bad = || BadNumber { text: text.to_owned() };
    let trimmed = text.trim();
    let hex = trimmed
        .strip_prefix('$')
        .or_else(|| trimmed.strip_prefix("0x"))
        .or_else(|| trimmed.strip_prefix("0X"));
    let (digits, radix) = hex.map_or((trimmed, 10), |digits| (digits, 16));
    // from_str_radix alone would take a sign.
    if !digits.chars().all(|digit| digit.is_digit(radix)) {
        return Err(bad());
    }
    u32::from_str_radix(digits, radix).map_err(|_| bad())
}

/// How far the number in a listing may lie from the set number: boards list nine or ten decimals, of at most eleven
/// digits.
const LISTED_WITHIN: f64 = 6e-10;
const LISTED_SHARE: f64 = 1e-10;

/// Whether a board that was set to one number may list the other. A board lists whole numbers unchanged.
#[must_use]
pub fn same_when_listed(one: f64, other: f64) -> bool {
    let is_whole = one.fract() == 0.0 && other.fract() == 0.0;
    let within = if is_whole { 0.0 } else { LISTED_WITHIN.max(LISTED_SHARE * one.abs()) };
    (one - other).abs() <= within
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_three_shapes() {
        assert_eq!(parse("$7FA000"), Ok(0x7F_A000));
        assert_eq!(parse("0x7fa000"), Ok(0x7F_A000));
        assert_eq!(parse(" 0XFF "), Ok(255));
        assert_eq!(parse("24"), Ok(24));
        assert_eq!(parse("$FFFFFFFF"), Ok(u32::MAX));
    }

    #[test]
    fn a_listing_has_fewer_digits_than_a_file() {
        for (given, listed) in
            [(0.333_333_333_333, 0.333_333_333), (-0.0, 0.0), (123_456.789_012_3, 123_456.789_01)]
        {
            assert!(same_when_listed(given, listed), "{given}");
        }
        for (given, listed) in
            [(0.5, 0.500_000_01), (8_388_607.0, 8_388_608.0), (1.0, -1.0), (f64::NAN, f64::NAN)]
        {
            assert!(!same_when_listed(given, listed), "{given}");
        }
    }

    #[test]
    fn anything_else_is_refused() {
        for text in ["", "$", "0x", "-1", "+1", "$-1", "7FA000", "0x1G", "$100000000", "1.0", "é"] {
            assert!(parse(text).is_err(), "{text}");
        }
    }
}
