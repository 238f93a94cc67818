//! 24-bit X and Y words and their 32-bit sign-extended form in the DPRAM.

/// The bits of a 24-bit PMAC word.
pub const MASK: u32 = 0x00FF_FFFF;

/// Reads the low 24 bits as a signed PMAC word. The top byte, a copy of bit 23 when the board wrote it, is ignored.
#[must_use]
pub const fn signed(dword: u32) -> i32 {
    ((dword << 8) as i32) >> 8
}

/// Reads the low 24 bits as an unsigned PMAC word (a status word, an address).
#[must_use]
pub const fn unsigned(dword: u32) -> u32 {
    dword & MASK
}

/// The sign-extended 32-bit form in which the DPRAM holds the 24-bit `word`.
#[must_use]
pub const fn extend(word: u32) -> u32 {
    signed(word) as u32
}
