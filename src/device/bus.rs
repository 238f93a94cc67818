//! The bus to the board: accesses of exact width, one word at a time; and the bus to byte registers beside the DPRAM.

use crate::map::HostOffset;
use crate::protocol::board::Replay;

/// The maximum width of a read of a board's data. Control words are always accessed by 16 bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Access {
    /// 16 bits, the width of the DPRAM: right on every bus.
    #[default]
    Bits16,
    /// 32 bits where two words share an aligned location. Halves the bus transactions on PCI, where the target or a
    /// bridge splits each into two device cycles. Not confirmed on a card.
    Bits32,
}

impl Access {
    /// The most words that one access reads.
    pub const MOST_WORDS: usize = 2;

    /// How many words one access reads.
    #[must_use]
    pub const fn words(self) -> usize {
        match self {
            Self::Bits16 => 1,
            Self::Bits32 => Self::MOST_WORDS,
        }
    }
}

/// Why a word of the board cannot be reached.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BusError {
    /// The access would leave the mapped window.
    #[error("offset {offset} and the {words} words from there on leave the mapped window of {length} bytes")]
    OutOfRange {
        /// The first word's offset.
        offset: HostOffset,
        /// Number of words requested.
        words: usize,
        /// The window's length in bytes.
        length: usize,
    },
}

/// Access of exact width to a board's DPRAM.
///
/// Every method that reads takes each word once, in ascending order, by one 16-bit access. None falls back to another
/// width, and none returns data that it did not read. Only [`Bus::read_data`] may take two words at once.
pub trait Bus: Send {
    /// The length of the window in bytes.
    fn length(&self) -> usize;

    /// The maximum width of a read of data.
    fn access(&self) -> Access {
        Access::Bits16
    }

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

    /// Reads `words.len()` consecutive words, ascending, each exactly once, and returns the number of bus accesses.
    /// Where the board takes 32 bits, two words in one aligned 32-bit location cost one access. Use it only for data
    /// that PMAC leaves alone meanwhile, never for a word of a handshake.
    ///
    /// # Errors
    /// [`BusError::OutOfRange`] when a word lies outside the window; nothing has been read then.
    fn read_data(&mut self, first: HostOffset, words: &mut [u16]) -> Result<usize, BusError> {
        self.read_block(first, words)?;
        Ok(words.len())
    }

    /// Reads before this call happen before any access after it.
    fn order_reads(&mut self);

    /// Writes before this call reach the board before writes after it.
    fn order_writes(&mut self);
}

/// Whether a board is there at all. The daemon asks about once a second; the question does not count as an access to
/// the board's words.
pub trait Presence {
    /// Whether the window still maps the board: a simulated board may have been replaced.
    fn still_there(&self) -> bool {
        true
    }

    /// Whether a device answers on the bus: without a board, every word reads as ones.
    fn answers(&mut self) -> bool {
        true
    }

    /// A replay's state; `None` for a board.
    fn replay(&self) -> Option<Replay> {
        None
    }
}

/// An open board: its words, and whether it is still there.
pub trait Board: Bus + Presence {}

impl<B: Bus + Presence> Board for B {}

impl Bus for Box<dyn Board> {
    fn length(&self) -> usize {
        (**self).length()
    }
    fn access(&self) -> Access {
        (**self).access()
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
    fn replay(&self) -> Option<Replay> {
        (**self).replay()
    }
}

/// Why a byte register cannot be reached.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ByteBusError {
    /// The register would lie outside the window.
    #[error("byte register {offset:#x} lies outside the window of {length:#x} bytes")]
    OutOfRange {
        /// The register's offset.
        offset: u32,
        /// The window's length in bytes.
        length: usize,
    },
    /// The kernel refused the access.
    #[error("byte register {offset:#x} cannot be reached: {source}")]
    Io {
        /// The register's offset.
        offset: u32,
        /// The kernel's error.
        source: std::io::Error,
    },
}

/// Access to byte registers, each by one 8-bit access.
pub trait ByteBus: Send {
    /// Reads the register `offset` bytes from the window's start.
    ///
    /// # Errors
    /// When it lies outside the window or cannot be reached.
    fn read8(&mut self, offset: u32) -> Result<u8, ByteBusError>;

    /// Writes the register `offset` bytes from the window's start.
    ///
    /// # Errors
    /// When it lies outside the window or cannot be reached.
    fn write8(&mut self, offset: u32, value: u8) -> Result<(), ByteBusError>;

    /// Orders all earlier accesses before all later ones.
    fn order_accesses(&mut self);
}

impl<B: ByteBus + ?Sized> ByteBus for Box<B> {
    fn read8(&mut self, offset: u32) -> Result<u8, ByteBusError> {
        (**self).read8(offset)
    }
    fn write8(&mut self, offset: u32, value: u8) -> Result<(), ByteBusError> {
        (**self).write8(offset, value)
    }
    fn order_accesses(&mut self) {
        (**self).order_accesses();
    }
}
