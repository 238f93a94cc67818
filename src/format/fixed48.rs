//! `D:` registers, 48-bit fixed point: value = signed X half * 2^24 + unsigned Y half (DPRAM manual p. 11, running
//! text).

use super::int24;

/// Decodes a fixed-point register from its two DPRAM long words, Y half (low address) first.
#[must_use]
pub const fn decode(y: u32, x: u32) -> i64 {
    (int24::signed(x) as i64) << 24 | int24::unsigned(y) as i64
}

/// Encodes the low 48 bits of `value` as two sign-extended DPRAM long words, Y half first.
#[must_use]
pub const fn encode(value: i64) -> [u32; 2] {
    [int24::extend(value as u32 & int24::MASK), int24::extend((value >> 24) as u32 & int24::MASK)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_seams_between_the_halves_hold() {
        for value in [0, 1, -1, (1 << 23) - 1, 1 << 23, -(1 << 23), (1 << 24) - 1, 1 << 24, -(1 << 24) - 1] {
            let [y, x] = encode(value);
            assert_eq!(decode(y, x), value);
        }
        assert_eq!(decode(0xFFFF_FFFF, 0x007F_FFFF), (1 << 47) - 1);
        assert_eq!(decode(0, 0xFF80_0000), -(1 << 47));
        // The board drops bits above 47, too.
        assert_eq!(encode(1 << 48), [0, 0]);
        assert_eq!(encode(1 << 47), encode(-(1 << 47)));
    }

    proptest! {
        #[test]
        fn every_48_bit_value_survives(value in -(1i64 << 47)..1 << 47) {
            let [y, x] = encode(value);
            prop_assert_eq!(decode(y, x), value);
            prop_assert_eq!([int24::extend(y), int24::extend(x)], [y, x]);
            prop_assert_eq!(decode(int24::unsigned(y), int24::unsigned(x)), value);
        }
    }
}
