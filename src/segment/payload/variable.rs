//! The variable region: registers of the users' choice, copied by PMAC in the background. `docs/segment.md` has the
//! table of its payload.

use crate::format::{join32, split32};
use crate::map::{VariableKind, VariableName};

/// 16-bit words before the entries.
const HEADER_WORDS: usize = 4;
/// 16-bit words of an entry.
const ENTRY_WORDS: usize = 8;
/// The address bits in the entry's first word.
const LOW_ADDRESS_BITS: u32 = 16;
/// Where the remaining address bits begin in the entry's second word.
const HIGH_ADDRESS_SHIFT: u32 = 8;
/// The remaining address bits.
const HIGH_ADDRESS_MASK: u16 = 0b111;

/// 16-bit words of a payload with `entries` entries.
#[must_use]
pub const fn payload_words(entries: usize) -> usize {
    HEADER_WORDS.saturating_add(entries.saturating_mul(ENTRY_WORDS))
}

/// One entry of the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Variable {
    /// The register's PMAC address, up to 19 bits; a function block's number.
    pub address: u32,
    /// The kind of register.
    pub kind: VariableKind,
    /// How many values the daemon has read since it set up the table (modulo 2^32); 0: none yet.
    pub updates: u32,
    /// The value unchanged: one long for a word, two for the other kinds, the Y half first.
    pub longs: [u32; 2],
}

impl Variable {
    /// The longs that this kind has.
    #[must_use]
    pub fn value(&self) -> &[u32] {
        self.longs.get(..self.kind.words() / 2).unwrap_or(&[])
    }

    fn encode(self) -> [u16; ENTRY_WORDS] {
        let high = (self.address >> LOW_ADDRESS_BITS) as u16 & HIGH_ADDRESS_MASK;
        let [updates_low, updates_high] = split32(self.updates);
        let [[a, b], [c, d]] = self.longs.map(split32);
        [
            self.address as u16,
            self.kind.code() | high << HIGH_ADDRESS_SHIFT,
            updates_low,
            updates_high,
            a,
            b,
            c,
            d,
        ]
    }

    /// `None` for an unknown kind.
    fn decode([address, kind, updates_low, updates_high, a, b, c, d]: [u16; ENTRY_WORDS]) -> Option<Self> {
        let high = kind >> HIGH_ADDRESS_SHIFT & HIGH_ADDRESS_MASK;
        Some(Self {
            address: u32::from(address) | u32::from(high) << LOW_ADDRESS_BITS,
            kind: VariableKind::of_code(kind & 0x00FF)?,
            updates: join32(updates_low, updates_high),
            longs: [join32(a, b), join32(c, d)],
        })
    }
}

/// The registers that PMAC copies at present, and their values, all from one background pass.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VariableTable {
    /// Number of the table; changes with each new one.
    pub number: u32,
    /// The entries, without those of an unknown kind.
    pub variables: Vec<Variable>,
}

/// Writes the payload of table `number` to `payload` and returns its length in words. Leaves out entries that do not
/// fit. Allocates nothing.
pub fn encode(number: u32, variables: impl Iterator<Item = Variable>, payload: &mut [u16]) -> usize {
    let Some((header, rest)) = payload.split_first_chunk_mut::<HEADER_WORDS>() else { return 0 };
    let mut count = 0;
    for (entry, variable) in rest.as_chunks_mut::<ENTRY_WORDS>().0.iter_mut().zip(variables) {
        *entry = variable.encode();
        count += 1;
    }
    let [[a, b], [c, d]] = [number, count].map(split32);
    *header = [a, b, c, d];
    payload_words(count as usize)
}

impl VariableTable {
    /// Decodes a payload; `None` when it ends before its last entry.
    #[must_use]
    pub fn decode(words: &[u16]) -> Option<Self> {
        let (&[low, high, count_low, count_high], _) = words.split_first_chunk::<HEADER_WORDS>()?;
        let count = usize::try_from(join32(count_low, count_high)).ok()?;
        let entries = words.get(HEADER_WORDS..payload_words(count))?.as_chunks::<ENTRY_WORDS>().0;
        let variables = entries.iter().filter_map(|entry| Variable::decode(*entry)).collect();
        Some(Self { number: join32(low, high), variables })
    }

    /// Whether this is table `number` or a later table. Numbers wrap after 2^32 tables.
    #[must_use]
    pub const fn has_come_to(&self, number: u32) -> bool {
        self.number.wrapping_sub(number).cast_signed() >= 0
    }

    /// The value of a register or function block; `None` if the table lacks it or has no value yet.
    #[must_use]
    pub fn value_of(&self, name: impl Into<VariableName>) -> Option<&Variable> {
        let name = name.into();
        let wanted = (name.address(), name.kind());
        let is_it = |variable: &&Variable| (variable.address, variable.kind) == wanted;
        self.variables.iter().find(is_it).filter(|variable| variable.updates > 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn register(text: &str) -> VariableName {
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
        assert_eq!(table.value_of(register("X:$28")).unwrap().value(), [0xFFFF_FFFE]);
        assert_eq!(table.value_of(register("L:$2B")).unwrap().value(), [1, 2]);
        assert_eq!(table.value_of(register("Y:$2C")), None, "no value yet");
        assert_eq!(table.value_of(register("Y:$28")), None, "the other half");
        assert_eq!(VariableTable::decode(&words[..27]), None);
        assert_eq!(VariableTable::decode(&words[..3]), None);
        assert_eq!(VariableTable::decode(&[0, 0, 0xFFFF, 0xFFFF]), None);
        assert_eq!(VariableTable::decode(&[0; 4]).unwrap().variables, []);
    }

    #[test]
    fn a_table_is_known_by_its_number_even_when_numbers_begin_again() {
        let table = |number| VariableTable { number, variables: Vec::new() };
        assert!(table(7).has_come_to(7) && table(8).has_come_to(7) && !table(6).has_come_to(7));
        assert!(table(1).has_come_to(u32::MAX) && !table(u32::MAX).has_come_to(1));
    }

    #[test]
    fn an_address_of_19_bits_is_kept() {
        let far = Variable {
            address: 0x7_8123,
            kind: VariableKind::Special,
            updates: 1 << 31,
            longs: [1, u32::MAX],
        };
        let mut payload = [0; payload_words(1)];
        assert_eq!(encode(9, [far].into_iter(), &mut payload), 12);
        assert_eq!(payload[4..6], [0x8123, 0x0704]);
        assert_eq!(VariableTable::decode(&payload), Some(VariableTable { number: 9, variables: vec![far] }));
        payload[5] = 3;
        assert_eq!(VariableTable::decode(&payload).unwrap().variables, [], "a kind that is not known");
    }

    #[test]
    fn what_has_no_room_is_left_out() {
        let one = Variable { address: 1, kind: VariableKind::Y, updates: 0, longs: [0; 2] };
        let mut payload = [0; payload_words(2) - 1];
        assert_eq!(encode(1, [one, one].into_iter(), &mut payload), payload_words(1));
        assert_eq!(VariableTable::decode(&payload).unwrap().variables, [one]);
        assert_eq!(encode(1, [one].into_iter(), &mut [0; 3]), 0);
    }
}
