//! Where byte registers are, as a configuration writes it, and how to open them: the VME mailboxes in a mapped window,
//! the ISA host port in I/O space, or a file in which another process simulates either.

use std::fmt;
use std::fs::OpenOptions;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use crate::device::board::byte::PORT_NODE;
use crate::device::board::open::window;
use crate::device::board::spec::{Given, Place, needed};
use crate::device::mapping::Mapping;
use crate::device::refusal::{OpenError, Why, node_refused, raw_node_refused};
use crate::device::system::inherited::Inherited;
use crate::device::system::{System, number};
use crate::device::{ByteBus, ByteBusError, PortRegisters};
use crate::map::mailbox;

/// The place of a window of byte registers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ByteSpec {
    place: BytePlace,
    /// Offset of the registers in that place, in bytes.
    offset: u64,
}

impl ByteSpec {
    /// Registers at the start of a UIO device's map.
    pub(in crate::device) const fn in_map(node: PathBuf, map: u32) -> Self {
        Self { place: BytePlace::Window(Place::Uio { node, map }), offset: 0 }
    }
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum BytePlace {
    /// A file in which a simulator provides the registers.
    File(PathBuf),
    /// A PC's I/O space.
    Ports(u16),
    /// Mapped memory.
    Window(Place),
}

/// Why the driver refused a specification.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "registers `{spec}`: {reason}; write port:0x210, mem:0xADDRESS, uio:/dev/uioN[,map=M], pci:0000:03:00.0[,bar=N], \
    vme:NODE or file:PATH, all but port with [,offset=N]"
)]
pub struct ByteSpecError {
    spec: String,
    reason: String,
}

impl FromStr for ByteSpec {
    type Err = ByteSpecError;

    fn from_str(spec: &str) -> Result<Self, ByteSpecError> {
        parse(spec).map_err(|reason| ByteSpecError { spec: spec.to_owned(), reason })
    }
}

fn parse(spec: &str) -> Result<ByteSpec, String> {
    let (kind, rest) = spec.split_once(':').unwrap_or((spec, ""));
    let (subject, mut given) = Given::split(rest)?;
    let place = match Place::parse(kind, subject, &mut given)? {
        Some(place) => BytePlace::Window(place),
        None => match kind {
            "file" => BytePlace::File(needed(kind, "path", subject)?.into()),
            "port" => {
                let base =
                    number(needed(kind, "address", subject)?).and_then(|base| u16::try_from(base).ok());
                BytePlace::Ports(
                    base.ok_or_else(|| format!("{subject} is no I/O address; write it as 0x210"))?,
                )
            }
            _ => return Err(format!("there is no kind `{kind}` of byte registers")),
        },
    };
    let offset = match place {
        BytePlace::Ports(_) => 0,
        _ => given.offset.take().unwrap_or(0),
    };
    given.nothing_left(kind)?;
    Ok(ByteSpec { place, offset })
}

impl fmt::Display for ByteSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.place {
            BytePlace::File(path) => write!(f, "file:{}", path.display())?,
            BytePlace::Ports(base) => write!(f, "port:{base:#x}")?,
            BytePlace::Window(place) => place.fmt(f)?,
        }
        if self.offset == 0 { Ok(()) } else { write!(f, ",offset={:#x}", self.offset) }
    }
}

/// Opens the `length` byte registers of `spec` (VME mailboxes: 0x200, host port: 16). Prefers an inherited descriptor
/// to opening the node.
///
/// # Errors
/// [`OpenError`]: the failed part, the reason, and the cure.
pub fn open_bytes(
    spec: &ByteSpec,
    length: usize,
    system: &System,
    inherited: &Inherited,
) -> Result<Box<dyn ByteBus>, OpenError> {
    let refuse = |why| OpenError::new(spec.to_string(), why);
    match &spec.place {
        BytePlace::Window(place) => {
            Ok(Box::new(window(place, spec.offset, length, system, inherited)?.mapping))
        }
        BytePlace::Ports(base) => {
            let path = Path::new(PORT_NODE);
            let mut options = OpenOptions::new();
            let opened = options.read(true).write(true).open(system.path(path));
            let file = opened.map_err(|error| refuse(raw_node_refused(system, path, error)))?;
            Ok(Box::new(PortRegisters::in_file(file, *base, length)))
        }
        BytePlace::File(path) => Ok(Box::new(in_file(path, spec, length, system)?)),
    }
}

/// The registers in the file at `path`, in which a simulator provides them.
fn in_file(path: &Path, spec: &ByteSpec, length: usize, system: &System) -> Result<Mapping, OpenError> {
    let refuse = |why| OpenError::new(spec.to_string(), why);
    let missing = "is the simulator running?";
    let permission = "be the user the simulator runs as";
    let file = OpenOptions::new().read(true).write(true).open(path);
    let file = file.map_err(|error| refuse(node_refused(system, path, error, missing, permission)))?;
    let io = |source| refuse(Why::Io { doing: "mapping it".to_owned(), source });
    let found = file.metadata().map_err(io)?.len();
    if found < spec.offset.saturating_add(length as u64) {
        let text = format!("it has {found:#x} bytes, the registers end behind that");
        return Err(refuse(Why::Unsuitable(text)));
    }
    Mapping::new(&file, spec.offset, length).map_err(io)
}

/// Opens the registers of the VME mailboxes.
///
/// # Errors
/// As [`open_bytes`].
pub fn open_mailbox(
    spec: &ByteSpec,
    system: &System,
    inherited: &Inherited,
) -> Result<Box<dyn ByteBus>, OpenError> {
    match &spec.place {
        BytePlace::File(path) => {
            Ok(Box::new(SimulatedMailbox(in_file(path, spec, mailbox::LENGTH, system)?)))
        }
        _ => open_bytes(spec, mailbox::LENGTH, system, inherited),
    }
}

/// Mailboxes in a file. A board sees each write; a simulator sees only memory, so it would miss a byte written over an
/// equal one. Each write therefore also stores 0 in the even byte beside it, which no board has; the simulator sets
/// that to 0xFF again.
struct SimulatedMailbox(Mapping);

impl ByteBus for SimulatedMailbox {
    fn read8(&mut self, offset: u32) -> Result<u8, ByteBusError> {
        ByteBus::read8(&mut self.0, offset)
    }
    fn write8(&mut self, offset: u32, value: u8) -> Result<(), ByteBusError> {
        let at = offset as usize;
        match at.checked_sub(1).filter(|_| at % 2 == 1) {
            Some(even) => {
                let word = u16::from_le_bytes([0, value]);
                let length = self.0.length();
                self.0.write16(even, word).ok_or(ByteBusError::OutOfRange { offset, length })
            }
            None => ByteBus::write8(&mut self.0, offset, value),
        }
    }
    fn order_accesses(&mut self) {
        self.0.order_accesses();
    }
}

/// Number of the host port's I/O addresses.
const HOST_PORT_LENGTH: usize = 16;
/// The register that reads back another value than the host wrote.
const COMMAND: u32 = 8;
/// Where a simulated host port takes commands: its file cannot show that the host wrote the same byte again.
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
    let bus = open_bytes(spec, HOST_PORT_LENGTH, system, inherited)?;
    Ok(if matches!(spec.place, BytePlace::File(_)) { Box::new(SimulatedHostPort(bus)) } else { bus })
}

struct SimulatedHostPort(Box<dyn ByteBus>);

impl ByteBus for SimulatedHostPort {
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
    use crate::device::testing::FakeSystem;

    fn open(fake: &FakeSystem, spec: &str, length: usize) -> Result<Box<dyn ByteBus>, String> {
        let spec: ByteSpec = spec.parse().map_err(|error: ByteSpecError| error.to_string())?;
        open_bytes(&spec, length, &fake.system, &Inherited::default()).map_err(|error| error.to_string())
    }

    #[test]
    fn every_kind_leads_to_its_registers() {
        let fake = FakeSystem::new();
        fake.memory("dev/mem", 0x10_0000);
        fake.memory("dev/port", 0x1000);
        fake.memory("registers", 0x400);
        fake.uio(0, "pmac-dpram", 0xD4000, 0x4000, 0, 0x8000);
        fake.uio_map(0, 1, "mailbox", 0xE000, 0x1000, 0x200);
        let page = crate::device::mapping::page_bytes() as usize;
        let file = format!("file:{}", fake.path("registers").display());
        for (spec, file, at) in [
            ("mem:0xE0000", "dev/mem", 0xE_0000),
            ("uio:/dev/uio0,map=1", "dev/uio0", page + 0x200),
            ("uio:/dev/uio0,map=1,offset=0x10", "dev/uio0", page + 0x210),
            ("port:0x210", "dev/port", 0x210),
            (file.as_str(), "registers", 0),
        ] {
            let mut bus = open(&fake, spec, 0x200).unwrap();
            bus.write8(3, 0xA5).unwrap();
            assert_eq!(bus.read8(3).unwrap(), 0xA5, "{spec}");
            assert!(bus.read8(0x200).is_err(), "{spec}");
            assert_eq!(std::fs::read(fake.path(file)).unwrap()[at + 3], 0xA5, "{spec}");
            let shown = spec.parse::<ByteSpec>().unwrap().to_string();
            assert_eq!(shown.parse(), spec.parse::<ByteSpec>(), "{shown}");
        }
    }

    #[test]
    fn a_simulated_host_port_takes_commands_beside_the_register_that_is_read() {
        let fake = FakeSystem::new();
        fake.memory("registers", HOST_PORT_LENGTH as u64);
        fake.memory("dev/port", 0x1000);
        let open =
            |spec: &str| open_host_port(&spec.parse().unwrap(), &fake.system, &Inherited::default()).unwrap();
        for (spec, file, written) in [
            (format!("file:{}", fake.path("registers").display()), "registers", [0, 0x7F, 0, 0, 0x67]),
            ("port:0x0".to_owned(), "dev/port", [0x67, 0x7F, 0, 0, 0]),
        ] {
            let mut port = open(&spec);
            port.write8(8, 0x67).unwrap();
            port.write8(9, 0x7F).unwrap();
            assert_eq!(std::fs::read(fake.path(file)).unwrap()[8..13], written, "{spec}");
        }
    }

    #[test]
    fn a_simulated_mailbox_shows_each_write_and_a_mapped_one_is_written_by_its_byte_alone() {
        let fake = FakeSystem::new();
        fake.memory("registers", mailbox::LENGTH as u64);
        fake.memory("dev/mem", 0x10_0000);
        let simulated = format!("file:{}", fake.path("registers").display());
        for (spec, file, at, written) in [
            (simulated.as_str(), "registers", 0, [0xFF, 6, 0, 6]),
            ("mem:0xE0000", "dev/mem", 0xE_0000, [0xFF, 6, 0xFF, 6]),
        ] {
            let mut bytes = std::fs::read(fake.path(file)).unwrap();
            bytes[at..at + 4].copy_from_slice(&[0xFF, 6, 0xFF, 6]);
            std::fs::write(fake.path(file), bytes).unwrap();
            let mut registers =
                open_mailbox(&spec.parse().unwrap(), &fake.system, &Inherited::default()).unwrap();
            registers.write8(3, 6).unwrap();
            assert_eq!(registers.read8(3).unwrap(), 6, "{spec}");
            assert_eq!(std::fs::read(fake.path(file)).unwrap()[at..at + 4], written, "{spec}");
            assert!(registers.write8(mailbox::LENGTH as u32 + 1, 6).is_err(), "{spec}");
        }
    }

    #[test]
    fn what_is_wrong_is_said() {
        let fake = FakeSystem::new();
        fake.memory("short", 0x100);
        let short = format!("file:{}", fake.path("short").display());
        for (spec, reason) in [
            ("port:0x210", "there is no /dev/port"),
            ("port:0x10000", "no I/O address"),
            ("port:0x210,offset=2", "port: has no option offset="),
            ("port:", "address after port: is missing"),
            ("mem:0xE0000,length=0x4000", "mem: has no option length="),
            ("mem:0xE0000,irq=unix:x", "mem: has no option irq="),
            ("serial:/dev/ttyS0", "there is no kind `serial`"),
            (short.as_str(), "it has 0x100 bytes"),
        ] {
            let error = open(&fake, spec, 0x200).err().unwrap();
            assert!(error.contains(reason), "{spec}: {error}");
        }
    }
}
