//! Numbers as people read them: only the digits that carry meaning.

use crate::decode::Quantity;

/// Stands for an unknown value, or a word that the daemon does not read from the board.
pub const NOT_READ: &str = "-";

/// Digits of PMAC's 48-bit float: its mantissa has 36 bits.
const DIGITS: usize = 11;
/// Numbers of more places than this, before or behind the point, are written with an exponent.
const PLACES: std::ops::Range<i32> = -6..16;

/// A position: in counts if the scale is known, else the raw integer with a mark: `9710688raw` is no count.
pub fn labelled(quantity: Option<Quantity>) -> String {
    let Some(Quantity { raw, value, .. }) = quantity else { return NOT_READ.to_owned() };
    value.map_or_else(|| format!("{raw}raw"), |value| fixed(value, 1))
}

/// The value with `places` decimal places, without a sign if it rounds to zero.
pub fn fixed(value: f64, places: usize) -> String {
    if value.abs() >= 1e15 {
        return short(value);
    }
    let text = format!("{value:.places$}");
    match text.strip_prefix('-') {
        Some(zero) if zero.bytes().all(|byte| matches!(byte, b'0' | b'.')) => zero.to_owned(),
        _ => text,
    }
}

/// A number that PMAC keeps in 48 bits: 12.3, and not 12.299999999813735, the exact value of its 36 bits of mantissa.
pub fn short(value: f64) -> String {
    digits(value, DIGITS)
}

/// A number that PMAC keeps as a float of 32 bits.
pub fn float32(value: f64) -> String {
    let single = value as f32;
    if (1e-6..1e16).contains(&single.abs()) || single == 0.0 {
        (single + 0.0).to_string()
    } else {
        format!("{single:e}")
    }
}

/// The number with so many digits, without zeros at its end; very large and very small numbers with an exponent.
pub fn digits(value: f64, digits: usize) -> String {
    if value == 0.0 || !value.is_finite() {
        return if value == 0.0 { "0".to_owned() } else { value.to_string() };
    }
    let rounded = format!("{value:.*e}", digits.saturating_sub(1));
    let exponent = rounded.split_once('e').and_then(|(_, exponent)| exponent.parse().ok()).unwrap_or(0);
    let number: f64 = rounded.parse().unwrap_or(value);
    if PLACES.contains(&exponent) { number.to_string() } else { format!("{number:e}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_has_no_sign_and_raw_numbers_say_so() {
        let quantity = |raw, value| Some(Quantity { raw, value, unit: "" });
        for (value, text) in [(-0.04, "0.0"), (-0.0, "0.0"), (-0.06, "-0.1"), (-10.0, "-10.0"), (0.04, "0.0")]
        {
            assert_eq!(labelled(quantity(-1, Some(value))), text);
        }
        assert_eq!((labelled(quantity(-7, None)).as_str(), labelled(None).as_str()), ("-7raw", NOT_READ));
        assert_eq!(fixed(-1e300, 1), "-1e300");
    }

    #[test]
    fn numbers_have_the_digits_that_mean_something() {
        for (value, text) in [
            (12.299_999_999_813_735, "12.3"),
            (-0.1 - 0.2, "-0.3"),
            (0.0, "0"),
            (-0.0, "0"),
            (1e300, "1e300"),
            (-3.25e-200, "-3.25e-200"),
            (34_359_738_367.0, "34359738367"),
            (0.000_012_5, "0.0000125"),
            (f64::NAN, "NaN"),
            (f64::INFINITY, "inf"),
        ] {
            assert_eq!(short(value), text);
        }
        let single = |value: f32| float32(value.into());
        assert_eq!(single(0.1), "0.1");
        assert_eq!(single(-16_777_215.0), "-16777215");
        assert_eq!((single(3e38), single(-0.0)), ("3e38".to_owned(), "0".to_owned()));
    }
}
