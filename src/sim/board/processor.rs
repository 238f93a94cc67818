//! The processor and memory of a Turbo board, by its option: `5C0` to `5F3`.

use crate::map::{CPU_OPTIONS, Generation};
use crate::sim::board::Board;

/// The processor and memory of an option.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Processor {
    /// The option's name.
    pub option: &'static str,
    /// `CPU`.
    pub text: &'static str,
    /// Its two bits in `???`.
    pub kind: u32,
    extended: bool,
}

const fn standard(option: &'static str, text: &'static str, kind: u32) -> Processor {
    Processor { option, text, kind, extended: false }
}

const fn extended(option: &'static str, text: &'static str, kind: u32) -> Processor {
    Processor { option, text, kind, extended: true }
}

/// All processors, with standard and with extended memory.
pub const PROCESSORS: [Processor; 8] = [
    standard(CPU_OPTIONS[0], "DSP56303", 0b00),
    extended(CPU_OPTIONS[1], "DSP56303", 0b00),
    standard(CPU_OPTIONS[2], "DSP56309", 0b01),
    extended(CPU_OPTIONS[3], "DSP56309", 0b01),
    standard(CPU_OPTIONS[4], "DSP56311", 0b10),
    extended(CPU_OPTIONS[5], "DSP56311", 0b10),
    standard(CPU_OPTIONS[6], "DSP56321", 0b11),
    extended(CPU_OPTIONS[7], "DSP56321", 0b11),
];

impl Default for Processor {
    fn default() -> Self {
        PROCESSORS[0]
    }
}

/// The variable of a Turbo board that tells the end of its open memory.
const END: usize = 4908;
const STANDARD_END: usize = 0x1_0800;
const EXTENDED_END: usize = 0x4_0000;
/// The user buffer that extended memory has from the factory, from firmware 1.937 on.
const FACTORY_BUFFER: usize = 0x1_0000;

impl Board {
    /// Fills I4908 with the end of memory that a user buffer of `user_buffer` words leaves; without a buffer, with the
    /// factory's counts (Turbo Software Reference p. 164).
    pub fn note_end_of_memory(&mut self, user_buffer: Option<usize>) {
        if self.family().generation != Generation::Turbo {
            return;
        }
        let extended = self.identity.processor.extended;
        let factory = if extended && !self.is_older_than("1.937") { FACTORY_BUFFER } else { 0 };
        let end = if extended { EXTENDED_END } else { STANDARD_END };
        self.variables.set_i(END, end.saturating_sub(user_buffer.unwrap_or(factory)) as f64);
    }
}
