//! The part of a report that the daemon reads: the same words of each block, for some of the blocks.
//!
//! The servo and the background report each have a block for each motor (or coordinate system), one behind the other.
//! Bus accesses are the cost on real hardware, so the daemon can leave words out. An unread word is not 0 but unknown:
//! the decoder gets the selection with the words.

use std::ops::Range;

use super::{Family, Register};

/// The words of each block, and the blocks, that the daemon reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Selection {
    words: u64,
    numbers: u64,
}

impl Default for Selection {
    fn default() -> Self {
        Self::ALL
    }
}

impl Selection {
    /// The daemon reads everything.
    pub const ALL: Self = Self { words: u64::MAX, numbers: u64::MAX };

    /// Selects in each block the words of `fields`, 16 bits each, from the block's start, and the blocks of `numbers`,
    /// from 1. No block has more than 64 words, no family more than 64 numbers; the rest is left out.
    #[must_use]
    pub fn new(
        fields: impl IntoIterator<Item = Range<usize>>,
        numbers: impl IntoIterator<Item = usize>,
    ) -> Self {
        let words = fields.into_iter().flatten().filter_map(bit).fold(0, |words, bit| words | bit);
        let numbers = numbers.into_iter().filter_map(|number| bit(number.checked_sub(1)?));
        Self { words, numbers: numbers.fold(0, |numbers, bit| numbers | bit) }
    }

    /// The selection that leaves out word `i` of every block where bit `i` of `words` is set, and number `k` where bit
    /// `k-1` of `numbers` is: 0 and 0 leave nothing out.
    #[must_use]
    pub const fn without(words: u64, numbers: u64) -> Self {
        Self { words: !words, numbers: !numbers }
    }

    /// The common part of this selection and the numbers of a mask, bit k-1 for number k.
    #[must_use]
    pub const fn among(self, numbers: u32) -> Self {
        Self { words: self.words, numbers: self.numbers & numbers as u64 }
    }

    /// The arguments of [`Selection::without`]: the words and the numbers left out.
    #[must_use]
    pub const fn left_out(self) -> (u64, u64) {
        (!self.words, !self.numbers)
    }

    /// Whether the daemon reads word `word` of a block and the `count - 1` words behind it.
    #[must_use]
    pub fn has_words(self, word: usize, count: usize) -> bool {
        (word..word + count).all(|word| bit(word).is_some_and(|bit| self.words & bit != 0))
    }

    /// Whether the daemon reads the block of `number`, from 1.
    #[must_use]
    pub fn has_number(self, number: usize) -> bool {
        number.checked_sub(1).and_then(bit).is_some_and(|bit| self.numbers & bit != 0)
    }

    /// The numbers among the first `count`, at most 32, whose blocks the daemon reads: bit k-1 for number k.
    #[must_use]
    pub const fn mask(self, count: usize) -> u32 {
        let all = if count < 32 { (1 << count) - 1 } else { u32::MAX };
        self.numbers as u32 & all
    }

    /// The number of blocks, of the first `count`, up to the last block that the daemon reads.
    #[must_use]
    pub fn last_number(self, count: usize) -> usize {
        (1..=count).rev().find(|number| self.has_number(*number)).unwrap_or(0)
    }

    /// Puts the read parts of `count` blocks of `block_words` words into `runs`, ascending, in words from the first
    /// block's start. Adjacent parts are one run.
    pub fn runs(self, block_words: usize, count: usize, runs: &mut Vec<Range<usize>>) {
        runs.clear();
        for block in (0..count).filter(|block| self.has_number(block + 1)) {
            for word in (0..block_words).filter(|word| self.has_words(*word, 1)) {
                let at = block * block_words + word;
                match runs.last_mut() {
                    Some(run) if run.end == at => run.end += 1,
                    _ => runs.push(at..at + 1),
                }
            }
        }
    }
}

fn bit(index: usize) -> Option<u64> {
    1_u64.checked_shl(u32::try_from(index).ok()?)
}

/// A register of a report's blocks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BlockField {
    /// Its name without the owner: `actual_position` of the table's `motor_actual_position`.
    pub name: &'static str,
    /// The table's row.
    pub register: &'static Register,
    /// Its words, from the block's start.
    pub words: Range<usize>,
}

impl BlockField {
    /// Whether `name` is its name, with or without the owner.
    #[must_use]
    pub fn is_called(&self, name: &str) -> bool {
        name == self.name || name == self.register.name
    }
}

/// The registers of the blocks of `function` (`servo`, `background`), in their order.
pub fn block_fields(family: &Family, function: &str) -> impl Iterator<Item = BlockField> + use<> {
    let of_function = |block: &&super::Block| {
        block.count > 0 && block.registers.first().is_some_and(|first| first.function == function)
    };
    let registers = family.blocks.iter().find(of_function).map_or(&[][..], |block| block.registers);
    registers.iter().map(|register| {
        let start = registers.first().map_or(0, |first| register.offset.words_since(first.offset));
        let short = register.name.strip_prefix("motor_").or_else(|| register.name.strip_prefix("cs_"));
        let words = start..start + register.length as usize / 2;
        BlockField { name: short.unwrap_or(register.name), register, words }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::{Blocks, FAMILIES, PMAC};

    fn runs(selection: Selection, block_words: usize, count: usize) -> Vec<Range<usize>> {
        let mut runs = vec![7..9, 9..10];
        selection.runs(block_words, count, &mut runs);
        runs
    }

    #[test]
    fn neighbours_are_one_run_across_blocks_too() {
        assert_eq!(runs(Selection::ALL, 30, 8), [Range { start: 0, end: 240 }]);
        assert!(runs(Selection::ALL, 62, 0).is_empty());
        let selection = Selection::new([0..2, 4..6, 28..30], [1, 2, 4]);
        assert_eq!(runs(selection, 30, 4), [0..2, 4..6, 28..32, 34..36, 58..60, 90..92, 94..96, 118..120]);
        assert_eq!(runs(selection, 30, 1), [0..2, 4..6, 28..30]);
        assert_eq!((selection.last_number(8), selection.last_number(3), selection.last_number(0)), (4, 2, 0));
    }

    #[test]
    fn what_is_left_out_comes_back_and_nothing_is_out_of_bounds() {
        let selection = Selection::new([4..8, 60..70], [3, 0, 64, 65, usize::MAX]);
        let (words, numbers) = selection.left_out();
        assert_eq!(Selection::without(words, numbers), selection);
        assert_eq!(Selection::without(0, 0), Selection::ALL);
        assert!(selection.has_words(4, 4) && !selection.has_words(4, 5) && !selection.has_words(62, 4));
        assert!(selection.has_number(3) && selection.has_number(64));
        assert!(!selection.has_number(0) && !selection.has_number(65) && !selection.has_number(usize::MAX));
        assert!(!selection.has_words(usize::MAX - 1, 1));
        assert_eq!((selection.mask(32), selection.mask(2), Selection::ALL.mask(32)), (0b100, 0, u32::MAX));
        assert_eq!(selection.among(0b1110), Selection::new([4..8, 60..64], [3]));
    }

    #[test]
    fn the_fields_fill_their_block_without_a_gap() {
        for family in FAMILIES {
            let blocks = [("servo", family.servo.motors), ("background", family.background.blocks)];
            for (function, Blocks { words, .. }) in blocks {
                let mut next = 0;
                for field in block_fields(family, function) {
                    assert_eq!((field.words.start, field.register.function), (next, function));
                    next = field.words.end;
                }
                assert_eq!(next, words, "{function}");
            }
        }
        let named = |name| block_fields(&PMAC, "servo").find(|field| field.is_called(name)).unwrap().words;
        assert_eq!((named("actual_position"), named("motor_spare")), (4..8, 26..30));
        assert_eq!(block_fields(&PMAC, "nothing").count(), 0);
    }
}
