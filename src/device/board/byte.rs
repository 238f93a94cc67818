//! Byte registers beside the DPRAM: the VME mailboxes in a mapped window, the ISA host port in I/O space.
//!
//! Registers are not memory: a read or write has an effect. So the driver accesses each register once, by exactly 8
//! bits.

use std::fs::{File, OpenOptions};
use std::os::unix::fs::FileExt;

use crate::device::mapping::Mapping;
use crate::device::{ByteBus, ByteBusError};

/// A PC's I/O space as a file; reading or writing a byte is one 8-bit access.
pub(super) const PORT_NODE: &str = "/dev/port";

impl ByteBus for Mapping {
    fn read8(&mut self, offset: u32) -> Result<u8, ByteBusError> {
        let length = self.length();
        Mapping::read8(self, offset as usize).ok_or(ByteBusError::OutOfRange { offset, length })
    }

    fn write8(&mut self, offset: u32, value: u8) -> Result<(), ByteBusError> {
        let length = self.length();
        Mapping::write8(self, offset as usize, value).ok_or(ByteBusError::OutOfRange { offset, length })
    }

    fn order_accesses(&mut self) {
        self.order_reads();
        self.order_writes();
    }
}

/// Registers on the other byte lane: a bridge that swaps the bytes of a word shows an odd register at the even address
/// below it.
pub struct EvenLane<B>(pub B);

impl<B: ByteBus> ByteBus for EvenLane<B> {
    fn read8(&mut self, offset: u32) -> Result<u8, ByteBusError> {
        self.0.read8(offset ^ 1)
    }
    fn write8(&mut self, offset: u32, value: u8) -> Result<(), ByteBusError> {
        self.0.write8(offset ^ 1, value)
    }
    fn order_accesses(&mut self) {
        self.0.order_accesses();
    }
}

/// Registers in a PC's I/O space. Needs the right to do raw I/O; no other program on the machine may use them.
pub struct PortRegisters {
    file: File,
    base: u16,
    length: usize,
}

impl PortRegisters {
    /// The `length` registers from I/O address `base` on (a PMAC's host port: 16, from 0x210 by default).
    ///
    /// # Errors
    /// When the driver cannot open the I/O space.
    pub fn open(base: u16, length: usize) -> std::io::Result<Self> {
        Ok(Self::in_file(OpenOptions::new().read(true).write(true).open(PORT_NODE)?, base, length))
    }

    /// The same registers in an open `file` that stands for the I/O space.
    #[must_use]
    pub fn in_file(file: File, base: u16, length: usize) -> Self {
        Self { file, base, length }
    }

    fn position(&self, offset: u32) -> Result<u64, ByteBusError> {
        if offset as usize >= self.length {
            return Err(ByteBusError::OutOfRange { offset, length: self.length });
        }
        Ok(u64::from(self.base) + u64::from(offset))
    }
}

impl ByteBus for PortRegisters {
    fn read8(&mut self, offset: u32) -> Result<u8, ByteBusError> {
        let mut byte = [0];
        self.file
            .read_exact_at(&mut byte, self.position(offset)?)
            .map_err(|source| ByteBusError::Io { offset, source })?;
        Ok(byte[0])
    }

    fn write8(&mut self, offset: u32, value: u8) -> Result<(), ByteBusError> {
        self.file
            .write_all_at(&[value], self.position(offset)?)
            .map_err(|source| ByteBusError::Io { offset, source })
    }

    /// Does nothing: an access is complete when the kernel returns.
    fn order_accesses(&mut self) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn registers_lie_from_the_base_on_and_nowhere_else() {
        let file = tempfile::tempfile().unwrap();
        file.set_len(0x1000).unwrap();
        let mut ports = PortRegisters::in_file(file.try_clone().unwrap(), 0x210, 16);
        let mut mapped = Mapping::new(&file, 0x210, 16).unwrap();
        for bus in [&mut ports as &mut dyn ByteBus, &mut mapped] {
            bus.write8(8, 0x67).unwrap();
            assert_eq!((bus.read8(7).unwrap(), bus.read8(8).unwrap(), bus.read8(9).unwrap()), (0, 0x67, 0));
            assert!(matches!(bus.read8(16), Err(ByteBusError::OutOfRange { .. })));
            assert!(bus.write8(u32::MAX, 0).is_err());
            bus.write8(8, 0).unwrap();
        }
        mapped.write8(9, 0x80).unwrap();
        assert_eq!(ports.read8(9).unwrap(), 0x80);
    }

    #[test]
    fn a_register_the_kernel_refuses_is_an_error_not_a_value() {
        let mut ports = PortRegisters::in_file(tempfile::tempfile().unwrap(), 0x210, 16);
        assert!(matches!(ports.read8(8), Err(ByteBusError::Io { offset: 8, .. })));
    }
}
