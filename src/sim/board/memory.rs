//! PMAC's own address space: 64K X and 64K Y words of 24 bits. $D000-$DFFF is the DPRAM, 16 bits a word.
//!
//! Registers live at their real addresses (Software Reference p. 399), so that `RX`, M-variables, data gathering and
//! the DPRAM reports all see the same thing.

use crate::format::{fixed48, float48, int24};
use crate::sim::board::dpram::Dpram;
use crate::sim::board::offsets;

const WORDS: usize = 0x1_0000;
const REGISTERS: usize = 0x1000;

/// X and Y memory with the DPRAM in its place.
pub struct Memory {
    x: Box<[u32]>,
    y: Box<[u32]>,
    /// The shared part.
    pub dpram: Dpram,
}

impl Memory {
    /// Memory that is zero but for what `dpram` holds.
    #[must_use]
    pub fn new(dpram: Dpram) -> Self {
        Self { x: vec![0; WORDS].into(), y: vec![0; WORDS].into(), dpram }
    }

    /// The 24-bit word at `X:address`. A DPRAM location gives its 16 bits; the upper eight are not stored.
    #[inline]
    #[must_use]
    pub fn read_x(&self, address: u16) -> u32 {
        match host_offset(address) {
            Some(offset) => u32::from(self.dpram.read16(offset + 2)),
            None => self.x[usize::from(address)],
        }
    }

    /// The 24-bit word at `Y:address`. A DPRAM location gives its 16 bits; the upper eight are not stored.
    #[inline]
    #[must_use]
    pub fn read_y(&self, address: u16) -> u32 {
        match host_offset(address) {
            Some(offset) => u32::from(self.dpram.read16(offset)),
            None => self.y[usize::from(address)],
        }
    }

    /// Writes the low 24 bits of `value` to `X:address` (16 bits in the DPRAM).
    #[inline]
    pub fn write_x(&mut self, address: u16, value: u32) {
        match host_offset(address) {
            Some(offset) => self.dpram.write16(offset + 2, value as u16),
            None => self.x[usize::from(address)] = value & int24::MASK,
        }
    }

    /// Writes the low 24 bits of `value` to `Y:address` (16 bits in the DPRAM).
    #[inline]
    pub fn write_y(&mut self, address: u16, value: u32) {
        match host_offset(address) {
            Some(offset) => self.dpram.write16(offset, value as u16),
            None => self.y[usize::from(address)] = value & int24::MASK,
        }
    }

    /// The 48-bit fixed-point register `D:address`.
    #[must_use]
    pub fn read_d(&self, address: u16) -> i64 {
        fixed48::decode(self.read_y(address), self.read_x(address))
    }

    /// Writes the low 48 bits of `value` to `D:address`.
    #[inline]
    pub fn write_d(&mut self, address: u16, value: i64) {
        let [y, x] = fixed48::encode(value);
        self.write_y(address, y);
        self.write_x(address, x);
    }

    /// The 48-bit floating-point register `L:address`.
    #[must_use]
    pub fn read_l(&self, address: u16) -> f64 {
        float48::decode(self.read_y(address), self.read_x(address))
    }

    /// Writes `value` to the floating-point register `L:address`.
    pub fn write_l(&mut self, address: u16, value: f64) {
        let [y, x] = float48::encode(value);
        self.write_y(address, y);
        self.write_x(address, x);
    }

    /// Clears the registers of motors and coordinate systems, $0000-$0FFF; variables and buffers lie above.
    pub fn clear_registers(&mut self) {
        self.x[..REGISTERS].fill(0);
        self.y[..REGISTERS].fill(0);
    }

    /// Clears everything but the DPRAM.
    pub fn clear(&mut self) {
        self.x.fill(0);
        self.y.fill(0);
    }
}

/// The host offset of the Y half when `address` lies in the DPRAM.
#[inline]
fn host_offset(address: u16) -> Option<u16> {
    (offsets::BASE..=offsets::LAST).contains(&address).then(|| 4 * (address - offsets::BASE))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dpram_locations_are_redirected_and_keep_sixteen_bits() {
        let directory = tempfile::tempdir().unwrap();
        let mut memory = Memory::new(Dpram::open(&directory.path().join("dpram")).unwrap());
        memory.write_x(0xD200, 0xABCDEF);
        memory.write_y(0xDFFF, 0x123456);
        memory.write_x(0xCFFF, 0xABCDEF);
        memory.write_y(0xE000, 0xFF12_3456);
        assert_eq!(memory.dpram.read16(0x0802), 0xCDEF);
        assert_eq!(memory.dpram.read16(0x3FFC), 0x3456);
        assert_eq!(memory.read_x(0xD200), 0xCDEF);
        assert_eq!(memory.read_x(0xCFFF), 0xABCDEF);
        assert_eq!(memory.read_y(0xE000), 0x123456);
    }

    #[test]
    fn long_registers_keep_their_value() {
        let directory = tempfile::tempdir().unwrap();
        let mut memory = Memory::new(Dpram::open(&directory.path().join("dpram")).unwrap());
        memory.write_d(0x28, -3072);
        memory.write_l(0x081F, -3.25);
        assert_eq!(memory.read_d(0x28), -3072);
        assert_eq!(memory.read_x(0x28), 0xFFFFFF);
        assert_eq!(memory.read_l(0x081F), -3.25);
    }
}
