//! The tables of the background variable functions: their places, and the form of an entry and a record.

use super::Flag;
use crate::map::HostOffset;

/// A register's kind in an entry of the variable tables. This is not a [`Space`](crate::map::Space): the tables do not
/// tell `D:` from `L:`, and also take function blocks, which are no registers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum VariableKind {
    /// A Y word: 24 bits, sign-extended to a long.
    Y,
    /// An X word: 24 bits, sign-extended to a long.
    X,
    /// X and Y, fixed or floating point: two longs, Y half first.
    Long,
    /// A function block of a compiled PLC, firmware 1.16: two longs. The address is the block's number.
    Special,
}

impl VariableKind {
    /// Its code: in the table (see [`VariableRead::kind_word`]) and in the segment.
    #[must_use]
    pub const fn code(self) -> u16 {
        match self {
            Self::Y => 0,
            Self::Long => 1,
            Self::X => 2,
            Self::Special => 4,
        }
    }

    /// The kind with this code.
    #[must_use]
    pub const fn of_code(code: u16) -> Option<Self> {
        match code {
            0 => Some(Self::Y),
            1 => Some(Self::Long),
            2 => Some(Self::X),
            4 => Some(Self::Special),
            _ => None,
        }
    }

    /// 16-bit words of its value in the DPRAM.
    #[must_use]
    pub const fn words(self) -> usize {
        match self {
            Self::Y | Self::X => 2,
            Self::Long | Self::Special => 4,
        }
    }
}

/// Background variable read: registers of the host's choice.
#[derive(Debug, PartialEq, Eq)]
pub struct VariableRead {
    /// In the control word, single-user mode: PMAC sets it after an update, the host clears it to ask for another.
    pub ready: Flag,
    /// In the control word: every entry has its own ready bit.
    pub multi_user: Flag,
    /// The low 16 bits of the servo counter at the update.
    pub timer: HostOffset,
    /// Entries to read; 0 stops the function.
    pub count: HostOffset,
    /// The table's place, by the [`StartRule`](super::StartRule).
    pub start: HostOffset,
    /// The lowest bit of the kind in an entry's X word; the Y word is the address.
    pub kind_bit: u32,
}

impl VariableRead {
    /// The host can read registers below this address: known texts give 16 bits of the entry to the address.
    pub const ADDRESSES: u32 = 1 << 16;

    /// The host's bits of the X word of an entry of this kind.
    #[must_use]
    pub const fn kind_word(&self, kind: VariableKind) -> u16 {
        kind.code() << self.kind_bit
    }

    /// The host's bits of an X word. The bits below the kind, a Turbo board's higher address bits (Turbo User Manual p.
    /// 410), are 0.
    #[must_use]
    pub const fn of_host(&self, word: u16) -> u16 {
        word & ((0b1000 << self.kind_bit) - 1)
    }

    /// The kind's code in an X word; if the bits below it are set, a code of no kind.
    #[must_use]
    pub const fn kind_code(&self, word: u16) -> u16 {
        self.of_host(word).rotate_right(self.kind_bit)
    }
}

/// Entries of a variable-read table at most, in every family.
pub const VARIABLE_READ_ENTRIES: usize = 128;
/// 16-bit words of an entry.
pub const VARIABLE_READ_ENTRY_WORDS: usize = 2;
/// In an entry's X word, in multi-user mode: PMAC sets it after an update, the host clears it to ask for another.
pub const VARIABLE_READ_ENTRY_READY: u16 = 1 << 15;

/// Background variable write.
#[derive(Debug, PartialEq, Eq)]
pub struct VariableWrite {
    /// Records to write. The host sets it; PMAC writes 0 after the writes.
    pub count: HostOffset,
    /// Where the records lie, by the [`StartRule`](super::StartRule).
    pub start: HostOffset,
    /// The first firmware with the function as a text describes it; `None` without a text: the host writes nothing.
    pub since: Option<&'static str>,
}

/// Records of a variable-write table at most, in every family.
pub const VARIABLE_WRITE_RECORDS: usize = 32;
/// 16-bit words of a record.
pub const VARIABLE_WRITE_RECORD_WORDS: usize = 6;
/// The lowest bit of the width in a record's type word: below is the kind (DPRAM manual p. 24).
pub const RECORD_WIDTH: u32 = 3;
/// The lowest bit of the offset in a record's type word.
pub const RECORD_OFFSET: u32 = 8;
/// The lowest bit of the sort of special register in a record's type word.
pub const RECORD_SPECIAL: u32 = 13;
