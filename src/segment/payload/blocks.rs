//! The places of the blocks of motors or coordinate systems in the servo and background regions.
//!
//! The payload itself is the board's 16-bit words unchanged, ascending by host offset. It ends with the last block that
//! the daemon reads.

use crate::map::{Blocks, HostOffset};

/// Equal, adjacent blocks in a payload, one for each motor or coordinate system. All in bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BlockPlace {
    /// From the payload's start to the first block.
    pub start: u32,
    /// From one block to the next.
    pub stride: u32,
    /// Most blocks in a payload; 0 for a region without blocks.
    pub count: u32,
}

impl BlockPlace {
    /// A payload without blocks.
    pub const NONE: Self = Self { start: 0, stride: 0, count: 0 };

    /// The place of `blocks` in a payload whose first word has host offset `first`.
    #[must_use]
    pub const fn new(blocks: Blocks, first: HostOffset) -> Self {
        Self {
            start: 2 * blocks.first.words_since(first) as u32,
            stride: 2 * blocks.words as u32,
            count: blocks.count as u32,
        }
    }

    /// How many whole blocks fit in a payload of `payload_bytes`.
    #[must_use]
    pub fn held_in(self, payload_bytes: usize) -> usize {
        let blocks = payload_bytes.saturating_sub(self.start as usize).checked_div(self.stride as usize);
        blocks.unwrap_or(0).min(self.count as usize)
    }

    /// Whether all blocks lie within a payload of `payload_bytes`, on whole 16-bit words.
    #[must_use]
    pub(in crate::segment) fn fits(self, payload_bytes: u64) -> bool {
        let end = u64::from(self.start) + u64::from(self.stride) * u64::from(self.count);
        let whole_words = self.start.is_multiple_of(2) && self.stride.is_multiple_of(2);
        whole_words && end <= payload_bytes && (self.count == 0 || self.stride > 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::PMAC;

    #[test]
    fn a_payload_holds_as_many_blocks_as_are_whole() {
        let place = BlockPlace { start: 36, stride: 60, count: 8 };
        assert_eq!([0, 36, 95, 96, 156, 516, 1000].map(|bytes| place.held_in(bytes)), [0, 0, 0, 1, 2, 8, 8]);
        assert_eq!(BlockPlace::NONE.held_in(1000), 0);
    }

    #[test]
    fn the_blocks_of_a_family_lie_where_its_map_says() {
        let place = BlockPlace::new(PMAC.servo.motors, PMAC.servo.region.start);
        assert_eq!(place, BlockPlace { start: 36, stride: 60, count: 8 });
        assert!(place.fits(516) && !place.fits(515));
        assert!(!BlockPlace { start: 35, ..place }.fits(1000), "no whole word");
        assert!(!BlockPlace { stride: 0, ..place }.fits(1000));
        assert!(!BlockPlace { stride: u32::MAX - 1, count: u32::MAX, start: 0 }.fits(u64::MAX / 4));
    }
}
