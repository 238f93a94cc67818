//! `L:` registers, 48-bit floating point.
//!
//! The exponent is in Y bits 11-0 (bias 2047), the low 12 mantissa bits in Y bits 23-12, the high 24 in the X word;
//! the mantissa is two's complement with weight -2^0 for its sign bit. value = (X*4096 + Y>>12) * 2^(exponent-2082).
//! The DPRAM manual's own paragraph (p. 11) prints another layout, which contradicts the register table of the User
//! Manual and every value seen on boards. It is available for comparison as [`Float48Layout::Printed`].

use super::int24;

const BIAS: i32 = 2047;
const MANTISSA_BITS: i32 = 35;

/// How to read the bits of a 48-bit floating-point register.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Float48Layout {
    /// Exponent in Y bits 11-0, as boards store it.
    #[default]
    Register,
    /// The DPRAM manual's paragraph on p. 11: mantissa = Y bits 23-0 below X bits 11-0, exponent = X bits 23-12. It
    /// gives neither sign nor bias; both are taken from [`Float48Layout::Register`].
    Printed,
}

impl Float48Layout {
    /// Decodes a floating-point register from its two DPRAM long words, Y half (low address) first.
    ///
    /// Decodes mantissas that are not normalised, too.
    #[must_use]
    pub fn decode(self, y: u32, x: u32) -> f64 {
        match self {
            Self::Register => {
                let mantissa = i64::from(int24::signed(x)) << 12 | i64::from(int24::unsigned(y) >> 12);
                let exponent = (y & 0xFFF) as i32;
                scale(mantissa as f64, exponent - BIAS - MANTISSA_BITS)
            }
            Self::Printed => {
                let mantissa = i64::from(x & 0xFFF) << 24 | i64::from(int24::unsigned(y));
                // 36-bit two's complement, like the register layout's mantissa.
                let mantissa = mantissa << 28 >> 28;
                let exponent = (x >> 12 & 0xFFF) as i32;
                scale(mantissa as f64, exponent - BIAS - MANTISSA_BITS)
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
/// Rounds the mantissa to nearest, ties to even. The format holds every finite `f64`; an infinity becomes its largest
/// or smallest value, NaN becomes zero.
#[must_use]
pub fn encode(value: f64) -> [u32; 2] {
    if value == 0.0 || value.is_nan() {
        return [0, 0];
    }
    if value.is_infinite() {
        let mantissa = if value > 0.0 { (1 << MANTISSA_BITS) - 1 } else { -(1 << MANTISSA_BITS) };
        return registers(mantissa, 0xFFF);
    }
    // value = fraction * 2^exponent with 0.5 <= |fraction| < 1
    let exponent = binary_exponent(value);
    let mantissa = scale(value, MANTISSA_BITS - exponent).round_ties_even() as i64;
    let (mantissa, exponent) = match mantissa {
        // Rounding carried into the sign bit.
        HALF_CARRIED => (HALF, exponent + 1),
        // Normalised, -0.5 is -1 with the next lower exponent.
        MINUS_HALF => (-(1 << MANTISSA_BITS), exponent - 1),
        mantissa => (mantissa, exponent),
    };
    registers(mantissa, (exponent + BIAS) as u32)
}

const HALF: i64 = 1 << (MANTISSA_BITS - 1);
const HALF_CARRIED: i64 = 1 << MANTISSA_BITS;
const MINUS_HALF: i64 = -HALF;

/// The two long words of a 36-bit mantissa and a 12-bit biased exponent.
const fn registers(mantissa: i64, biased: u32) -> [u32; 2] {
    let x = (mantissa >> 12) as u32;
    let y = (mantissa as u32 & 0xFFF) << 12 | biased;
    [int24::extend(y), int24::extend(x)]
}

/// The exponent `e` with `|value| = f * 2^e`, `0.5 <= f < 1`. `value` is finite and not zero.
fn binary_exponent(value: f64) -> i32 {
    let bits = (value.to_bits() >> 52 & 0x7FF) as i32;
    if bits == 0 { binary_exponent(value * power_of_two(54)) - 54 } else { bits - 1022 }
}

/// `value * 2^exponent`; exact as long as the result is a normal number.
fn scale(value: f64, exponent: i32) -> f64 {
    // In two steps: the whole factor may exceed the range of f64 though the result does not.
    let half = exponent / 2;
    value * power_of_two(half) * power_of_two(exponent - half)
}

/// 2^`exponent`, clamped to the normal numbers. Beyond them, multiplying by it twice gives 0 or infinity in any case.
const fn power_of_two(exponent: i32) -> f64 {
    let clamped = if exponent < -1022 {
        -1022
    } else if exponent > 1023 {
        1023
    } else {
        exponent
    };
    f64::from_bits(((clamped + 1023) as u64) << 52)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn normalised(mantissa: i64) -> bool {
        (HALF..HALF_CARRIED).contains(&mantissa) || (-HALF_CARRIED..-HALF).contains(&mantissa)
    }

    #[test]
    fn powers_of_two_are_exact_at_every_exponent_f64_has() {
        for exponent in -1022..=1023 {
            for sign in [1.0, -1.0] {
                let value = sign * power_of_two(exponent);
                let [y, x] = encode(value);
                assert_eq!(decode(y, x), value);
                // -2^e is mantissa -1, 2^e is mantissa 0.5.
                assert_eq!(x, if sign > 0.0 { 0x0040_0000 } else { 0xFF80_0000 });
            }
        }
    }

    #[test]
    fn the_neighbours_of_minus_one_keep_their_sign() {
        // Values that round to -1 from below and above, where the mantissa's sign bit changes its role.
        for steps in -64..=64i32 {
            for unit in [33, 34, 35, 36, 37, 40, 52] {
                let value = -1.0 + f64::from(steps) * power_of_two(-unit);
                let [y, x] = encode(value);
                let back = decode(y, x);
                assert!((back - value).abs() <= power_of_two(-35), "{value:e} became {back:e}");
            }
        }
        let [y, x] = encode(-(1.0 + power_of_two(-35)));
        assert_eq!(decode(y, x), -1.0);
    }

    #[test]
    fn extremes_saturate_and_nothing_is_undefined() {
        assert_eq!(encode(f64::NAN), [0, 0]);
        assert_eq!(encode(0.0), [0, 0]);
        assert_eq!(encode(-0.0), [0, 0]);
        assert_eq!(encode(f64::INFINITY), [0xFFFF_FFFF, 0x007F_FFFF]);
        assert_eq!(encode(f64::NEG_INFINITY), [0x0000_0FFF, 0xFF80_0000]);
        for tiny in [f64::MIN_POSITIVE, f64::from_bits(1), -f64::from_bits(1), f64::from_bits(0x7_FFFF_FFFF)]
        {
            let [y, x] = encode(tiny);
            assert_eq!(decode(y, x), tiny);
        }
        // The largest f64 rounds up to 2^1024, which this format can hold and f64 cannot.
        assert_eq!(encode(f64::MAX), [0x0000_0C00, 0x0040_0000]);
        // The format's smallest numbers are too small for f64.
        assert_eq!(decode(0, 0x0040_0000), 0.0);
        assert_eq!(decode(0xFFF, 0x0040_0000), f64::INFINITY);
    }

    #[test]
    fn mantissas_that_are_not_normalised_decode_to_what_they_stand_for() {
        // 1 = 0.5 * 2^1 = 0.25 * 2^2 = ... = 2^-35 * 2^35
        for shift in 0..=34u32 {
            let [y, x] = registers(HALF >> shift, 0x800 + shift);
            assert_eq!(decode(y, x), 1.0, "shift {shift}");
        }
        for shift in 0..=35u32 {
            let [y, x] = registers(-HALF_CARRIED >> shift, 0x7FF + shift);
            assert_eq!(decode(y, x), -1.0, "shift {shift}");
        }
        // A zero mantissa is zero whatever the exponent.
        assert_eq!(decode(0xFFF, 0), 0.0);
    }

    #[test]
    fn a_missing_sign_extension_does_not_matter() {
        assert_eq!(decode(0x0000_0801, 0x0098_0000), -3.25);
        assert_eq!(decode(0xAB00_0801, 0x1298_0000), -3.25);
    }

    #[test]
    fn the_printed_layout_reads_the_manuals_fields() {
        // Mantissa = low word + low 12 bits of the high word; exponent = bits 23-12 of the high word.
        let read = |y, x| Float48Layout::Printed.decode(y, x);
        assert_eq!(read(0x00_0000, 0x80_0400), 1.0);
        assert_eq!(read(0x00_0000, 0x7F_F800), -1.0);
        assert_eq!(read(0x00_0001, 0x80_0400), 1.0 + power_of_two(-34));
        assert_eq!(read(0x80_0000, 0x80_0400), 1.0 + power_of_two(-11));
        assert_eq!(read(0, 0), 0.0);
        // It cannot read what boards write.
        let [y, x] = encode(1.0);
        assert_ne!(read(y, x), 1.0);
    }

    #[test]
    fn layouts_have_names_in_settings() {
        let name = |layout| serde_json::to_string(&layout).unwrap();
        assert_eq!(name(Float48Layout::Register), "\"register\"");
        assert_eq!(name(Float48Layout::Printed), "\"printed\"");
        assert_eq!(Float48Layout::default(), Float48Layout::Register);
    }

    proptest! {
        #[test]
        fn normalised_registers_survive_decode_and_encode(mantissa in any::<i64>(), biased in 1030u32..3000) {
            let mantissa = mantissa >> 28;
            prop_assume!(normalised(mantissa));
            let [y, x] = registers(mantissa, biased);
            prop_assert_eq!(encode(decode(y, x)), [y, x]);
        }

        #[test]
        fn encoding_rounds_to_nearest_and_normalises(bits in any::<u64>()) {
            let value = f64::from_bits(bits);
            prop_assume!(value.is_finite() && value != 0.0 && value.abs() < power_of_two(1023));
            let [y, x] = encode(value);
            prop_assert_eq!([int24::extend(y), int24::extend(x)], [y, x]);
            let mantissa = i64::from(int24::signed(x)) << 12 | i64::from(int24::unsigned(y) >> 12);
            prop_assert!(normalised(mantissa));
            let error = (decode(y, x) - value).abs();
            // Half a unit in the last of 36 bits. Subnormal bounds are below the resolution of f64: exact there.
            prop_assert!(error <= value.abs() * power_of_two(-35), "{value:e}: {error:e}");
        }

        #[test]
        fn any_register_decodes_without_panic(y in any::<u32>(), x in any::<u32>()) {
            for layout in [Float48Layout::Register, Float48Layout::Printed] {
                prop_assert!(!layout.decode(y, x).is_nan());
            }
        }
    }
}
