//! M-variables and their definitions. The definitions are in memory: a program that writes there points the variable
//! elsewhere.
//!
//! PMAC keeps 24 bits a definition, 16 of them the address (User Manual p. 154). Turbo keeps the address in the Y word and the rest
//! in the X word (Turbo User Manual p. 246).

use crate::map::Space;
use crate::sim::board::m_definition::MDefinition;
use crate::sim::board::memory::Memory;
use crate::sim::board::number::quantised;
use crate::sim::board::variables::Variables;

/// The bits that a variable without a definition has for its value.
const OWN_VALUE: u32 = 0xF_FFFF;

impl Variables {
    /// The definition of M-variable `number`.
    #[must_use]
    pub fn m_definition(&self, memory: &Memory, number: usize) -> MDefinition {
        let register = self.m_register(number);
        let y = memory.read_y(register);
        let (code, address) = match self.tables().m_address.space {
            Space::L => (memory.read_x(register), y),
            _ => (y >> 16, y & 0xFFFF),
        };
        match self.thumbwheels.get(&number) {
            Some(thumbwheel) if thumbwheel.to_code() == Some((code, address)) => thumbwheel.clone(),
            _ => MDefinition::from_code(code, address),
        }
    }

    /// Points M-variable `number` elsewhere; `false` when no word can hold the definition.
    pub fn define_m(&mut self, memory: &mut Memory, number: usize, definition: &MDefinition) -> bool {
        let Some((code, address)) = definition.to_code() else { return false };
        let register = self.m_register(number);
        match self.tables().m_address.space {
            Space::L => {
                memory.write_y(register, address);
                memory.write_x(register, code);
            }
            _ => memory.write_y(register, code << 16 | address),
        }
        if matches!(definition, MDefinition::Thumbwheel { .. }) {
            self.thumbwheels.insert(number, definition.clone());
        }
        true
    }

    /// M-variable `number`: the value at the address of its definition, or bits of the definition's own word without
    /// one.
    #[must_use]
    pub fn m(&self, memory: &Memory, number: usize) -> f64 {
        let own = || f64::from(memory.read_y(self.m_register(number)) & OWN_VALUE);
        self.m_definition(memory, number).read(memory).unwrap_or_else(own)
    }

    /// Sets M-variable `number`, and returns the address that it points to. An integer register takes the rounded value
    /// modulo its width.
    pub fn set_m(&self, memory: &mut Memory, number: usize, value: f64) -> Option<u32> {
        let value = quantised(value);
        let definition = self.m_definition(memory, number);
        if !definition.write(memory, value) {
            memory.write_y(self.m_register(number), value.round_ties_even() as i64 as u32 & OWN_VALUE);
        }
        definition.address()
    }

    fn m_register(&self, number: usize) -> u32 {
        self.tables().m_address.number + (number % self.tables().variables) as u32
    }
}
