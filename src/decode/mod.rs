//! Converts the board's words to named values with units (layer 1).
//!
//! The daemon mirrors words and decodes none; a reader of the live segment, a raw dump or the board itself decodes
//! them here. This module scales a value only if it knows the scale, and always keeps the raw integer.

pub mod background;
pub mod buffers;
pub mod image;
pub mod quantity;
pub mod servo;
pub mod turbo_system;
pub mod user;
pub mod value;

pub use background::{
    AxisTargets, BackgroundData, BackgroundDecoder, BackgroundMotor, CoordinateSystem, PmacSystem, Ports,
    background,
};
pub use buffers::Buffers;
pub use image::{Image, ImageError};
pub use quantity::{Flags, MotorScales, Quantity, Scales};
pub use servo::{ServoData, ServoDecoder, ServoMotor, servo};
pub use turbo_system::TurboSystem;
pub use value::{Value, value};

use crate::format::{Float48Layout, fixed48, int24, join32};
use crate::map::{Blocks, Region, Selection, StatusTable};

/// A slice with fewer words than the requested part of the region.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the {region} region of {numbers} numbers takes {needed} words; only {got} are there")]
pub struct TooShort {
    /// The region's name.
    pub region: &'static str,
    /// How many motors or coordinate systems the caller asked for.
    pub numbers: usize,
    /// How many 16-bit words they take.
    pub needed: usize,
    /// How many words the slice has.
    pub got: usize,
}

/// Splits `words`, which start at the first word of `region`, into the registers of the board and those of `selection`
/// among the first `count` blocks, each with its number.
fn blocks<'a>(
    region: Region,
    places: &Blocks,
    words: &'a [u16],
    count: usize,
    selection: Selection,
) -> Result<(&'a [u16], impl Iterator<Item = (usize, Block<'a>)> + Clone), TooShort> {
    let count = selection.last_number(count.min(places.count));
    let needed = places.words_from(region.start, count);
    let short = TooShort { region: region.name, numbers: count, needed, got: words.len() };
    let (head, blocks) = words.get(..needed).ok_or(short)?.split_at(places.words_from(region.start, 0));
    let blocks = (1..).zip(blocks.chunks_exact(places.words.max(1)));
    let blocks = blocks.filter(move |(number, _)| selection.has_number(*number));
    Ok((head, blocks.map(move |(number, words)| (number, Block { words, selection }))))
}

/// The 32-bit value of the location whose Y half is word `at`.
const fn long(words: &[u16], at: usize) -> u32 {
    join32(words[at], words[at + 1])
}

/// A status word with the meaning of its bits, if the daemon read the word.
fn flags(word: Option<u32>, table: Option<&'static StatusTable>) -> Option<Flags> {
    Some(Flags { word: word?, table: table? })
}

/// The words of `???` with the meaning of their bits.
fn global_flags([first, second]: [u32; 2], tables: &'static [StatusTable]) -> Option<[Flags; 2]> {
    Some([flags(Some(first), tables.first())?, flags(Some(second), tables.get(1))?])
}

/// One number's words, and which of them the daemon read: an unread register has no value.
struct Block<'a> {
    words: &'a [u16],
    selection: Selection,
}

impl Block<'_> {
    fn long(&self, at: usize) -> Option<u32> {
        self.selection.has_words(at, 2).then(|| long(self.words, at))
    }

    /// The two 32-bit values of a 48-bit register, low one first.
    fn pair(&self, at: usize) -> Option<(u32, u32)> {
        Some((self.long(at)?, self.long(at + 2)?))
    }

    fn signed(&self, at: usize) -> Option<i32> {
        self.long(at).map(int24::signed)
    }

    fn unsigned(&self, at: usize) -> Option<u32> {
        self.long(at).map(int24::unsigned)
    }

    fn fixed(&self, at: usize) -> Option<i64> {
        self.pair(at).map(|(low, high)| fixed48::decode(low, high))
    }

    fn float(&self, at: usize, layout: Float48Layout) -> Option<f64> {
        self.pair(at).map(|(low, high)| layout.decode(low, high))
    }
}
