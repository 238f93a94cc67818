//! What a board answers to a query of a variable, in any of the forms that I9 chooses.

/// The value in a line of a reply: `96`, `$60`, `I108=96` and `I108=$60` say the same.
#[must_use]
pub fn text(line: &str) -> &str {
    line.rsplit('=').next().unwrap_or(line).trim()
}

/// The value in a line of a reply as a whole number; `None` for anything else.
#[must_use]
pub fn integer(line: &str) -> Option<i64> {
    let text = text(line);
    match text.strip_prefix('$') {
        Some(digits) => i64::from_str_radix(digits, 16).ok(),
        None => text.parse::<f64>().ok().filter(|value| value.fract() == 0.0).map(|value| value as i64),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_come_in_four_forms() {
        for line in ["96", "$60", "I108=96", "I108=$60", " 96 ", "96.0"] {
            assert_eq!(integer(line), Some(96), "{line}");
        }
        for line in ["", "0.5", "ERR", "$", "$GG", "I108=", "hello"] {
            assert_eq!(integer(line), None, "{line}");
        }
        assert_eq!((text("I193=$820"), text("1.5")), ("$820", "1.5"));
    }
}
