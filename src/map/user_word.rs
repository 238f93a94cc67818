//! Words of the DPRAM that the site's own programs write, under the names of the configuration.

use super::{BitField, HostOffset, Space, TypedAddress};
use crate::format::Text;

/// Room for a word's name, in bytes.
pub const USER_NAME_BYTES: usize = 32;
/// Room for the name of a word's unit, in bytes.
pub const USER_UNIT_BYTES: usize = 16;
/// Most words that have a name.
pub const USER_WORDS: usize = 64;
/// 16-bit words of all values together at most: no more than a servo report of eight motors takes.
pub const USER_DATA_WORDS: usize = 256;

/// A value, or several of one kind in a row, with one name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UserWord {
    /// Its name.
    pub name: Text<USER_NAME_BYTES>,
    /// The unit of its values; empty without one.
    pub unit: Text<USER_UNIT_BYTES>,
    /// The first value's place.
    pub location: TypedAddress,
    /// The bits of a value, unless a value has all bits.
    pub bits: Option<BitField>,
    /// Whether the highest of these bits is the sign.
    pub signed: bool,
    /// How many values. Each is one PMAC address (with `D` and `L` two) behind the value before.
    pub count: usize,
    /// The guard: the site's program makes this word odd before it writes the values, and even afterwards.
    pub guard: Option<HostOffset>,
}

impl UserWord {
    /// 16-bit words of all values.
    #[must_use]
    pub const fn words(&self) -> usize {
        self.location.space.words() * self.count
    }

    /// The place of value `index`. A PMAC address has two 16-bit words; X and Y are one of them each.
    #[must_use]
    pub const fn place(&self, index: usize) -> HostOffset {
        let step = match self.location.space {
            Space::Y | Space::X => 2,
            space => space.words(),
        };
        self.location.offset.plus_words(index * step)
    }
}
