//! Words of the DPRAM that clients write.

use crate::daemon::shared::job::MaskedWord;
use crate::daemon::shared::queue::Outcome;
use crate::device::{Bus, BusError};
use crate::map::HostOffset;

/// Writes words, ascending. Changes only the bits of each word's mask.
///
/// # Errors
/// When the bus cannot be reached.
pub fn write(bus: &mut impl Bus, first: HostOffset, words: &[MaskedWord]) -> Result<Outcome, BusError> {
    // Writes nothing unless it can write all words.
    let end = first.plus_words(words.len()).bytes() as usize;
    if end > bus.length() {
        return Ok(Outcome::OutOfRange);
    }
    for (index, word) in words.iter().enumerate() {
        // Leaves a word alone if none of its bits is to change: the word may be PMAC's.
        if word.mask == 0 {
            continue;
        }
        let offset = first.plus_words(index);
        let value = if word.mask == u16::MAX {
            word.value
        } else {
            bus.read16(offset)? & !word.mask | word.value & word.mask
        };
        bus.write16(offset, value)?;
    }
    bus.order_writes();
    Ok(Outcome::Done)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::{Counted, FileBoard};

    /// The rows of [`crate::function`]'s table of costs about open words.
    #[test]
    fn open_words_cost_what_the_table_says() {
        for n in [1, 8, 100] {
            for (mask, cost) in [(u16::MAX, (0, n)), (0x00F0, (n, n)), (0, (0, 0))] {
                let file = tempfile::tempfile().unwrap();
                file.set_len(0x4000).unwrap();
                let mut bus = Counted::new(FileBoard::from_file(&file, 0x4000).unwrap());
                let words = vec![MaskedWord { value: 0xABCD, mask }; n as usize];
                assert_eq!(write(&mut bus, HostOffset::new(0x3000), &words).unwrap(), Outcome::Done);
                assert_eq!((bus.reads(), bus.writes()), cost, "{n} {mask:04x}");
                assert_eq!(bus.read16(HostOffset::new(0x3000)).unwrap(), 0xABCD & mask);
            }
        }
    }
}
