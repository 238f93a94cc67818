//! PMAC addresses and host offsets, and the rule that joins them.
//!
//! Host offset = 4 * (PMAC address - base) + (X ? 2 : 0), in bytes (DPRAM manual p. 7); the base is $D000 on PMAC and
//! PMAC2 and $060000 on Turbo. The two kinds of number are separate types, so one cannot be passed for the other.

use std::fmt;

/// A byte offset of the host into the DPRAM. Always even, the place of a 16-bit word.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct HostOffset(u32);

impl HostOffset {
    /// An offset in bytes.
    ///
    /// # Panics
    /// At compile time for constants, if `bytes` is odd.
    #[must_use]
    pub const fn new(bytes: u32) -> Self {
        assert!(bytes.is_multiple_of(2), "a DPRAM word lies at an even offset");
        Self(bytes)
    }

    /// An offset in bytes, or `None` when it is odd.
    #[must_use]
    pub const fn checked(bytes: u32) -> Option<Self> {
        if bytes.is_multiple_of(2) { Some(Self(bytes)) } else { None }
    }

    /// The offset in bytes.
    #[must_use]
    pub const fn bytes(self) -> u32 {
        self.0
    }

    /// The offset in 16-bit words.
    #[must_use]
    pub const fn word(self) -> usize {
        self.0 as usize / 2
    }

    /// The offset `words` 16-bit words further on.
    #[must_use]
    pub const fn plus_words(self, words: usize) -> Self {
        Self(self.0 + 2 * words as u32)
    }

    /// The number of 16-bit words from `start` up to here; 0 if `start` is behind.
    #[must_use]
    pub const fn words_since(self, start: Self) -> usize {
        self.word().saturating_sub(start.word())
    }
}

impl fmt::Display for HostOffset {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "0x{:04X}", self.0)
    }
}

/// The half of a PMAC location that an address names, or the way to read both halves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Space {
    /// `Y:` the low half; in the DPRAM one 16-bit word.
    Y,
    /// `X:` the high half; in the DPRAM one 16-bit word.
    X,
    /// `DP:` both halves of a DPRAM location as a 32-bit integer.
    Dp,
    /// `D:` a 48-bit fixed-point register; in the DPRAM two consecutive `DP:` locations.
    D,
    /// `L:` a 48-bit floating-point register; in the DPRAM two consecutive `DP:` locations.
    L,
    /// `F:` both halves of a DPRAM location as an IEEE single.
    F,
}

impl Space {
    /// Every space, in the order their letters are tried.
    pub const ALL: [Self; 6] = [Self::Dp, Self::Y, Self::X, Self::D, Self::L, Self::F];

    /// The letters before the colon, as the manual prints them.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Y => "Y",
            Self::X => "X",
            Self::Dp => "DP",
            Self::D => "D",
            Self::L => "L",
            Self::F => "F",
        }
    }

    /// How many 16-bit DPRAM words a value of this space takes.
    #[must_use]
    pub const fn words(self) -> usize {
        match self {
            Self::Y | Self::X => 1,
            Self::Dp | Self::F => 2,
            Self::D | Self::L => 4,
        }
    }
}

impl fmt::Display for Space {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A location in the PMAC's own address space. Prints as the manual does, `X:$D009`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PmacAddress {
    /// The half, or the way to read both.
    pub space: Space,
    /// The number after the `$`.
    pub number: u32,
}

impl PmacAddress {
    /// The address `number` in `space`.
    #[must_use]
    pub const fn new(space: Space, number: u32) -> Self {
        Self { space, number }
    }
}

impl fmt::Display for PmacAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Turbo addresses are printed with six digits, others with four.
        let digits = if self.number > 0xFFFF { 6 } else { 4 };
        write!(f, "{}:${:0digits$X}", self.space, self.number)
    }
}
