//! 48-bit registers in the records of the variable write buffer.
//!
//! Everywhere else the DPRAM holds a 48-bit register as two sign-extended 24-bit halves; a record of the background
//! variable write buffer holds its low 32 bits in the first data long and its high 16 bits in the second (DPRAM
//! manual p. 25).

use super::int24;

/// Packs the two long words of a 48-bit register, Y half first (as [`super::float48::encode`] and
/// [`super::fixed48::encode`] give them), into a record's two data longs.
#[must_use]
pub const fn pack(register: [u32; 2]) -> [u32; 2] {
    let [y, x] = [int24::unsigned(register[0]), int24::unsigned(register[1])];
    [x << 24 | y, x >> 8]
}

/// The two sign-extended long words, Y half first, of the register in a record's data longs. Inverse of [`pack`].
#[must_use]
pub const fn unpack(data: [u32; 2]) -> [u32; 2] {
    let x = (data[1] & 0xFFFF) << 8 | data[0] >> 24;
    [int24::extend(data[0]), int24::extend(x)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_halves_are_joined_at_bit_24() {
        assert_eq!(pack([0xFF99_A7FC, 0xFF99_9999]), [0x9999_A7FC, 0x0000_9999]);
        assert_eq!(unpack([0x9999_A7FC, 0x0000_9999]), [0xFF99_A7FC, 0xFF99_9999]);
        assert_eq!(pack([0x0012_3456, 0x0078_9ABC]), [0xBC12_3456, 0x0000_789A]);
    }

    proptest! {
        #[test]
        fn packing_loses_nothing(y in any::<u32>(), x in any::<u32>()) {
            let register = [int24::extend(y), int24::extend(x)];
            prop_assert_eq!(unpack(pack(register)), register);
            // Bits above 47 do not matter.
            prop_assert_eq!(pack([y, x]), pack(register));
        }
    }
}
