//! A stretch of the DPRAM that one automatic function uses.

use super::HostOffset;

/// A stretch of the DPRAM, from its first word up to, not including, its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Region {
    /// The function's name, snake case.
    pub name: &'static str,
    /// The first word.
    pub start: HostOffset,
    /// The first word behind it.
    pub end: HostOffset,
}

impl Region {
    /// The region `name` from `start` up to `end`.
    ///
    /// # Panics
    /// At compile time for constants, if `end` is before `start`.
    #[must_use]
    pub const fn new(name: &'static str, start: HostOffset, end: HostOffset) -> Self {
        assert!(start.bytes() <= end.bytes(), "a region ends behind its start");
        Self { name, start, end }
    }

    /// Its length in 16-bit words.
    #[must_use]
    pub const fn words(self) -> usize {
        self.end.word() - self.start.word()
    }

    /// Whether the word at `offset` belongs to it.
    #[must_use]
    pub const fn contains(self, offset: HostOffset) -> bool {
        self.start.bytes() <= offset.bytes() && offset.bytes() < self.end.bytes()
    }
}
