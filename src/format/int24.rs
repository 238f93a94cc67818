//! 24-bit X and Y words and their 32-bit sign-extended form in the DPRAM.

/// The bits of a 24-bit PMAC word.
pub const MASK: u32 = 0x00FF_FFFF;

/// Reads the low 24 bits as a signed PMAC word. Ignores the top byte, in which the board repeats bit 23.
#[must_use]
pub const fn signed(dword: u32) -> i32 {
    ((dword << 8) as i32) >> 8
}

/// Reads the low 24 bits as an unsigned PMAC word (a status word, an address).
#[must_use]
pub const fn unsigned(dword: u32) -> u32 {
    dword & MASK
}

/// The 24-bit `word`, sign-extended to 32 bits as the DPRAM holds it.
#[must_use]
pub const fn extend(word: u32) -> u32 {
    signed(word) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_24_bit_value_survives_both_ways() {
        for word in 0..=MASK {
            let value = if word < 0x80_0000 { word as i32 } else { word as i32 - 0x100_0000 };
            let dword = extend(word);
            if dword != value as u32
                || signed(dword) != value
                || unsigned(dword) != word
                || signed(word) != value
            {
                panic!("{word:06X} became {dword:08X}");
            }
        }
    }

    #[test]
    fn the_top_byte_does_not_matter() {
        for top in [0x00, 0x01, 0x7F, 0x80, 0xFF] {
            let dword = top << 24 | 0x80_0001;
            assert_eq!(signed(dword), -0x7F_FFFF);
            assert_eq!(unsigned(dword), 0x80_0001);
            assert_eq!(extend(dword), 0xFF80_0001);
        }
    }
}
