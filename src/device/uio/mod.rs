//! `uio:`: a board behind a UIO driver. /sys/class/uio describes it; its node gives both memory and interrupts.

pub mod interrupt;

use std::fs::{File, OpenOptions};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use nix::fcntl::{FcntlArg, OFlag, fcntl};

use crate::device::mapping::{Mapping, page_bytes};
use crate::device::refusal::{OpenError, Why, node_refused};
use crate::device::system::System;
use crate::device::system::inherited::Inherited;
use crate::device::uio::interrupt::{NoInterrupt, UioInterrupt};

/// Where the kernel describes UIO devices.
pub(in crate::device) const CLASS: &str = "/sys/class/uio";
/// The name of the descriptor that a service manager may hand over instead.
pub const HANDED_OVER: &str = "uio";

/// The names of `pmac_vme`'s devices begin so; the card's number follows.
const VME_CARD: &str = "pmac-vme";

/// One memory map, as the UIO driver describes it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UioMap {
    /// Its number.
    pub number: u32,
    /// The driver's name for it.
    pub name: String,
    /// Its physical address.
    pub address: u64,
    /// Its length in bytes, from the start of its first page.
    pub size: u64,
    /// Offset of the device's memory in it, in bytes.
    pub offset: u64,
}

/// A UIO device, as sysfs describes it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UioInfo {
    /// `uio0`.
    pub device: String,
    /// The driver's name for it.
    pub name: String,
    /// Its memory.
    pub maps: Vec<UioMap>,
}

impl UioInfo {
    /// The kernel's description of `device` (`uio0`); `None` without a device.
    #[must_use]
    pub fn of(system: &System, device: &str) -> Option<Self> {
        let directory = format!("{CLASS}/{device}");
        let name = system.name(format!("{directory}/name")).ok()?;
        let maps = system.names(format!("{directory}/maps")).into_iter().filter_map(|map| {
            let number = map.strip_prefix("map")?.parse().ok()?;
            let map = format!("{directory}/maps/{map}");
            let value = |attribute: &str| system.number(format!("{map}/{attribute}")).ok();
            Some(UioMap {
                number,
                name: system.name(format!("{map}/name")).unwrap_or_default(),
                address: value("addr")?,
                size: value("size")?,
                offset: value("offset").unwrap_or(0),
            })
        });
        Some(Self { device: device.to_owned(), name, maps: maps.collect() })
    }

    /// The kernel's description of the device of `node`, which may be a symbolic link to the device's own.
    #[must_use]
    pub fn at(system: &System, node: &Path) -> Option<Self> {
        let real = std::fs::canonicalize(system.path(node)).unwrap_or_else(|_| node.to_owned());
        Self::of(system, real.file_name().and_then(|name| name.to_str()).unwrap_or_default())
    }

    /// Its node.
    #[must_use]
    pub fn node(&self) -> String {
        format!("/dev/{}", self.device)
    }

    /// Whether the module `pmac_vme` made it.
    #[must_use]
    pub fn is_vme_card(&self) -> bool {
        self.name.starts_with(VME_CARD)
    }

    /// All UIO devices of the machine.
    #[must_use]
    pub fn all(system: &System) -> Vec<Self> {
        system.names(CLASS).iter().filter_map(|device| Self::of(system, device)).collect()
    }

    fn maps_in_words(&self) -> String {
        let maps =
            self.maps.iter().map(|map| format!("map={} ({}, {:#x} bytes)", map.number, map.name, map.size));
        let maps: Vec<String> = maps.collect();
        if maps.is_empty() {
            "it has no memory at all".to_owned()
        } else {
            format!("it has {}", maps.join(", "))
        }
    }
}

/// An open UIO device.
#[derive(Debug)]
pub struct UioDevice {
    system: System,
    /// As the specification writes it.
    node: PathBuf,
    info: UioInfo,
    file: File,
}

impl UioDevice {
    /// Opens the device at `node`, or uses the inherited descriptor for it.
    ///
    /// # Errors
    /// [`OpenError`] when the machine has no such device, this user may not use it, or the descriptor belongs to
    /// another device.
    pub fn open(system: &System, inherited: &Inherited, node: &Path) -> Result<Self, OpenError> {
        let refuse = |why| OpenError::new(format!("uio:{}", node.display()), why);
        let info = find(system, node).map_err(refuse)?;
        let file = match handed_over(system, inherited, &info).map_err(refuse)? {
            Some(file) => file,
            None => {
                let mut options = OpenOptions::new();
                options.read(true).write(true).custom_flags((OFlag::O_NONBLOCK | OFlag::O_CLOEXEC).bits());
                options.open(system.path(node)).map_err(|error| {
                    let missing = "the driver is there but its node is not; is udev running?";
                    let permission = "have a udev rule give the node to user pmacd alone (mode 0600; pmacctl doctor \
                        --boards prints the rule), or run as root";
                    refuse(node_refused(system, node, error, missing, permission))
                })?
            }
        };
        Ok(Self { system: system.clone(), node: node.to_owned(), info, file })
    }

    /// The kernel's description of the device.
    #[must_use]
    pub fn info(&self) -> &UioInfo {
        &self.info
    }

    /// Its directory in sysfs, which disappears with the device.
    #[must_use]
    pub fn directory(&self) -> String {
        format!("{CLASS}/{}", self.info.device)
    }

    /// Its node, open.
    ///
    /// # Errors
    /// When the process has no more descriptors.
    pub(in crate::device) fn node(&self) -> Result<File, OpenError> {
        self.file.try_clone().map_err(|source| {
            let why = Why::Io { doing: "keeping it open".to_owned(), source };
            OpenError::new(format!("uio:{}", self.node.display()), why)
        })
    }

    /// Maps `length` bytes of map `number`, from `offset` bytes behind the start of its memory.
    ///
    /// # Errors
    /// [`OpenError`] when the device has no such map, or the map is too short.
    pub fn map(&self, number: u32, offset: u64, length: usize) -> Result<Mapping, OpenError> {
        let what = format!("uio:{},map={number}", self.node.display());
        let refuse = |why| OpenError::new(what.clone(), why);
        let map = self.info.maps.iter().find(|map| map.number == number);
        let Some(map) = map else {
            let text = format!("{} has no map {number}; {}", self.info.device, self.info.maps_in_words());
            return Err(refuse(Why::Unsuitable(text)));
        };
        let skip = map.offset.saturating_add(offset);
        if skip.saturating_add(length as u64) > map.size {
            let text = format!(
                "its map {number} ({}) has {:#x} bytes, the window of {length:#x} bytes from {skip:#x} on does not \
                fit; {}",
                map.name,
                map.size,
                self.info.maps_in_words()
            );
            return Err(refuse(Why::Unsuitable(text)));
        }
        // The place in the node selects the map; it is no address.
        let start = u64::from(number) * page_bytes();
        Mapping::within(&self.file, start, usize::try_from(skip).unwrap_or(usize::MAX), length).map_err(
            |source| {
                refuse(Why::Io {
                    doing: format!("mapping its map {number} ({:#x} bytes at {:#x})", map.size, map.address),
                    source,
                })
            },
        )
    }

    /// Its interrupt, enabled.
    ///
    /// # Errors
    /// [`NoInterrupt`] when it has none, or one that would come only once.
    pub fn interrupt(&self) -> Result<UioInterrupt, NoInterrupt> {
        let file = self.file.try_clone().map_err(NoInterrupt::Io)?;
        UioInterrupt::new(&self.system, &self.directory(), file)
    }
}

/// The device of a node, which may be a symbolic link to it.
fn find(system: &System, node: &Path) -> Result<UioInfo, Why> {
    if let Some(info) = UioInfo::at(system, node) {
        return Ok(info);
    }
    let there: Vec<String> =
        UioInfo::all(system).into_iter().map(|info| format!("{} ({})", info.device, info.name)).collect();
    let cure = if there.is_empty() {
        "no UIO device is there: load the driver of the board (uio_pci_generic for PCI, pmac_dpram for ISA, \
        pmac_vme for VME)"
            .to_owned()
    } else {
        format!("the UIO devices there are: {}", there.join(", "))
    };
    if system.has(node) {
        return Err(Why::Unsuitable(format!("{} is no UIO device; {cure}", node.display())));
    }
    Err(Why::Missing { path: node.to_owned(), cure })
}

/// The inherited descriptor for this device, set to non-blocking.
fn handed_over(system: &System, inherited: &Inherited, info: &UioInfo) -> Result<Option<File>, Why> {
    let device = system.text(format!("{CLASS}/{}/dev", info.device)).unwrap_or_default();
    let same = |file: &File| {
        file.metadata().is_ok_and(|metadata| {
            let found = metadata.rdev();
            device == format!("{}:{}", nix::sys::stat::major(found), nix::sys::stat::minor(found))
        })
    };
    let Some(file) = inherited.find_if(HANDED_OVER, same) else { return Ok(None) };
    let io = |errno: nix::Error| Why::Io {
        doing: "inspecting the descriptor handed over as `uio`".to_owned(),
        source: errno.into(),
    };
    let flags = OFlag::from_bits_truncate(fcntl(&file, FcntlArg::F_GETFL).map_err(io)?);
    if flags & OFlag::O_ACCMODE != OFlag::O_RDWR {
        let text = "the descriptor handed over as `uio` is not open for reading and writing; leave `read-only` out \
            of OpenFile=";
        return Err(Why::Unsuitable(text.to_owned()));
    }
    fcntl(&file, FcntlArg::F_SETFL(flags | OFlag::O_NONBLOCK)).map_err(io)?;
    Ok(Some(file))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::testing::FakeSystem;

    fn open(fake: &FakeSystem, node: &str) -> Result<UioDevice, OpenError> {
        UioDevice::open(&fake.system, &Inherited::default(), Path::new(node))
    }

    #[test]
    fn a_map_begins_at_its_page_and_its_offset() {
        let fake = FakeSystem::new();
        let page = page_bytes();
        fake.uio(0, "pmac-dpram", 0xD4000, 0x4000, 0, 8 * page);
        fake.uio_map(0, 1, "mailbox", 0xE000, 0x5000, 0x20);
        fake.link("dev/pmac0", "uio0");
        let device = open(&fake, "/dev/pmac0").unwrap();
        assert_eq!(device.info().maps.len(), 2);
        device.map(1, 0x10, 0x4000).unwrap().write16(2, 0xBEEF).unwrap();
        let node = File::open(fake.path("dev/uio0")).unwrap();
        let whole = std::fs::read(fake.path("dev/uio0")).unwrap();
        drop(node);
        let at = page as usize + 0x32;
        assert_eq!(whole[at..at + 2], [0xEF, 0xBE]);
        assert_eq!(device.map(0, 0, 0x4000).unwrap().length(), 0x4000);
    }

    #[test]
    fn what_does_not_fit_is_said_with_what_there_is() {
        let fake = FakeSystem::new();
        fake.uio(0, "ivshmem", 0xFEBF_0000, 0x100, 0, 0x8000);
        fake.uio_map(0, 2, "bar2", 0xFEC0_0000, 0x4000, 0);
        let device = open(&fake, "/dev/uio0").unwrap();
        let error = device.map(0, 0, 0x4000).err().unwrap().to_string();
        assert!(error.contains("has 0x100 bytes") && error.contains("map=2 (bar2, 0x4000 bytes)"), "{error}");
        assert!(device.map(1, 0, 0x4000).err().unwrap().to_string().contains("uio0 has no map 1"));
        assert!(device.map(2, 2, 0x4000).is_err());
        assert!(device.map(2, u64::MAX, 0x4000).is_err());
    }

    #[test]
    fn a_node_that_is_no_uio_device_is_told_with_those_that_are() {
        let fake = FakeSystem::new();
        let error = open(&fake, "/dev/uio0").unwrap_err().to_string();
        assert!(error.contains("there is no /dev/uio0") && error.contains("load the driver"), "{error}");
        fake.uio(1, "pmac-dpram", 0xD4000, 0x4000, 0, 0x4000);
        fake.memory("dev/mem", 16);
        let error = open(&fake, "/dev/mem").unwrap_err().to_string();
        assert!(
            error.contains("/dev/mem is no UIO device") && error.contains("uio1 (pmac-dpram)"),
            "{error}"
        );
        std::fs::remove_file(fake.path("dev/uio1")).unwrap();
        assert!(matches!(open(&fake, "/dev/uio1").unwrap_err().why, Why::Missing { .. }));
    }

    #[test]
    fn a_descriptor_handed_over_is_used_for_the_device_it_is_of() {
        let fake = FakeSystem::new();
        fake.uio(0, "pmac-dpram", 0xD4000, 0x4000, 0, 0x4000);
        std::fs::remove_file(fake.path("dev/uio0")).unwrap();
        let with = |write: bool| {
            let file = File::options().read(true).write(write).open("/dev/null").unwrap();
            let inherited = Inherited::of(vec![(HANDED_OVER.to_owned(), file.into())]);
            UioDevice::open(&fake.system, &inherited, Path::new("/dev/uio0"))
        };
        assert!(matches!(with(true).unwrap_err().why, Why::Missing { .. }), "it is of another device");
        fake.file("sys/class/uio/uio0/dev", "1:3\n");
        assert!(with(true).is_ok());
        assert!(with(false).unwrap_err().to_string().contains("read-only"));
    }
}
