//! PMAC's own address space: X and Y words of 24 bits, as many as the family's addresses have bits for. The DPRAM lies
//! at the family's base, 16 bits a word.
//!
//! Registers live at their real addresses (Software Reference p. 399), so that `RX`, M-variables, data gathering and
//! the DPRAM reports all see the same values.

use crate::format::{fixed48, float48, int24};
use crate::map::{HostOffset, PmacAddress, Space};
use crate::sim::board::dpram::Dpram;
use crate::sim::board::firmware::FirmwareTables;
use crate::sim::board::register_table::RegisterTable;

/// X and Y memory with the DPRAM in its place.
pub struct Memory {
    x: Box<[u32]>,
    y: Box<[u32]>,
    /// The bits of an address; the board ignores higher bits.
    mask: u32,
    /// The first address of the DPRAM, and the number of its addresses.
    base: u32,
    locations: u32,
    tables: &'static FirmwareTables,
    /// The shared part.
    pub dpram: Dpram,
}

impl Memory {
    /// The memory of a board with the firmware of `tables`: `dpram`, and zero elsewhere.
    #[must_use]
    pub fn new(dpram: Dpram, tables: &'static FirmwareTables) -> Self {
        let mask = tables.family.last_address();
        let words = mask as usize + 1;
        let (base, locations) = (tables.family.base, tables.family.length / 4);
        Self { x: vec![0; words].into(), y: vec![0; words].into(), mask, base, locations, tables, dpram }
    }

    /// The firmware of the board's family.
    #[must_use]
    pub fn tables(&self) -> &'static FirmwareTables {
        self.tables
    }

    /// The addresses of the board's registers.
    #[must_use]
    pub fn registers(&self) -> &'static RegisterTable {
        &self.tables.registers
    }

    /// The 24-bit word at `X:address`. A DPRAM location gives its 16 bits; the upper eight are not stored.
    #[inline]
    #[must_use]
    pub fn read_x(&self, address: u32) -> u32 {
        let address = address & self.mask;
        match self.host_offset(address) {
            Some(offset) => u32::from(self.dpram.read16(offset.plus_words(1))),
            None => self.x[address as usize],
        }
    }

    /// The 24-bit word at `Y:address`. A DPRAM location gives its 16 bits; the upper eight are not stored.
    #[inline]
    #[must_use]
    pub fn read_y(&self, address: u32) -> u32 {
        let address = address & self.mask;
        match self.host_offset(address) {
            Some(offset) => u32::from(self.dpram.read16(offset)),
            None => self.y[address as usize],
        }
    }

    /// Writes the low 24 bits of `value` to `X:address` (16 bits in the DPRAM).
    #[inline]
    pub fn write_x(&mut self, address: u32, value: u32) {
        let address = address & self.mask;
        match self.host_offset(address) {
            Some(offset) => self.dpram.write16(offset.plus_words(1), value as u16),
            None => self.x[address as usize] = value & int24::MASK,
        }
    }

    /// Writes the low 24 bits of `value` to `Y:address` (16 bits in the DPRAM).
    #[inline]
    pub fn write_y(&mut self, address: u32, value: u32) {
        let address = address & self.mask;
        match self.host_offset(address) {
            Some(offset) => self.dpram.write16(offset, value as u16),
            None => self.y[address as usize] = value & int24::MASK,
        }
    }

    /// The 24-bit word of a register: the X half if the address says X, else the Y half.
    #[inline]
    #[must_use]
    pub fn read(&self, register: PmacAddress) -> u32 {
        match register.space {
            Space::X => self.read_x(register.number),
            _ => self.read_y(register.number),
        }
    }

    /// Writes the low 24 bits of `value` to a register, likewise.
    #[inline]
    pub fn write(&mut self, register: PmacAddress, value: u32) {
        match register.space {
            Space::X => self.write_x(register.number, value),
            _ => self.write_y(register.number, value),
        }
    }

    /// A 48-bit fixed-point register.
    #[must_use]
    pub fn read_d(&self, register: PmacAddress) -> i64 {
        fixed48::decode(self.read_y(register.number), self.read_x(register.number))
    }

    /// Writes the low 48 bits of `value` to a fixed-point register.
    #[inline]
    pub fn write_d(&mut self, register: PmacAddress, value: i64) {
        let [y, x] = fixed48::encode(value);
        self.write_y(register.number, y);
        self.write_x(register.number, x);
    }

    /// A 48-bit floating-point register.
    #[must_use]
    pub fn read_l(&self, register: PmacAddress) -> f64 {
        float48::decode(self.read_y(register.number), self.read_x(register.number))
    }

    /// Writes `value` to a floating-point register.
    pub fn write_l(&mut self, register: PmacAddress, value: f64) {
        let [y, x] = float48::encode(value);
        self.write_y(register.number, y);
        self.write_x(register.number, x);
    }

    /// Clears the registers of motors and coordinate systems, not the variables and buffers above them.
    pub fn clear_registers(&mut self) {
        let end = self.tables.registers.end as usize;
        self.x[..end].fill(0);
        self.y[..end].fill(0);
    }

    /// Clears everything but the DPRAM.
    pub fn clear(&mut self) {
        self.x.fill(0);
        self.y.fill(0);
    }

    /// The host's offset of the Y half of `address`; `None` outside the DPRAM.
    #[inline]
    #[must_use]
    pub fn host_offset(&self, address: u32) -> Option<HostOffset> {
        let location = address.wrapping_sub(self.base);
        (location < self.locations).then(|| HostOffset::new(4 * location))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::testing;

    const fn at(number: u32) -> HostOffset {
        HostOffset::new(number)
    }

    #[test]
    fn dpram_locations_are_redirected_and_keep_sixteen_bits() {
        let mut memory = testing::memory();
        memory.write_x(0xD200, 0xABCDEF);
        memory.write_y(0xDFFF, 0x123456);
        memory.write_x(0xCFFF, 0xABCDEF);
        memory.write_y(0xE000, 0xFF12_3456);
        assert_eq!(memory.dpram.read16(at(0x0802)), 0xCDEF);
        assert_eq!(memory.dpram.read16(at(0x3FFC)), 0x3456);
        assert_eq!(memory.read_x(0xD200), 0xCDEF);
        assert_eq!(memory.read_x(0xCFFF), 0xABCDEF);
        assert_eq!(memory.read_y(0xE000), 0x123456);
    }

    #[test]
    fn long_registers_keep_their_value() {
        let mut memory = testing::memory();
        let (position, axis) = (testing::d(0x28), testing::l(0x081F));
        memory.write_d(position, -3072);
        memory.write_l(axis, -3.25);
        assert_eq!(memory.read_d(position), -3072);
        assert_eq!(memory.read_x(0x28), 0xFFFFFF);
        assert_eq!(memory.read_l(axis), -3.25);
    }

    #[test]
    fn the_board_sees_only_the_bits_that_its_addresses_have() {
        let mut memory = testing::memory();
        memory.write_x(0x1_0700, 5);
        assert_eq!(memory.read_x(0x0700), 5);
        memory.write_y(0x7_D200, 6);
        assert_eq!(memory.dpram.read16(at(0x0800)), 6);
    }
}
