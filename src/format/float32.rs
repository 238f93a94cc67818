//! `F:` registers of the DPRAM: IEEE-754 single precision, the X word is the high half (DPRAM manual p. 1).

use super::{join32, split32};

/// Decodes from the Y (low) and X (high) words.
#[must_use]
pub const fn decode(y: u16, x: u16) -> f32 {
    f32::from_bits(join32(y, x))
}

/// Encodes as Y (low) and X (high) words.
#[must_use]
pub const fn encode(value: f32) -> [u16; 2] {
    split32(value.to_bits())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_x_word_is_the_high_half() {
        assert_eq!(encode(1.0), [0x0000, 0x3F80]);
        assert_eq!(encode(-3.140_625), [0x0000, 0xC049]);
        assert_eq!(decode(0xDB0F_u16.swap_bytes(), 0x4049), std::f32::consts::PI);
        assert!(decode(0x0001, 0x7FC0).is_nan());
    }

    proptest! {
        #[test]
        fn every_bit_pattern_survives(y in any::<u16>(), x in any::<u16>()) {
            // A signalling NaN may turn into a quiet one; every number survives unchanged.
            prop_assume!(!decode(y, x).is_nan());
            prop_assert_eq!(encode(decode(y, x)), [y, x]);
        }
    }
}
