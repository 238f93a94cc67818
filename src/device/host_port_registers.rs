//! The registers of a board's host port, 16 bytes in the I/O space of a PC (manual of the bus' board, "Host port").
//!
//! A file stands for them where the board is a simulated one. It cannot tell that a byte was written that has not
//! changed, so the register that acts on each write takes it elsewhere there.

use super::byte_spec::{ByteSpec, open_bytes};
use super::inherited::Inherited;
use super::refusal::OpenError;
use super::system::System;
use super::{ByteBus, ByteBusError};

/// Registers of the host port.
const LENGTH: usize = 16;
/// The register that reads other than it is written.
const COMMAND: u32 = 8;
/// Where a simulated host port takes what is written to it.
const SIMULATED_COMMAND: u32 = 12;

/// Opens the registers of a host port.
///
/// # Errors
/// As [`open_bytes`].
pub fn open_host_port(
    spec: &ByteSpec,
    system: &System,
    inherited: &Inherited,
) -> Result<Box<dyn ByteBus>, OpenError> {
    let bus = open_bytes(spec, LENGTH, system, inherited)?;
    Ok(if spec.is_file() { Box::new(Simulated(bus)) } else { bus })
}

struct Simulated(Box<dyn ByteBus>);

impl ByteBus for Simulated {
    fn read8(&mut self, offset: u32) -> Result<u8, ByteBusError> {
        self.0.read8(offset)
    }
    fn write8(&mut self, offset: u32, value: u8) -> Result<(), ByteBusError> {
        self.0.write8(if offset == COMMAND { SIMULATED_COMMAND } else { offset }, value)
    }
    fn order_accesses(&mut self) {
        self.0.order_accesses();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_takes_the_command_where_each_write_is_seen_and_ports_take_it_in_its_place() {
        let fake = crate::device::testing::FakeSystem::new();
        fake.memory("dev/port", 0x1000);
        fake.memory("registers", LENGTH as u64);
        let file = format!("file:{}", fake.path("registers").display());
        for (spec, path, at) in [(file.as_str(), "registers", 12), ("port:0x210", "dev/port", 0x218)] {
            let mut bus =
                open_host_port(&spec.parse().unwrap(), &fake.system, &Inherited::default()).unwrap();
            bus.write8(COMMAND, 0x67).unwrap();
            bus.write8(9, 0x80).unwrap();
            let bytes = std::fs::read(fake.path(path)).unwrap();
            assert_eq!(bytes[at], 0x67, "{spec}");
            assert_eq!(bus.read8(9).unwrap(), 0x80);
        }
    }
}
