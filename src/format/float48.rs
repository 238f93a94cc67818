//! `L:` registers, 48-bit floating point.
//!
//! The exponent is in Y bits 11-0 (bias 2047), the low 12 mantissa bits in Y bits 23-12, the high 24 in the X word;
//! the mantissa is two's complement with weight -2^0 for its sign bit. value = (X*4096 + Y>>12) * 2^(exponent-2082).
//! The DPRAM manual's own paragraph (p. 11) prints another layout, which contradicts the register table of the User
//! Manual and every value seen; it is kept as [`Float48Layout::Printed`] for whoever needs to compare.

use super::int24;

const BIAS: i32 = 2047;
const MANTISSA_BITS: i32 = 35;

/// Which reading of a 48-bit floating-point register is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Float48Layout {
    /// Exponent in Y bits 11-0; what boards do.
    #[default]
    Register,
    /// The DPRAM manual's paragraph on p. 11: mantissa = Y + X bits 11-0, exponent = X bits 23-12.
    Printed,
}

impl Float48Layout {
    /// Decodes a floating-point register from its two DPRAM long words, Y half (low address) first.
    ///
    /// Un-normalised mantissas decode to the value they stand for.
    #[must_use]
    pub fn decode(self, y: u32, x: u32) -> f64 {
        match self {
            Self::Register => {
                let mantissa = i64::from(int24::signed(x)) << 12 | i64::from(int24::unsigned(y) >> 12);
                let exponent = (y & 0xFFF) as i32;
                scale(mantissa, exponent - BIAS - MANTISSA_BITS)
            }
            Self::Printed => {
                let mantissa = i64::from(x & 0xFFF) << 24 | i64::from(int24::unsigned(y));
                // 36-bit two's complement, like the register layout's mantissa.
                let mantissa = mantissa << 28 >> 28;
                let exponent = (x >> 12 & 0xFFF) as i32;
                scale(mantissa, exponent - BIAS - MANTISSA_BITS)
            }
        }
    }
}

/// Decodes with the register layout. See [`Float48Layout::decode`].
#[must_use]
pub fn decode(y: u32, x: u32) -> f64 {
    Float48Layout::Register.decode(y, x)
}

/// Encodes `value` in the register layout as two sign-extended DPRAM long words, Y half first.
///
/// The mantissa is rounded to nearest; a value too large saturates, one too small (and NaN) becomes zero.
#[must_use]
pub fn encode(value: f64) -> [u32; 2] {
    if value == 0.0 || value.is_nan() {
        return [0, 0];
    }
    if value.is_infinite() {
        return encode(f64::MAX.copysign(value));
    }
    // value = fraction * 2^exponent with 0.5 <= |fraction| < 1
    let mut exponent = binary_exponent(value);
    let mut mantissa = scale_to_integer(value, MANTISSA_BITS - exponent);
    // Normalise two's complement: 2^34 <= m < 2^35, or -2^35 <= m < -2^34. Rounding may have carried.
    if mantissa >= 1 << 35 {
        mantissa >>= 1;
        exponent += 1;
    }
    while (-(1 << 34)..0).contains(&mantissa) {
        exponent -= 1;
        mantissa = scale_to_integer(value, MANTISSA_BITS - exponent);
    }
    let biased = exponent + BIAS;
    if biased < 0 {
        return [0, 0];
    }
    let (mantissa, biased) = if biased > 0xFFF {
        (if value > 0.0 { (1i64 << 35) - 1 } else { -(1i64 << 35) }, 0xFFF)
    } else {
        (mantissa, biased)
    };
    let x = (mantissa >> 12) as u32 & int24::MASK;
    let y = ((mantissa & 0xFFF) as u32) << 12 | biased as u32;
    [int24::extend(y), int24::extend(x)]
}

/// The exponent `e` with `|value| = f * 2^e`, `0.5 <= f < 1`. `value` is finite and not zero.
fn binary_exponent(value: f64) -> i32 {
    let bits = (value.to_bits() >> 52 & 0x7FF) as i32;
    if bits == 0 { binary_exponent(value * 2f64.powi(54)) - 54 } else { bits - 1022 }
}

/// `value * 2^shift`, rounded to nearest. The caller sees to it that the result has at most 36 bits.
fn scale_to_integer(value: f64, shift: i32) -> i64 {
    // Two steps: a single factor could leave the range of f64 though the result does not.
    let half = shift / 2;
    (value * 2f64.powi(half) * 2f64.powi(shift - half)).round_ties_even() as i64
}

/// `mantissa * 2^exponent` without an intermediate overflow.
fn scale(mantissa: i64, exponent: i32) -> f64 {
    let half = exponent / 2;
    mantissa as f64 * 2f64.powi(half) * 2f64.powi(exponent - half)
}
