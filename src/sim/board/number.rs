//! Numbers as PMAC prints them: decimal, no exponent, no `+`, no trailing zeros (Software Reference examples).
//!
//! A variable is a 48-bit float with a 36-bit mantissa, so PMAC prints the fewest digits that read back as the same
//! register: a host that typed 98.7 reads 98.7. At most 11 digits are significant, and a family prints a limited number
//! after the point: 9 on PMAC (`-0.333333333`, `6.666666667`), 10 on Turbo (`0.9998474121`). The rule fits the values
//! seen in manuals and listings; no manual states it.

use crate::format::float48;

/// Significant digits a number is printed with at most.
const SIGNIFICANT: usize = 11;

/// `value` as a 48-bit floating-point register keeps it; an infinity becomes the largest value, NaN 0.
///
/// The register has a wider range than the arithmetic here, which ends at 2^1024.
#[must_use]
pub fn quantised(value: f64) -> f64 {
    let [y, x] = float48::encode(value);
    float48::decode(y, x).clamp(f64::MIN, f64::MAX)
}

/// `value` as a reply shows it, with at most `decimals` digits after the point.
#[must_use]
pub fn decimal(value: f64, decimals: usize) -> String {
    if !value.is_finite() {
        return decimal(quantised(value), decimals);
    }
    let whole_digits = if value.abs() < 1.0 { 0 } else { value.abs().log10() as usize + 1 };
    let most = decimals.min(SIGNIFICANT.saturating_sub(whole_digits));
    let register = quantised(value);
    for places in 0..most {
        let text = trimmed(value, places);
        if text.parse().is_ok_and(|read: f64| quantised(read) == register) {
            return text;
        }
    }
    trimmed(value, most)
}

/// How finely a family reports positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Resolution {
    /// To the nearest tenth of a count.
    Tenths,
    /// To the nearest 1/32 of a count (Turbo Software Reference p. 260; `-5797.53125` is seen).
    ThirtySeconds,
}

impl Resolution {
    /// `counts` as `P` reports them.
    #[must_use]
    pub fn text(self, counts: f64) -> String {
        match self {
            Self::ThirtySeconds if counts.is_finite() => trimmed((counts * 32.0).round() / 32.0, 5),
            _ => tenths(counts),
        }
    }
}

/// `value` to the nearest tenth: velocities, following errors.
#[must_use]
pub fn tenths(value: f64) -> String {
    trimmed(if value.is_finite() { value } else { quantised(value) }, 1)
}

fn trimmed(value: f64, places: usize) -> String {
    let mut text = format!("{value:.places$}");
    if text.contains('.') {
        text.truncate(text.trim_end_matches('0').trim_end_matches('.').len());
    }
    if text == "-0" {
        text.remove(0);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_seen_in_manuals_and_listings() {
        for (value, decimals, text) in [
            (f64::from((1 << 23) - 1) / 3_713_707.0 * 100.0, 9, "225.88230574"),
            (-1.0 / 3.0, 9, "-0.333333333"),
            (-0.333_333_333, 9, "-0.333333333"),
            (20.0 / 3.0, 9, "6.666666667"),
            (65526.0 / 65536.0, 10, "0.9998474121"),
            (0.015_625, 9, "0.015625"),
            (5.75, 9, "5.75"),
            (-3.4578, 9, "-3.4578"),
            (98.5, 9, "98.5"),
        ] {
            assert_eq!(decimal(value, decimals), text);
            assert_eq!(decimal(quantised(value), decimals), text, "from its register");
        }
    }

    #[test]
    fn what_was_typed_comes_back() {
        for text in
            ["98.7", "3333.333", "-666.667", "4.2", "100000", "8388607.5", "0.1", "16777215", "34359738367"]
        {
            let value = quantised(text.parse().unwrap());
            assert_eq!(decimal(value, 9), text);
        }
    }

    #[test]
    fn no_sign_on_zero_and_no_exponent() {
        assert_eq!(decimal(-0.0, 9), "0");
        assert_eq!(decimal(-1e-13, 9), "0");
        assert_eq!(decimal(1e15, 9), "1000000000000000");
        assert_eq!(decimal(f64::NAN, 9), "0");
        assert!(decimal(f64::INFINITY, 9).len() > 300, "printed in full");
    }

    #[test]
    fn tenths_of_a_count() {
        for (value, text) in [(1995.0, "1995"), (-0.5, "-0.5"), (21.94, "21.9"), (-0.04, "0"), (-4.2, "-4.2")]
        {
            assert_eq!(tenths(value), text);
        }
    }
}
