//! Numbers and text as the DPRAM holds them, and text as files do (layer 0).
//!
//! A PMAC word is 24 bits; the DPRAM keeps each one sign-extended in two 16-bit words, low word at the low address
//! (DPRAM manual, "DPRAM Data Format", p. 11). A 48-bit register is two such pairs: the Y half first, then the X half.

pub mod file_text;
pub mod fixed48;
pub mod float32;
pub mod float48;
pub mod int24;
pub mod short_text;
pub mod text;
pub mod visible;
pub mod word_order;
pub mod write48;

pub use float48::Float48Layout;
pub use short_text::Text;
pub use text::TextOrder;
pub use visible::Visible;
pub use word_order::WordOrder;

/// Joins two 16-bit DPRAM words, low address first, into the 32-bit value a `DP:` register has.
#[must_use]
pub const fn join32(low: u16, high: u16) -> u32 {
    (high as u32) << 16 | low as u32
}

/// Splits a 32-bit value into its two DPRAM words, low address first. Inverse of [`join32`].
#[must_use]
pub const fn split32(value: u32) -> [u16; 2] {
    [value as u16, (value >> 16) as u16]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_dp_register_survives_both_ways(value in any::<u32>()) {
            let [low, high] = split32(value);
            prop_assert_eq!((low, high), ((value & 0xFFFF) as u16, (value >> 16) as u16));
            prop_assert_eq!(join32(low, high), value);
        }
    }
}
