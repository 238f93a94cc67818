//! `D:` registers, 48-bit fixed point: value = signed X half * 2^24 + unsigned Y half (FACTS: the manual's p. 11
//! text, confirmed).

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
