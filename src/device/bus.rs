//! The bus to the board: exact-width access, one word at a time.

use crate::map::HostOffset;

/// How wide a read of a board's data may be. Control words are always read and written by 16 bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Access {
    /// 16 bits, as the DPRAM is: right on every bus.
    #[default]
    Bits16,
    /// 32 bits where two words lie in one aligned location: half the bus transactions on PCI, where the target or a bridge
    /// makes two device cycles of each. Not confirmed on a card.
    Bits32,
}

/// A failure to reach a word of the board.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BusError {
    /// The access would leave the mapped window.
    #[error("offset {offset} and the {words} words from there on leave the mapped window of {length} bytes")]
    OutOfRange {
        /// The first word's offset.
        offset: HostOffset,
        /// How many words were asked for.
        words: usize,
        /// The window's length in bytes.
        length: usize,
    },
}

/// Exact-width access to a board's DPRAM.
///
/// Every method that reads takes each word with one 16-bit access, in ascending order, once; none falls back to
/// another width, and none returns data it did not read. Only [`Bus::read_data`] may take two words at once.
pub trait Bus: Send {
    /// The length of the window in bytes.
    fn length(&self) -> usize;

    /// Reads one word.
    ///
    /// # Errors
    /// [`BusError::OutOfRange`] when the word lies outside the window.
    fn read16(&mut self, offset: HostOffset) -> Result<u16, BusError>;

    /// Writes one word.
    ///
    /// # Errors
    /// [`BusError::OutOfRange`] when the word lies outside the window.
    fn write16(&mut self, offset: HostOffset, value: u16) -> Result<(), BusError>;

    /// Reads `words.len()` consecutive words, ascending, each exactly once.
    ///
    /// # Errors
    /// [`BusError::OutOfRange`] when a word lies outside the window; nothing has been read then.
    fn read_block(&mut self, first: HostOffset, words: &mut [u16]) -> Result<(), BusError>;

    /// Reads `words.len()` consecutive words, ascending, each exactly once, and tells by how many bus accesses: where the
    /// board was said to take it, two words that lie in one aligned 32-bit location are one. For data alone, which PMAC
    /// owns while they are read; never for a word by which host and PMAC hand something over.
    ///
    /// # Errors
    /// [`BusError::OutOfRange`] when a word lies outside the window; nothing has been read then.
    fn read_data(&mut self, first: HostOffset, words: &mut [u16]) -> Result<usize, BusError> {
        self.read_block(first, words)?;
        Ok(words.len())
    }

    /// Orders the reads before this call before every access after it.
    fn order_reads(&mut self);

    /// Orders the writes before this call before the writes after it.
    fn order_writes(&mut self);
}

/// Whether a board is there at all. Asked about once a second; none of it counts as access to the board's words.
pub trait Presence {
    /// Whether the memory behind the window is still the board's: a simulated board may have been replaced.
    fn still_there(&self) -> bool {
        true
    }

    /// Whether something answers on the bus: where no board is, every word reads as ones.
    fn answers(&mut self) -> bool {
        true
    }
}

/// A board that was opened: its words, and whether it is still there.
pub trait Board: Bus + Presence {}

impl<B: Bus + Presence> Board for B {}

impl Bus for Box<dyn Board> {
    fn length(&self) -> usize {
        (**self).length()
    }
    fn read16(&mut self, offset: HostOffset) -> Result<u16, BusError> {
        (**self).read16(offset)
    }
    fn write16(&mut self, offset: HostOffset, value: u16) -> Result<(), BusError> {
        (**self).write16(offset, value)
    }
    fn read_block(&mut self, first: HostOffset, words: &mut [u16]) -> Result<(), BusError> {
        (**self).read_block(first, words)
    }
    fn read_data(&mut self, first: HostOffset, words: &mut [u16]) -> Result<usize, BusError> {
        (**self).read_data(first, words)
    }
    fn order_reads(&mut self) {
        (**self).order_reads();
    }
    fn order_writes(&mut self) {
        (**self).order_writes();
    }
}

impl Presence for Box<dyn Board> {
    fn still_there(&self) -> bool {
        (**self).still_there()
    }
    fn answers(&mut self) -> bool {
        (**self).answers()
    }
}
