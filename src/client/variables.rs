//! Registers of the user's choice, as PMAC copies them in the background: the segment's variable region.
//!
//! The region's payload is described in [`crate::mirror::variable`]. Who wants a register to be copied holds a
//! [`VariableWatch`] open; whoever can read the segment sees the values of every register that somebody watches.

use std::time::Duration;

use super::board::{Board, ClientError};
use super::view::View;
use super::{CommandError, Connection, VariableWatch};
use crate::decode::TooShort;
use crate::format::join32;
use crate::segment::{RegionId, WaitOutcome};
use crate::setup::gather_source::GatherSource;

/// 16-bit words before the entries, and of an entry.
const HEADER_WORDS: usize = 4;
const ENTRY_WORDS: usize = 8;

/// What an entry's second word says it is, in the terms of the variable-read table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum VariableWidth {
    /// A Y word, 24 bits.
    Y,
    /// An X word, 24 bits.
    X,
    /// Both words, 48 bits; fixed or floating point is for the reader to know.
    Long,
    /// The value of a function block of a compiled PLC, whose number the address is.
    Special,
}

impl VariableWidth {
    fn of(code: u16) -> Option<Self> {
        Some(match code {
            0 => Self::Y,
            1 => Self::Long,
            2 => Self::X,
            4 => Self::Special,
            _ => return None,
        })
    }

    /// How `register` is copied.
    #[must_use]
    pub fn for_register(register: GatherSource) -> Self {
        use crate::map::Space;
        match register.address().space {
            Space::Y => Self::Y,
            Space::X => Self::X,
            _ => Self::Long,
        }
    }

    /// Longs of its value.
    #[must_use]
    pub const fn longs(self) -> usize {
        match self {
            Self::Y | Self::X => 1,
            Self::Long | Self::Special => 2,
        }
    }
}

/// One entry of the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Variable {
    /// The register's PMAC address.
    pub address: u16,
    /// What lies there.
    pub width: VariableWidth,
    /// How many values were taken since the table was set up (modulo 2^32); 0: none yet.
    pub updates: u32,
    /// The value as the board held it: one long of a word, two of the others, the Y half first.
    pub longs: [u32; 2],
}

impl Variable {
    /// The longs that its width has.
    #[must_use]
    pub fn value(&self) -> &[u32] {
        self.longs.get(..self.width.longs()).unwrap_or(&[])
    }
}

/// What PMAC copies at present, and the values. All are of one background pass of the board.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VariableTable {
    /// Another number when the table is another.
    pub number: u32,
    /// The entries; those of a kind that is not known here are left out.
    pub variables: Vec<Variable>,
}

impl VariableTable {
    /// Reads a payload.
    ///
    /// # Errors
    /// [`TooShort`] when it ends before its last entry does.
    pub fn decode(words: &[u16]) -> Result<Self, TooShort> {
        let &[low, high, count_low, count_high, ..] = words else {
            return Err(too_short(0, HEADER_WORDS, words));
        };
        let count = usize::try_from(join32(count_low, count_high)).unwrap_or(usize::MAX);
        let needed = HEADER_WORDS.saturating_add(count.saturating_mul(ENTRY_WORDS));
        if words.len() < needed {
            return Err(too_short(count, needed, words));
        }
        let entries = words[HEADER_WORDS..needed].as_chunks::<ENTRY_WORDS>().0;
        let variables = entries.iter().filter_map(|&[address, kind, low, high, a, b, c, d]| {
            let longs = [join32(a, b), join32(c, d)];
            Some(Variable { address, width: VariableWidth::of(kind)?, updates: join32(low, high), longs })
        });
        Ok(Self { number: join32(low, high), variables: variables.collect() })
    }

    /// The value of `register`, when it is in the table and has one.
    #[must_use]
    pub fn value_of(&self, register: GatherSource) -> Option<&Variable> {
        let width = VariableWidth::for_register(register);
        let is_it = |variable: &&Variable| {
            u32::from(variable.address) == register.address().number && variable.width == width
        };
        self.variables.iter().find(is_it).filter(|variable| variable.updates > 0)
    }
}

fn too_short(numbers: usize, needed: usize, words: &[u16]) -> TooShort {
    TooShort { region: RegionId::Variable.name(), numbers, needed, got: words.len() }
}

impl Board {
    /// The registers that PMAC copies for whoever watches some, and their values; `None` before the first.
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn variables(&mut self) -> Result<Option<View<VariableTable>>, ClientError> {
        self.refresh()?;
        match self.latest(RegionId::Variable)? {
            Some(()) => self.view(RegionId::Variable, |words, _| VariableTable::decode(words)).map(Some),
            None => Ok(None),
        }
    }

    /// Sleeps until there are variables newer than number `after`, at most `timeout`; false when there are none.
    ///
    /// # Errors
    /// [`ClientError::Segment`].
    pub fn wait_variables(&mut self, after: u64, timeout: Duration) -> Result<bool, ClientError> {
        self.refresh()?;
        let outcome = self.subscriber().wait_newer(RegionId::Variable, after, timeout)?;
        Ok(outcome == WaitOutcome::Newer)
    }

    /// Has PMAC copy `registers` in the background until what this returns is dropped; their values come in
    /// [`Board::variables`]. Uses a connection of its own.
    ///
    /// # Errors
    /// [`CommandError`]; refused when none of PMAC's 128 entries is left, or I55 is not 1.
    pub fn watch_variables(&self, registers: &[GatherSource]) -> Result<VariableWatch, CommandError> {
        Connection::open(self.socket())?.watch_variables(registers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn register(text: &str) -> GatherSource {
        text.parse().unwrap()
    }

    #[test]
    fn a_payload_is_read_as_its_page_says() {
        let words = [
            7, 1, 3, 0, // table 0x10007, 3 entries
            0x28, 2, 5, 0, 0xFFFE, 0xFFFF, 0, 0, // X:$0028 = -2
            0x2B, 1, 5, 0, 1, 0, 2, 0, // D:$002B
            0x2C, 0, 0, 0, 0, 0, 0, 0, // Y:$002C, no value yet
        ];
        let table = VariableTable::decode(&words).unwrap();
        assert_eq!((table.number, table.variables.len()), (0x10007, 3));
        assert_eq!(table.value_of(register("X:$0028")).unwrap().value(), [0xFFFF_FFFE]);
        assert_eq!(table.value_of(register("L:$002B")).unwrap().value(), [1, 2]);
        assert_eq!(table.value_of(register("Y:$002C")), None, "no value yet");
        assert_eq!(table.value_of(register("Y:$0028")), None, "the other half");
        assert!(VariableTable::decode(&words[..27]).is_err());
        assert!(VariableTable::decode(&words[..3]).is_err());
        assert!(VariableTable::decode(&[0, 0, 0xFFFF, 0xFFFF]).is_err());
        assert_eq!(VariableTable::decode(&[0; 4]).unwrap().variables, []);
    }
}
