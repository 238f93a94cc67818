//! The floating-point numbers of binary rotary commands.
//!
//! A two's complement mantissa with weight -2^0 for its sign bit, as in PMAC's 48-bit format, and a 6-bit exponent:
//! value = mantissa * 2^(exponent - bias). Letters and CALL have 36 bits of mantissa (word 2 above word 1 bits 23-12),
//! everything else 24 bits (word 2). Numbers are normalised: 0.5 <= m < 1 or -1 <= m < -0.5. No document prints the
//! bias, so it is a setting: [`Settings::exponent_bias`](super::Settings).

use super::{Constant, Settings};

/// The width of a command's mantissa.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Width {
    /// 36 bits: letters and CALL.
    Long,
    /// 24 bits: times, `:`, `^`, CCR and variable assignments.
    Short,
}

impl Width {
    /// Bits below the sign.
    #[must_use]
    pub const fn magnitude_bits(self) -> i32 {
        match self {
            Self::Long => 35,
            Self::Short => 23,
        }
    }
}

/// A number in a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Float {
    /// The mantissa, signed, in units of 2^-35 or 2^-23.
    pub mantissa: i64,
    /// The exponent field, 0 to 63.
    pub exponent: u8,
    /// The width of the mantissa.
    pub width: Width,
}

/// The loss by rounding a constant to a [`Float`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Loss {
    /// No written digit: rounded to the decimal places of the text, the number is the same.
    None,
    /// Some of the digits written.
    Digits,
    /// All of it: the constant is nearer to zero than the smallest number, and becomes zero.
    Vanished,
}

/// A constant that needs an exponent above the largest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("float too large: a rotary command holds numbers below 2^{exponent}")]
pub struct TooLarge {
    /// Every number is below this power of two.
    pub exponent: i32,
}

/// Largest value of the exponent field.
const MOST_EXPONENT: i32 = 63;

impl Float {
    /// Zero.
    #[must_use]
    pub const fn zero(width: Width, settings: &Settings) -> Self {
        Self { mantissa: 0, exponent: settings.zero_exponent, width }
    }

    /// Rounds `constant` once, to nearest, ties to even, and returns the loss.
    ///
    /// # Errors
    /// When its exponent does not fit in 6 bits.
    pub fn encode(constant: &Constant, width: Width, settings: &Settings) -> Result<(Self, Loss), TooLarge> {
        let bias = i32::from(settings.exponent_bias);
        let too_large = TooLarge { exponent: MOST_EXPONENT - bias };
        let (over, under, more) = constant.fraction().ok_or(too_large)?;
        if over == 0 {
            return Ok((Self::zero(width, settings), if more { Loss::Vanished } else { Loss::None }));
        }
        let bits = width.magnitude_bits();
        let mut exponent = binary_exponent(over, under);
        // over / under = (numerator / denominator) * 2^(exponent - bits), with a quotient of `bits` bits. Neither shift
        // overflows: `under` has at most 90 bits, and `over` at most as many as the quotient needs.
        let shift = bits - exponent;
        let (numerator, denominator) =
            if shift >= 0 { (over << shift, under) } else { (over, under << -shift) };
        let (mut mantissa, rest) = (numerator / denominator, numerator % denominator);
        let error = rest.min(denominator - rest);
        let exact = rest == 0 && !more;
        let up = match (2 * rest).cmp(&denominator) {
            std::cmp::Ordering::Less => false,
            std::cmp::Ordering::Equal => more || mantissa % 2 == 1,
            std::cmp::Ordering::Greater => true,
        };
        mantissa += u128::from(up);
        // In units of the last decimal place written.
        let lost = error as f64 / denominator as f64 * f64::powi(2.0, exponent - bits) * under as f64;
        let loss = if exact || lost < 0.5 { Loss::None } else { Loss::Digits };
        // At powers of two the signs differ: +2^e is 0.5 * 2^(e+1), -2^e is -1 * 2^e.
        let (one, half) = (1i64 << bits, 1i64 << (bits - 1));
        let mut mantissa = mantissa as i64;
        if constant.is_negative() {
            mantissa = -mantissa;
            if mantissa == -half {
                (mantissa, exponent) = (-one, exponent - 1);
            }
        } else if mantissa == one {
            (mantissa, exponent) = (half, exponent + 1);
        }
        match exponent + bias {
            field @ 0..=MOST_EXPONENT => Ok((Self { mantissa, exponent: field as u8, width }, loss)),
            ..0 => Ok((Self::zero(width, settings), Loss::Vanished)),
            _ => Err(too_large),
        }
    }

    /// Its exact value, whether normalised or not.
    #[must_use]
    pub fn value(&self, settings: &Settings) -> f64 {
        let exponent =
            i32::from(self.exponent) - i32::from(settings.exponent_bias) - self.width.magnitude_bits();
        self.mantissa as f64 * f64::powi(2.0, exponent)
    }

    /// The shortest decimal that encodes to this number; if 17 digits are not enough, its exact value.
    #[must_use]
    pub fn text(&self, settings: &Settings) -> String {
        let value = self.value(settings);
        let shortest = (0..17).map(|digits| plain(value, digits)).find(|text| {
            let magnitude = Constant::decimal(text.trim_start_matches('-').as_bytes());
            let constant = if value < 0.0 { magnitude.negated() } else { magnitude };
            Self::encode(&constant, self.width, settings)
                .is_ok_and(|(float, _)| float.value(settings) == value)
        });
        // Display of f64 has no exponent, and enough digits to identify the number.
        shortest.unwrap_or_else(|| format!("{value}"))
    }
}

/// The exponent `e` with `2^(e-1) <= over / under < 2^e`. Neither is zero.
fn binary_exponent(over: u128, under: u128) -> i32 {
    let length = |number: u128| 128 - number.leading_zeros() as i32;
    let difference = length(over) - length(under);
    let below = if difference >= 0 { over < under << difference } else { over << -difference < under };
    if below { difference } else { difference + 1 }
}

/// `value` with one digit before and `digits` after the point of its scientific form, but written without an exponent.
fn plain(value: f64, digits: usize) -> String {
    // Rust rounds the decimal expansion exactly. Parsing it and printing it without exponent keeps those digits, since
    // 17 digits identify every f64.
    let scientific = format!("{value:.digits$e}");
    let Some((digits, exponent)) = scientific.split_once('e') else { return scientific };
    let exponent: i32 = exponent.parse().unwrap_or(0);
    let (sign, digits) = digits.strip_prefix('-').map_or(("", digits), |rest| ("-", rest));
    let digits: String = digits.chars().filter(|&c| c != '.').collect();
    let point = exponent + 1;
    let (whole, fraction) = if point <= 0 {
        ("0".to_owned(), format!("{}{digits}", "0".repeat(point.unsigned_abs() as usize)))
    } else {
        let point = point as usize;
        let padded = format!("{digits:0<point$}");
        let (whole, fraction) = padded.split_at(point);
        (whole.to_owned(), fraction.to_owned())
    };
    match fraction.trim_end_matches('0') {
        "" => format!("{sign}{whole}"),
        fraction => format!("{sign}{whole}.{fraction}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn constant(text: &str) -> Constant {
        let magnitude = Constant::decimal(text.trim_start_matches('-').as_bytes());
        if text.starts_with('-') { magnitude.negated() } else { magnitude }
    }

    fn encode(text: &str, width: Width) -> (i64, u8, Loss) {
        let (float, loss) = Float::encode(&constant(text), width, &Settings::default()).unwrap();
        (float.mantissa, float.exponent, loss)
    }

    #[test]
    fn powers_of_two_have_two_normal_forms_by_sign() {
        assert_eq!(encode("1", Width::Short), (0x40_0000, 32, Loss::None));
        assert_eq!(encode("-1", Width::Short), (-0x80_0000, 31, Loss::None));
        assert_eq!(encode("-0.5", Width::Short), (-0x80_0000, 30, Loss::None));
        assert_eq!(encode("0", Width::Long), (0, 0, Loss::None));
        assert_eq!(encode("-0", Width::Long), (0, 0, Loss::None));
    }

    #[test]
    fn the_range_ends_where_six_bits_end() {
        assert_eq!(encode("4294967295", Width::Long), (0xFFFF_FFFF << 3, 63, Loss::None));
        assert_eq!(encode("-4294967296", Width::Long), (-(1 << 35), 63, Loss::None));
        let largest = |text: &str, width| Float::encode(&constant(text), width, &Settings::default());
        for text in ["4294967296", "-4294967296.5", "99999999999999999999999999999999999", "281474976710655"]
        {
            assert_eq!(largest(text, Width::Long).unwrap_err().exponent, 32, "{text}");
        }
        // Rounding carries into the first number that does not fit.
        assert!(largest("4294967295.9999999", Width::Long).is_err());
        assert!(largest("4294967295", Width::Short).is_err());
        // 2^-32 is the smallest; below it, and at its negative, there is only zero.
        assert_eq!(encode("0.00000000023283064365386962890625", Width::Long).1, 0);
        assert_eq!(encode("0.0000000002", Width::Long), (0, 0, Loss::Vanished));
        assert_eq!(encode(&format!("0.{}1", "0".repeat(200)), Width::Long), (0, 0, Loss::Vanished));
    }

    #[test]
    fn rounding_is_to_nearest_even_and_happens_once() {
        // Above 2^24 a mantissa of 24 bits counts in steps of 4.
        assert_eq!(encode("16777218", Width::Short), (0x40_0000, 56, Loss::Digits));
        assert_eq!(encode("16777219", Width::Short), (0x40_0001, 56, Loss::Digits));
        assert_eq!(encode("16777222", Width::Short), (0x40_0002, 56, Loss::Digits));
        assert_eq!(encode("-16777218", Width::Short), (-0x80_0000, 55, Loss::Digits));
        // Above the tie by less than an f64 could tell.
        assert_eq!(encode("16777218.00000000000000001", Width::Short).0, 0x40_0001);
        assert_eq!(encode(&format!("16777218.{}1", "0".repeat(80)), Width::Short).0, 0x40_0001);
        assert_eq!(encode("16777216", Width::Short).2, Loss::None);
    }

    #[test]
    fn only_digits_that_were_written_can_be_lost() {
        for text in ["0.1", "68.93", "-0.01", "0.1000000000000", "123456.7", "8388608", "1234567"] {
            assert_eq!(encode(text, Width::Short).2, Loss::None, "{text}");
        }
        for text in ["0.333333333", "123456789", "100000.001", "8388609", "3.14159265358979"] {
            assert_eq!(encode(text, Width::Short).2, Loss::Digits, "{text}");
        }
    }

    #[test]
    fn the_bias_moves_the_exponent_alone() {
        for exponent_bias in [0, 30, 32, 63] {
            let settings = Settings { exponent_bias, ..Settings::default() };
            let (float, _) = Float::encode(&constant("0.75"), Width::Long, &settings).unwrap();
            assert_eq!((float.mantissa, float.exponent), (3 << 33, exponent_bias));
            assert_eq!(float.value(&settings), 0.75);
        }
    }

    #[test]
    fn text_is_the_shortest_that_comes_back() {
        for text in ["20.15", "-3.25", "0.0000001", "4294967295", "0", "737.2", "1023", "-0.866", "99.999"] {
            let (float, _) = Float::encode(&constant(text), Width::Long, &Settings::default()).unwrap();
            assert_eq!(float.text(&Settings::default()), text);
        }
        let not_normal = Float { mantissa: 1, exponent: 0, width: Width::Short };
        let text = not_normal.text(&Settings::default());
        assert_eq!(text.parse::<f64>().unwrap(), f64::powi(2.0, -54));
    }

    proptest! {
        #[test]
        fn normal_numbers_survive_their_text(
            fraction in any::<u64>(), negative in any::<bool>(), exponent in 0u8..64, long in any::<bool>(),
        ) {
            let width = if long { Width::Long } else { Width::Short };
            let half = 1 << (width.magnitude_bits() - 1);
            let fraction = fraction as i64 & (half - 1);
            let mantissa = if negative { -half - 1 - fraction } else { half + fraction };
            let float = Float { mantissa, exponent, width };
            let settings = Settings::default();
            let text = float.text(&settings);
            prop_assert_eq!(Float::encode(&constant(&text), width, &settings).unwrap().0, float, "{}", text);
        }

        #[test]
        fn the_error_is_half_a_unit_at_most(text in r"-?[0-9]{1,9}\.[0-9]{0,30}", long in any::<bool>()) {
            let width = if long { Width::Long } else { Width::Short };
            let number: f64 = text.parse().unwrap();
            let settings = Settings::default();
            let (float, loss) = Float::encode(&constant(&text), width, &settings).unwrap();
            prop_assume!(loss != Loss::Vanished);
            let error = (float.value(&settings) - number).abs();
            let bound = f64::powi(2.0, -width.magnitude_bits()) * (1.0 + 1e-4);
            prop_assert!(error <= number.abs() * bound, "{text}: {error:e}");
        }
    }
}
