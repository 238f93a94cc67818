//! A board's answer to a query of a variable, in any of the forms that I9 chooses.

/// The value in a line of a reply: `96`, `$60`, `I108=96` and `I108=$60` say the same.
#[must_use]
pub fn text(line: &str) -> &str {
    line.rsplit('=').next().unwrap_or(line).trim()
}

/// A number as a board writes it: decimal without exponent, or `$` and hexadecimal digits, a sign in front of either;
/// `None` for anything else.
#[must_use]
pub fn number(text: &str) -> Option<f64> {
    let (sign, plain) = text.strip_prefix('-').map_or((1.0, text), |rest| (-1.0, rest));
    let value = match plain.strip_prefix('$') {
        Some(digits) if digits.bytes().all(|byte| byte.is_ascii_hexdigit()) => {
            i64::from_str_radix(digits, 16).ok()? as f64
        }
        None if plain.bytes().all(|byte| byte.is_ascii_digit() || byte == b'.') => plain.parse().ok()?,
        _ => return None,
    };
    Some(sign * value)
}

/// The value in a line of a reply as a whole number; `None` for anything else.
#[must_use]
pub fn integer(line: &str) -> Option<i64> {
    number(text(line)).filter(|value| value.fract() == 0.0).map(|value| value as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_come_in_four_forms() {
        for line in ["96", "$60", "I108=96", "I108=$60", " 96 ", "96.0"] {
            assert_eq!(integer(line), Some(96), "{line}");
        }
        for line in [
            "", "0.5", "ERR", "$", "$GG", "$-60", "$+60", "--1", "1e3", "inf", "nan", ".", "-", "I108=",
            "hello",
        ] {
            assert_eq!(integer(line), None, "{line}");
        }
        assert_eq!((integer("-96"), integer("I108=-$60")), (Some(-96), Some(-96)));
        assert_eq!((number("-0.5"), number("I108=96")), (Some(-0.5), None));
        assert_eq!((text("I193=$820"), text("1.5")), ("$820", "1.5"));
    }
}
