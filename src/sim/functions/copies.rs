//! The words that a report copies, and their places, by the family's register table.

use crate::format::int24;
use crate::map::{Family, HostOffset, PmacAddress, SourceAt, Space, Width};
use crate::sim::board::memory::Memory;

/// A 24-bit word that is copied into a long of the DPRAM.
#[derive(Debug, Clone, Copy)]
pub struct CopiedWord {
    /// The word's source: A, B and C of axis positions; three times the same address for other words.
    sources: [PmacAddress; 3],
    /// The word's place in the DPRAM.
    offset: HostOffset,
}

impl CopiedWord {
    /// Whether this is a copy of the first word of `register`.
    #[must_use]
    pub fn is_of(&self, register: PmacAddress) -> bool {
        self.sources[0] == halves(register)[0]
    }

    /// The word's place in the DPRAM.
    #[must_use]
    pub fn offset(&self) -> HostOffset {
        self.offset
    }

    /// The word at present; `choice` 0 to 2 is the source A to C of axis positions.
    #[inline]
    #[must_use]
    pub fn read(&self, choice: usize, memory: &Memory) -> u32 {
        memory.read(self.sources[choice])
    }

    /// Writes `word` to its place, sign-extended to a long.
    #[inline]
    pub fn write(&self, word: u32, memory: &mut Memory) {
        memory.dpram.write32(self.offset, int24::extend(word));
    }
}

/// The words that a report copies.
#[derive(Debug, Clone, Default)]
pub struct Copies {
    /// Words of the board.
    pub board: Vec<CopiedWord>,
    /// Words of each motor or coordinate system.
    pub numbers: Vec<Vec<CopiedWord>>,
}

impl Copies {
    /// The longs of `function` that the family's register table says to be copies.
    #[must_use]
    pub fn new(family: &Family, function: &str) -> Self {
        let mut copies = Self::default();
        for block in family.blocks {
            let rows = block.registers.iter().filter(|row| row.function == function);
            for row in rows.filter(|row| row.width != Width::Word) {
                for number in 1..=block.count.max(1) {
                    let step = (number - 1) * block.stride as usize / 2;
                    let sources = match family.source(row.source, number) {
                        SourceAt::None => continue,
                        SourceAt::One(source) => [source; 3],
                        SourceAt::Choice(sources) => sources,
                    };
                    let list = if block.count == 0 {
                        &mut copies.board
                    } else {
                        copies.numbers.resize(copies.numbers.len().max(block.count), Vec::new());
                        &mut copies.numbers[number - 1]
                    };
                    // A long register that has one long in the report gives its X half, as the filtered velocity does.
                    let copied = if row.width == Width::Pair { 0..2 } else { 1..2 };
                    list.extend(copied.enumerate().map(|(place, half)| CopiedWord {
                        sources: sources.map(|source| halves(source)[half]),
                        offset: row.offset.plus_words(step + 2 * place),
                    }));
                }
            }
        }
        copies
    }
}

/// The words of a register: the Y and the X half of a long register, twice the one word of another register.
fn halves(register: PmacAddress) -> [PmacAddress; 2] {
    match register.space {
        Space::X | Space::Y => [register; 2],
        _ => [Space::Y, Space::X].map(|space| PmacAddress::new(space, register.number)),
    }
}

/// The place of row `name` of `function` for the 0-based `index`, if no manual names a board register as the row's
/// source.
#[must_use]
pub fn calculated(family: &Family, function: &str, name: &str, index: usize) -> Option<HostOffset> {
    let mut rows = family.blocks.iter().flat_map(|block| block.registers);
    let row_of = rows.find(|row| row.function == function && row.name == name)?;
    let is_copied = !matches!(family.source(row_of.source, index + 1), SourceAt::None);
    if is_copied { None } else { row(family, function, name, index) }
}

/// The place of row `name` of `function` for the 0-based motor or coordinate system `index`; `None` for a row that the
/// family does not have.
#[must_use]
pub fn row(family: &Family, function: &str, name: &str, index: usize) -> Option<HostOffset> {
    family.blocks.iter().find_map(|block| {
        let row = block.registers.iter().find(|row| row.function == function && row.name == name)?;
        Some(row.offset.plus_words(index * block.stride as usize / 2))
    })
}
