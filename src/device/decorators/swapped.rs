//! Decorator: swaps the bytes of each 16-bit word, as some VME bridges deliver them.
//!
//! Acts on words only. The order of characters within a word is an independent setting ([`crate::format::TextOrder`]):
//! boards in production need one, the other, or both. Reads data by 16 bits, whatever the inner bus could do: no
//! document says how a swapping bridge treats 32 bits.

use crate::device::{Bus, BusError, Presence};
use crate::map::HostOffset;
use crate::protocol::board::Replay;

/// Swaps the bytes of every word on its way to and from the inner bus.
pub struct WordSwapped<B>(pub B);

impl<B: Bus> Bus for WordSwapped<B> {
    fn length(&self) -> usize {
        self.0.length()
    }

    fn read16(&mut self, offset: HostOffset) -> Result<u16, BusError> {
        self.0.read16(offset).map(u16::swap_bytes)
    }

    fn write16(&mut self, offset: HostOffset, value: u16) -> Result<(), BusError> {
        self.0.write16(offset, value.swap_bytes())
    }

    fn read_block(&mut self, first: HostOffset, words: &mut [u16]) -> Result<(), BusError> {
        self.0.read_block(first, words)?;
        for word in words {
            *word = word.swap_bytes();
        }
        Ok(())
    }

    fn order_reads(&mut self) {
        self.0.order_reads();
    }

    fn order_writes(&mut self) {
        self.0.order_writes();
    }
}

impl<B: Presence> Presence for WordSwapped<B> {
    fn still_there(&self) -> bool {
        self.0.still_there()
    }

    fn answers(&mut self) -> bool {
        self.0.answers()
    }

    fn replay(&self) -> Option<Replay> {
        self.0.replay()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::FileBoard;

    #[test]
    fn words_are_exchanged_both_ways() {
        let file = tempfile::tempfile().unwrap();
        file.set_len(0x4000).unwrap();
        let mut plain = FileBoard::from_file(&file, 0x4000).unwrap();
        let mut swapped = WordSwapped(FileBoard::from_file(&file, 0x4000).unwrap());
        swapped.write16(HostOffset::new(0x100), 0x1234).unwrap();
        assert_eq!(plain.read16(HostOffset::new(0x100)).unwrap(), 0x3412);
        assert_eq!(swapped.read16(HostOffset::new(0x100)).unwrap(), 0x1234);
        let mut block = [0; 2];
        swapped.read_block(HostOffset::new(0x0FE), &mut block).unwrap();
        assert_eq!(block, [0, 0x1234]);
    }
}
