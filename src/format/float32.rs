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
