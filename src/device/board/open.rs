//! Opens a board in a slot: its window, and its own interrupt.

use std::fs::File;

use super::{exclusive_lock, memory, pci, vme};
use crate::device::Board;
use crate::device::board::spec::{Place, WindowSpec};
use crate::device::board::window::WindowBoard;
use crate::device::interrupt::Interrupt;
use crate::device::mapping::Mapping;
use crate::device::refusal::{OpenError, Why};
use crate::device::system::System;
use crate::device::system::inherited::Inherited;
use crate::device::uio::interrupt::NoInterrupt;
use crate::device::uio::{UioDevice, UioInfo};

/// An open board.
pub struct OpenedBoard {
    /// Access to its words, and whether it is still there.
    pub bus: Box<dyn Board>,
    /// The interrupt of the opened device; `None` when that kind has none, or the specification names another.
    pub interrupt: Option<Result<Interrupt, NoInterrupt>>,
}

/// Opens the board of `spec`, with a DPRAM of `dpram` bytes, for this host alone. Prefers an inherited descriptor to
/// opening the node.
///
/// # Errors
/// [`OpenError`]: the failed part, the reason, and the cure.
pub fn open(
    spec: &WindowSpec,
    dpram: usize,
    system: &System,
    inherited: &Inherited,
) -> Result<OpenedBoard, OpenError> {
    let mapped = window_of(spec, dpram, system, inherited)?;
    let refuse = |why| OpenError::new(spec.place.to_string(), why);
    if let Some(node) = &mapped.node
        && !exclusive_lock::lock(node)
            .map_err(|source| refuse(Why::Io { doing: "locking it".to_owned(), source }))?
    {
        let text = "it is the board of another running pmacd; a board has one host: stop that one first";
        return Err(refuse(Why::Unsuitable(text.to_owned())));
    }
    let own = mapped.uio.filter(|_| spec.interrupt.is_none());
    let interrupt = own.map(|device| device.interrupt().map(Interrupt::from));
    let mapping = mapped.mapping.with_access(spec.access);
    let bus = match mapped.witness {
        Some(path) => WindowBoard::watched(mapping, mapped.node, system, path),
        None => WindowBoard::new(mapping),
    };
    Ok(OpenedBoard { bus: Box::new(bus), interrupt })
}

/// Opens only the window, even while a daemon uses the board, and leaves interrupts alone.
///
/// # Errors
/// As [`open`].
pub fn open_window(spec: &WindowSpec, dpram: usize, system: &System) -> Result<WindowBoard, OpenError> {
    let mapped = window_of(spec, dpram, system, &Inherited::default())?;
    Ok(WindowBoard::new(mapped.mapping))
}

fn window_of(
    spec: &WindowSpec,
    dpram: usize,
    system: &System,
    inherited: &Inherited,
) -> Result<MappedWindow, OpenError> {
    let bytes = spec.bytes(dpram);
    let bytes = bytes.map_err(|reason| OpenError::new(spec.place.to_string(), Why::Unsuitable(reason)))?;
    window(&spec.place, spec.offset, bytes, system, inherited)
}

/// A mapping and the files behind it.
pub(in crate::device) struct MappedWindow {
    pub mapping: Mapping,
    /// The mapped file, unless it gives access to more than the board (`/dev/mem`).
    node: Option<File>,
    /// The file whose disappearance shows that the device is gone.
    witness: Option<String>,
    uio: Option<UioDevice>,
}

/// `place`; for a `vme:` board behind `pmac_vme`, the map of the card's UIO device.
pub(in crate::device) fn described(system: &System, place: &Place) -> Place {
    match place {
        Place::Vme(node) if UioInfo::at(system, node).is_some_and(|info| info.is_vme_card()) => {
            Place::Uio { node: node.clone(), map: 0 }
        }
        other => other.clone(),
    }
}

/// Maps `length` bytes of `place` from `offset` on.
pub(in crate::device) fn window(
    place: &Place,
    offset: u64,
    length: usize,
    system: &System,
    inherited: &Inherited,
) -> Result<MappedWindow, OpenError> {
    Ok(match &described(system, place) {
        Place::Memory(address) => {
            let mapping = memory::map(system, inherited, address.saturating_add(offset), length)?;
            MappedWindow { mapping, node: None, witness: None, uio: None }
        }
        Place::Uio { node, map } => {
            let device = UioDevice::open(system, inherited, node)?;
            let mapping = device.map(*map, offset, length)?;
            let (node, witness) = (device.node()?, device.directory());
            MappedWindow { mapping, node: Some(node), witness: Some(witness), uio: Some(device) }
        }
        Place::Pci { address, bar } => {
            let (mapping, node) = pci::map(system, *address, *bar, offset, length)?;
            MappedWindow { mapping, node: Some(node), witness: Some(pci::directory(*address)), uio: None }
        }
        Place::Vme(path) => {
            let (mapping, node) = vme::map(system, path, offset, length)?;
            MappedWindow { mapping, node: Some(node), witness: Some(path.display().to_string()), uio: None }
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::testing::FakeSystem;
    use crate::map::HostOffset;

    fn open_text(fake: &FakeSystem, text: &str) -> Result<OpenedBoard, OpenError> {
        let Ok(crate::device::BoardSpec::Window(spec)) = text.parse() else { panic!("{text}") };
        open(&spec, 0x4000, &fake.system, &Inherited::default())
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
        for (text, brings) in [("uio:/dev/uio0", true), ("uio:/dev/uio0,irq=unix:/x", false)] {
            assert_eq!(open_text(&fake, text).unwrap().interrupt.is_some(), brings, "{text}");
        }
    }

    #[test]
    fn a_vme_card_brings_its_window_and_its_interrupt() {
        let fake = FakeSystem::new();
        fake.uio(2, "pmac-vme0", 0x76_0000, 0x1_0000, 0xC000, 0x1_0000);
        let mut card = open_text(&fake, "vme:/dev/uio2").unwrap();
        card.bus.write16(HostOffset::new(0x100), 0x55AA).unwrap();
        assert!(card.interrupt.is_some() && card.bus.length() == 0x4000);
        assert_eq!(std::fs::read(fake.path("dev/uio2")).unwrap()[0xC100..0xC102], [0xAA, 0x55]);
    }

    #[test]
    fn a_board_has_one_host_and_a_look_beside_it_is_allowed() {
        let fake = FakeSystem::new();
        fake.uio(0, "pmac-dpram", 0xD4000, 0x4000, 0, 0x4000);
        let first = open_text(&fake, "uio:/dev/uio0").unwrap();
        let error = open_text(&fake, "uio:/dev/uio0").err().unwrap().to_string();
        assert!(error.contains("another running pmacd"), "{error}");
        let Ok(crate::device::BoardSpec::Window(spec)) = "uio:/dev/uio0".parse() else { panic!() };
        assert!(open_window(&spec, 0x4000, &fake.system).is_ok());
        drop(first);
        assert!(open_text(&fake, "uio:/dev/uio0").is_ok());
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
