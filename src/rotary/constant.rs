//! A constant as a program writes it: kept exactly, so that the compiler rounds it only once, into the format's
//! mantissa.

/// A decimal or hexadecimal constant: `units / 10^decimals`, with its sign.
///
/// Keeps up to 27 decimal places and 27 significant digits, more than any mantissa can resolve; of further digits only
/// whether any is not zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Constant {
    negative: bool,
    units: u128,
    decimals: u32,
    /// Non-zero digits follow beyond those kept.
    more: bool,
    /// The integer part has more digits than are kept, so `units` is too small.
    huge: bool,
}

/// The most decimal places: 36 bits of mantissa above 10^27 still fit in 128 bits.
const MOST_DECIMALS: u32 = 27;
/// Integer parts and fractions above this take no further digit.
const FULL: u128 = 10u128.pow(27);

impl Constant {
    /// Parses decimal `text` without a sign: digits with at most one decimal point.
    #[must_use]
    pub fn decimal(text: &[u8]) -> Self {
        let mut constant = Self::whole(0);
        let mut after_point = false;
        for &byte in text {
            let digit = u128::from(byte.wrapping_sub(b'0'));
            match (byte, after_point) {
                (b'.', _) => after_point = true,
                (_, false) if constant.units >= FULL => constant.huge = true,
                (_, true) if constant.units >= FULL || constant.decimals == MOST_DECIMALS => {
                    constant.more |= digit != 0;
                }
                _ => {
                    constant.units = constant.units * 10 + digit;
                    constant.decimals += u32::from(after_point);
                }
            }
        }
        while constant.decimals > 0 && constant.units.is_multiple_of(10) && !constant.more {
            constant.units /= 10;
            constant.decimals -= 1;
        }
        constant
    }

    /// An integer.
    #[must_use]
    pub const fn whole(value: u64) -> Self {
        Self { negative: false, units: value as u128, decimals: 0, more: false, huge: false }
    }

    /// The constant with the other sign.
    #[must_use]
    pub const fn negated(self) -> Self {
        Self { negative: !self.negative, ..self }
    }

    /// The nearest `f64`: exact enough to compare with the bounds of a range.
    #[must_use]
    pub fn value(&self) -> f64 {
        let magnitude =
            if self.huge { f64::INFINITY } else { self.units as f64 / 10f64.powi(self.decimals as i32) };
        if self.negative { -magnitude } else { magnitude }
    }

    /// The value, if it is an integer from 0 to `u64::MAX`.
    #[must_use]
    pub fn integer(&self) -> Option<u64> {
        if self.decimals > 0 || self.more || self.huge || (self.negative && self.units > 0) {
            return None;
        }
        u64::try_from(self.units).ok()
    }

    /// Its magnitude as numerator and denominator, and whether it is slightly more than that. `None` when the integer
    /// part has more than 27 digits.
    pub(super) fn fraction(&self) -> Option<(u128, u128, bool)> {
        (!self.huge).then(|| (self.units, 10u128.pow(self.decimals), self.more))
    }

    /// Whether it has a minus sign. Zero may have one.
    #[must_use]
    pub const fn is_negative(&self) -> bool {
        self.negative
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_spellings_of_a_number_are_one_number() {
        for text in ["5", "05", "5.", "5.0", "5.000000000000000000000000000000000000000", "0000000005.00"] {
            assert_eq!(Constant::decimal(text.as_bytes()), Constant::whole(5), "{text}");
        }
        assert_eq!(Constant::decimal(b".5"), Constant::decimal(b"0.50"));
        assert_eq!(Constant::decimal(b"0.0"), Constant::whole(0));
        assert_eq!(Constant::decimal(b"."), Constant::whole(0));
    }

    #[test]
    fn only_whole_numbers_are_integers() {
        assert_eq!(Constant::decimal(b"1023.0").integer(), Some(1023));
        assert_eq!(Constant::decimal(b"1.5").integer(), None);
        assert_eq!(Constant::whole(1).negated().integer(), None);
        assert_eq!(Constant::whole(0).negated().integer(), Some(0));
        let tiny = format!("1.{}1", "0".repeat(60));
        assert_eq!(Constant::decimal(tiny.as_bytes()).integer(), None);
        assert_eq!(Constant::decimal("9".repeat(60).as_bytes()).integer(), None);
        assert_eq!(Constant::decimal("9".repeat(60).as_bytes()).value(), f64::INFINITY);
    }

    proptest! {
        #[test]
        fn the_value_is_what_the_text_says(text in r"[0-9]{0,25}(\.[0-9]{0,40})?") {
            let number: f64 = format!("0{text}").parse().unwrap();
            let value = Constant::decimal(text.as_bytes()).value();
            prop_assert!((value - number).abs() <= number.abs() * 1e-14 + 1e-26, "{text}: {value} {number}");
        }
    }
}
