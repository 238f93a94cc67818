//! Words as the board held them to named values with units (layer 1).
//!
//! The daemon mirrors words and decodes nothing; whoever reads them, from the live segment, a raw dump or the board
//! itself, decodes them here. Values are scaled only where the scale is known; the raw integer is always kept.

pub mod background;
pub mod image;
pub mod quantity;
pub mod servo;
pub mod value;

pub use background::{
    AxisTargets, BackgroundData, BackgroundMotor, CoordinateSystem, Ports, background, background_selected,
};
pub use image::{Image, ImageError};
pub use quantity::{Flags, MotorScales, Quantity, Scales};
pub use servo::{ServoData, ServoMotor, servo, servo_selected};
pub use value::{Value, value};

use crate::format::{Float48Layout, fixed48, int24, join32};
use crate::map::{Region, Selection};

/// A slice with fewer words than the region's asked-for part has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the {region} region of {numbers} numbers takes {needed} words; only {got} are there")]
pub struct TooShort {
    /// The region's name.
    pub region: &'static str,
    /// How many motors or coordinate systems were asked for.
    pub numbers: usize,
    /// How many 16-bit words they take.
    pub needed: usize,
    /// How many words there are.
    pub got: usize,
}

/// Splits `words`, which start at the region's first word, into the registers of the board and `count` blocks.
fn split<const BLOCK: usize>(
    region: Region,
    words: &[u16],
    head: usize,
    count: usize,
) -> Result<(&[u16], &[[u16; BLOCK]]), TooShort> {
    let needed = head + BLOCK * count;
    let short = TooShort { region: region.name, numbers: count, needed, got: words.len() };
    let (head, blocks) = words.get(..needed).ok_or(short)?.split_at(head);
    Ok((head, blocks.as_chunks().0))
}

/// The 32-bit value of the location whose Y half is word `at`.
const fn long(words: &[u16], at: usize) -> u32 {
    join32(words[at], words[at + 1])
}

/// One number's words, and which of them were read: a register that was not has no value.
struct Block<'a, const WORDS: usize> {
    words: &'a [u16; WORDS],
    selection: Selection,
}

impl<const WORDS: usize> Block<'_, WORDS> {
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
