//! Mapped memory as a bus, for every kind of board that is mapped. Reads each word once, in ascending order, by one
//! access; reads two words of data by one access where the board takes 32 bits.

use crate::device::mapping::Mapping;
use crate::device::{Access, Bus, BusError};
use crate::map::HostOffset;

/// A board whose words are those of a mapping.
pub trait Mapped: Send {
    /// The mapping.
    fn mapping(&self) -> &Mapping;
}

impl Mapped for Mapping {
    fn mapping(&self) -> &Mapping {
        self
    }
}

impl<M: Mapped> Bus for M {
    fn length(&self) -> usize {
        self.mapping().length()
    }

    fn read16(&mut self, offset: HostOffset) -> Result<u16, BusError> {
        self.mapping().read16(offset.bytes() as usize).ok_or_else(|| out_of_range(self.mapping(), offset, 1))
    }

    fn write16(&mut self, offset: HostOffset, value: u16) -> Result<(), BusError> {
        self.mapping()
            .write16(offset.bytes() as usize, value)
            .ok_or_else(|| out_of_range(self.mapping(), offset, 1))
    }

    fn access(&self) -> Access {
        self.mapping().access()
    }

    fn read_block(&mut self, first: HostOffset, words: &mut [u16]) -> Result<(), BusError> {
        let mapping = self.mapping();
        mapping
            .read_words(first.bytes() as usize, words)
            .ok_or_else(|| out_of_range(mapping, first, words.len()))
    }

    fn read_data(&mut self, first: HostOffset, words: &mut [u16]) -> Result<usize, BusError> {
        if self.mapping().access() == Access::Bits16 {
            self.read_block(first, words)?;
            return Ok(words.len());
        }
        let mapping = self.mapping();
        let (start, count) = (first.bytes() as usize, words.len());
        if start + 2 * count > mapping.length() {
            return Err(out_of_range(mapping, first, count));
        }
        let (mut at, mut accesses) = (0, 0);
        while let Some(rest) = words.get_mut(at..).filter(|rest| !rest.is_empty()) {
            let offset = start + 2 * at;
            let pair = if rest.len() >= 2 { mapping.read32(offset) } else { None };
            if let (Some(read), [low, high, ..]) = (pair, &mut *rest) {
                [*low, *high] = read;
                at += 2;
            } else {
                rest[0] = mapping.read16(offset).ok_or_else(|| out_of_range(mapping, first, count))?;
                at += 1;
            }
            accesses += 1;
        }
        Ok(accesses)
    }

    fn order_reads(&mut self) {
        self.mapping().order_reads();
    }

    fn order_writes(&mut self) {
        self.mapping().order_writes();
    }
}

fn out_of_range(mapping: &Mapping, offset: HostOffset, words: usize) -> BusError {
    BusError::OutOfRange { offset, words, length: mapping.length() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::{Counted, WordSwapped};
    use proptest::prelude::*;

    proptest! {
        /// At every alignment of window and block, 32-bit reads give the same words as 16-bit reads, each aligned pair
        /// by one access.
        #[test]
        fn wide_reads_give_the_same_words(
            content in prop::collection::vec(any::<u16>(), 64),
            start in 0usize..4, first in 0usize..70, count in 0usize..70,
        ) {
            let file = tempfile::tempfile().unwrap();
            file.set_len(0x1000).unwrap();
            let window = || Mapping::new(&file, 2 * start as u64, 128).unwrap();
            let mut narrow = Counted::new(window());
            for (index, word) in content.iter().enumerate() {
                narrow.write16(HostOffset::new(2 * index as u32), *word).unwrap();
            }
            let mut wide = Counted::new(window().with_access(Access::Bits32));
            let first_word = HostOffset::new(2 * first as u32);
            let (mut by_16, mut by_32) = (vec![0; count], vec![0; count]);
            let written = narrow.accesses();
            let read = (narrow.read_data(first_word, &mut by_16).ok(), wide.read_data(first_word, &mut by_32).ok());
            prop_assert_eq!(&by_16, &by_32);
            if first + count > 64 {
                prop_assert_eq!((read, wide.accesses()), ((None, None), 0));
            } else {
                prop_assert_eq!(&by_32, &content[first..first + count]);
                // One odd word may precede the first aligned pair, and one may follow the last.
                let before = ((start + first) % 2).min(count);
                let accesses = before + (count - before).div_ceil(2);
                prop_assert_eq!(read, (Some(count), Some(accesses)));
                prop_assert_eq!((narrow.accesses() - written, wide.accesses()), (count as u64, accesses as u64));
                // The bus never reads two words at once if a bridge swaps their bytes.
                let mut swapped = WordSwapped(window().with_access(Access::Bits32));
                prop_assert_eq!(swapped.read_data(first_word, &mut by_32).ok(), Some(count));
                by_32.iter_mut().for_each(|word| *word = word.swap_bytes());
                prop_assert_eq!(&by_16, &by_32);
            }
        }
    }

    #[test]
    fn control_words_are_read_by_16_bits_all_the_same() {
        let file = tempfile::tempfile().unwrap();
        file.set_len(0x1000).unwrap();
        let mut bus = Counted::new(Mapping::new(&file, 0, 0x100).unwrap().with_access(Access::Bits32));
        bus.read_block(HostOffset::new(0), &mut [0; 8]).unwrap();
        bus.read16(HostOffset::new(0)).unwrap();
        assert_eq!(bus.accesses(), 9);
    }
}
