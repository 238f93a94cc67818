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
    fn anything_else_is_refused() {
        for text in ["", "$", "0x", "-1", "+1", "$-1", "7FA000", "0x1G", "$100000000", "1.0", "é"] {
            assert!(parse(text).is_err(), "{text}");
        }
    }
}
