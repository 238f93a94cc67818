//! Opens a board in a slot: its window, and the interrupt it has itself.

use super::Bus;
use super::inherited::Inherited;
use super::interrupt::Interrupt;
use super::mapping::Mapping;
use super::refusal::OpenError;
use super::spec::{Place, WindowSpec};
use super::system::System;
use super::uio::UioDevice;
use super::uio_interrupt::NoInterrupt;
use super::window::WindowBoard;
use super::{memory, pci, vme};

/// A board that was opened.
pub struct OpenedBoard {
    /// Its words.
    pub bus: Box<dyn Bus>,
    /// The interrupt of the very device that was opened; `None` when it is none that has one, or the specification
    /// names another.
    pub interrupt: Option<Result<Interrupt, NoInterrupt>>,
}

impl OpenedBoard {
    /// A board whose interrupt, if any, comes from elsewhere.
    pub fn without_interrupt(bus: impl Bus + 'static) -> Self {
        Self { bus: Box::new(bus), interrupt: None }
    }
}

/// Opens the board `spec` says. Descriptors handed over are used before nodes are opened.
///
/// # Errors
/// [`OpenError`]: what was refused, why, and what to do.
pub fn open(spec: &WindowSpec, system: &System, inherited: &Inherited) -> Result<OpenedBoard, OpenError> {
    let (mapping, path, device) = window(&spec.place, spec.offset, spec.length, system, inherited)?;
    let bus: Box<dyn Bus> = match path {
        Some(path) => Box::new(WindowBoard::watched(mapping, system, path)),
        None => Box::new(WindowBoard::new(mapping)),
    };
    let own = device.filter(|_| spec.interrupt.is_none());
    Ok(OpenedBoard { bus, interrupt: own.map(|device| device.interrupt().map(Interrupt::from)) })
}

/// Opens the window alone, and leaves interrupts as they are.
///
/// # Errors
/// As [`open`].
pub fn open_window(spec: &WindowSpec, system: &System) -> Result<WindowBoard, OpenError> {
    let (mapping, _, _) = window(&spec.place, spec.offset, spec.length, system, &Inherited::default())?;
    Ok(WindowBoard::new(mapping))
}

/// What was mapped: the window, the file whose disappearance tells that the device went away, and the open device.
type Mapped = (Mapping, Option<String>, Option<UioDevice>);

/// Maps `length` bytes of `place` from `offset` on.
pub(super) fn window(
    place: &Place,
    offset: u64,
    length: usize,
    system: &System,
    inherited: &Inherited,
) -> Result<Mapped, OpenError> {
    match place {
        Place::Memory(address) => {
            Ok((memory::map(system, inherited, address.saturating_add(offset), length)?, None, None))
        }
        Place::Uio { node, map } => {
            let device = UioDevice::open(system, inherited, node)?;
            let mapping = device.map(*map, offset, length)?;
            Ok((mapping, Some(device.directory()), Some(device)))
        }
        Place::Pci { address, bar } => {
            let mapping = pci::map(system, *address, *bar, offset, length)?;
            Ok((mapping, Some(pci::directory(*address)), None))
        }
        Place::Vme(node) => {
            Ok((vme::map(system, node, offset, length)?, Some(node.display().to_string()), None))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::testing::FakeSystem;
    use crate::map::HostOffset;

    fn open_text(fake: &FakeSystem, text: &str) -> Result<OpenedBoard, OpenError> {
        let Ok(crate::device::BoardSpec::Window(spec)) = text.parse() else { panic!("{text}") };
        open(&spec, &fake.system, &Inherited::default())
    }

    #[test]
    fn memory_and_uio_lead_to_the_same_words() {
        let fake = FakeSystem::new();
        fake.memory("dev/mem", 0x10_0000);
        fake.uio(0, "pmac-dpram", 0xD4000, 0x4000, 0, 0x4000);
        for text in ["mem:0xD4000", "mem:0xD0000,offset=0x4000", "uio:/dev/uio0"] {
            let mut board = open_text(&fake, text).unwrap();
            assert_eq!(board.bus.length(), 0x4000);
            board.bus.write16(HostOffset::new(0x100), 0x55AA).unwrap();
            assert_eq!(board.bus.read16(HostOffset::new(0x100)).unwrap(), 0x55AA);
            assert!(board.bus.still_there() && board.bus.answers());
        }
        assert_eq!(std::fs::read(fake.path("dev/mem")).unwrap()[0xD_4100..0xD_4102], [0xAA, 0x55]);
        assert_eq!(std::fs::read(fake.path("dev/uio0")).unwrap()[0x100..0x102], [0xAA, 0x55]);
    }

    #[test]
    fn a_uio_board_brings_its_interrupt_unless_another_is_named() {
        let fake = FakeSystem::new();
        fake.uio(0, "pmac-dpram", 0xD4000, 0x4000, 0, 0x4000);
        assert!(open_text(&fake, "uio:/dev/uio0").unwrap().interrupt.is_some());
        assert!(open_text(&fake, "uio:/dev/uio0,irq=unix:/x").unwrap().interrupt.is_none());
    }

    #[test]
    fn a_removed_uio_device_is_noticed() {
        let fake = FakeSystem::new();
        fake.uio(0, "pmac-dpram", 0xD4000, 0x4000, 0, 0x4000);
        let board = open_text(&fake, "uio:/dev/uio0").unwrap();
        std::fs::remove_dir_all(fake.path("sys/class/uio/uio0")).unwrap();
        assert!(!board.bus.still_there());
        let error = open_text(&fake, "uio:/dev/uio0").err().unwrap().to_string();
        assert!(error.contains("uio:/dev/uio0"), "{error}");
    }
}
