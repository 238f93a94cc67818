//! `pci:`: a board's memory through sysfs (`resourceN`), without a driver.
//!
//! Which BAR of a PMAC or PMAC2 is its DPRAM differs by generation (working programs use BAR0 and BAR2). Without a
//! number the driver takes the first memory BAR that is long enough.

use std::fmt;
use std::fs::{File, OpenOptions};
use std::io;
use std::ops::Range;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use nix::fcntl::OFlag;

use crate::device::mapping::Mapping;
use crate::device::refusal::{OpenError, Why, node_refused};
use crate::device::system::System;
use crate::device::system::kernel::{Claim, Lockdown, PCI_DEVICES, claim, resource};

/// Base address registers a device can have.
const BARS: u8 = 6;
/// The flag of a resource in memory; without it the resource is in I/O space.
const MEMORY: u64 = 1 << 9;
const PORTS: u64 = 1 << 8;
/// The driver that only passes on interrupts, and so may stay bound.
pub(in crate::device) const INTERRUPTS_ONLY: &str = "uio_pci_generic";

/// A device's place on PCI: domain, bus, device and function.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PciAddress {
    domain: u16,
    bus: u8,
    device: u8,
    function: u8,
}

impl FromStr for PciAddress {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let hex = |digits: &str, length: usize| {
            let whole = digits.len() == length && digits.bytes().all(|digit| digit.is_ascii_hexdigit());
            whole.then(|| u16::from_str_radix(digits, 16).ok()).flatten()
        };
        let address = || {
            let (rest, function) = text.rsplit_once('.')?;
            let (rest, device) = rest.rsplit_once(':')?;
            let (domain, bus) = rest.rsplit_once(':').unwrap_or(("0000", rest));
            Some(Self {
                domain: hex(domain, 4)?,
                bus: u8::try_from(hex(bus, 2)?).ok()?,
                device: u8::try_from(hex(device, 2)?).ok().filter(|device| *device < 32)?,
                function: u8::try_from(hex(function, 1)?).ok().filter(|function| *function < 8)?,
            })
        };
        address().ok_or_else(|| format!("{text} is no PCI address; write it as lspci -D does, 0000:03:00.0"))
    }
}

impl fmt::Display for PciAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:04x}:{:02x}:{:02x}.{}", self.domain, self.bus, self.device, self.function)
    }
}

/// A base address register.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Bar {
    /// Its number.
    pub number: u8,
    /// Its addresses.
    pub range: Range<u64>,
    /// Whether it is in memory, not in I/O space.
    pub is_memory: bool,
}

impl Bar {
    /// Its length in bytes.
    #[must_use]
    pub fn size(&self) -> u64 {
        self.range.end - self.range.start
    }
}

impl fmt::Display for Bar {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = if self.is_memory { "memory" } else { "I/O" };
        write!(f, "bar={} ({kind}, {:#x} bytes)", self.number, self.size())
    }
}

/// A PCI device, as sysfs describes it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PciInfo {
    /// Where it is.
    pub address: PciAddress,
    /// Vendor and device number.
    pub id: (u16, u16),
    /// The driver bound to it.
    pub driver: Option<String>,
    /// The UIO device that its driver created.
    pub uio: Option<String>,
    /// Its memory and I/O ports.
    pub bars: Vec<Bar>,
}

impl PciInfo {
    /// The kernel's description of the device at `address`; `None` without a device.
    #[must_use]
    pub fn of(system: &System, address: PciAddress) -> Option<Self> {
        let directory = directory(address);
        let id = |name: &str| u16::try_from(system.number(format!("{directory}/{name}")).ok()?).ok();
        let id = (id("vendor")?, id("device")?);
        let resources = system.text(format!("{directory}/resource")).unwrap_or_default();
        let bars = (0..BARS).zip(resources.lines()).filter_map(|(number, line)| {
            let resource = resource(line)?;
            let is_memory = resource.flags & MEMORY != 0;
            let wanted = is_memory || resource.flags & PORTS != 0;
            wanted.then_some(Bar { number, range: resource.range, is_memory })
        });
        Some(Self {
            address,
            id,
            driver: system.link_name(format!("{directory}/driver")),
            uio: system.names(format!("{directory}/uio")).into_iter().next(),
            bars: bars.collect(),
        })
    }

    /// All PCI devices of the machine.
    #[must_use]
    pub fn all(system: &System) -> Vec<Self> {
        let names = system.names(PCI_DEVICES);
        names.iter().filter_map(|name| Self::of(system, name.parse().ok()?)).collect()
    }

    /// The BAR to map: `number`, or the first memory BAR with at least `needed` bytes.
    fn bar(&self, number: Option<u8>, needed: u64) -> Result<&Bar, Why> {
        let fits = |bar: &Bar| bar.is_memory && bar.size() >= needed;
        let found = match number {
            None => self.bars.iter().find(|bar| fits(bar)),
            Some(number) => self.bars.iter().find(|bar| bar.number == number),
        };
        let there: Vec<String> = self.bars.iter().map(ToString::to_string).collect();
        let there = if there.is_empty() { "none at all".to_owned() } else { there.join(", ") };
        let unsuitable = |text: String| Err(Why::Unsuitable(format!("{text}; the device has {there}")));
        match (found, number) {
            (None, None) => unsuitable(format!("no memory BAR has the {needed:#x} bytes needed")),
            (None, Some(number)) => unsuitable(format!("there is no BAR {number}")),
            (Some(bar), _) if !bar.is_memory => {
                unsuitable(format!("BAR {} lies in I/O space, a DPRAM in memory", bar.number))
            }
            (Some(bar), _) if !fits(bar) => {
                unsuitable(format!("BAR {} is shorter than the {needed:#x} bytes needed", bar.number))
            }
            (Some(bar), _) => Ok(bar),
        }
    }
}

/// The device's directory in sysfs, which disappears with the device.
#[must_use]
pub fn directory(address: PciAddress) -> String {
    format!("{PCI_DEVICES}/{address}")
}

/// Maps `length` bytes of a memory BAR from `offset` on, and returns the mapped file. Without `bar` takes the first BAR
/// that is long enough.
///
/// # Errors
/// [`OpenError`] when the machine has no such device or BAR, a driver is bound to the device, or this user may not map
/// it.
pub fn map(
    system: &System,
    address: PciAddress,
    bar: Option<u8>,
    offset: u64,
    length: usize,
) -> Result<(Mapping, File), OpenError> {
    let refuse = |why| OpenError::new(format!("pci:{address}"), why);
    let directory = directory(address);
    let info = PciInfo::of(system, address).ok_or_else(|| {
        let cure = "list the devices with lspci -D".to_owned();
        refuse(Why::Missing { path: PathBuf::from(&directory), cure })
    })?;
    if let Some(driver) = info.driver.as_deref().filter(|driver| *driver != INTERRUPTS_ONLY) {
        return Err(refuse(Why::Unsuitable(format!(
            "driver {driver} has the device; unbind it (driverctl set-override {address} {INTERRUPTS_ONLY}, or echo \
            {address} into its unbind file)"
        ))));
    }
    let needed = offset.saturating_add(length as u64);
    let bar = info.bar(bar, needed).map_err(refuse)?;
    enable(system, &directory).map_err(refuse)?;
    let path = PathBuf::from(format!("{directory}/resource{}", bar.number));
    let mut options = OpenOptions::new();
    options.read(true).write(true).custom_flags((OFlag::O_SYNC | OFlag::O_CLOEXEC).bits());
    let file = options
        .open(system.path(&path))
        .map_err(|error| refuse(sysfs_refused(system, &path, &bar.range, error)))?;
    // The file in sysfs has the BAR's length; the kernel could not map a shorter one to the window's end.
    if file.metadata().is_ok_and(|metadata| metadata.len() < needed) {
        return Err(refuse(Why::Unsuitable(format!("{} is shorter than its BAR", path.display()))));
    }
    match Mapping::new(&file, offset, length) {
        Ok(mapping) => Ok((mapping, file)),
        Err(error) => Err(refuse(sysfs_refused(system, &path, &bar.range, error))),
    }
}

/// Makes the kernel enable the device's memory, unless it is enabled already.
fn enable(system: &System, directory: &str) -> Result<(), Why> {
    let path = PathBuf::from(format!("{directory}/enable"));
    if system.number(&path).is_ok_and(|count| count > 0) {
        return Ok(());
    }
    std::fs::write(system.path(&path), "1").map_err(|error| sysfs_refused(system, &path, &(0..0), error))
}

/// Why this process cannot use a file of the device in sysfs.
fn sysfs_refused(system: &System, path: &Path, range: &Range<u64>, error: io::Error) -> Why {
    match (error.raw_os_error(), Lockdown::of(system).mode()) {
        (Some(libc::EPERM), Some(mode)) => {
            Why::Lockdown(mode.to_owned(), "mapping PCI memory and configuring PCI devices through sysfs")
        }
        // The kernel's answer under IO_STRICT_DEVMEM.
        (Some(libc::EINVAL), _) => match claim(system, range) {
            Claim::By(by) => Why::Claimed { range: range.clone(), by },
            _ => Why::NotMappable(range.clone()),
        },
        (Some(libc::EROFS), _) => Why::Unsuitable(format!(
            "{} is read-only for the service; name the device's directory in ReadWritePaths=",
            path.display()
        )),
        _ => {
            let permission = "run as root, or have /usr/lib/pmacd/pci-prepare give it to user pmacd alone before the \
                start (drop-in pci.conf, which also enables the device)";
            node_refused(system, path, error, "the device went away", permission)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::testing::FakeSystem;

    const AT: &str = "sys/bus/pci/devices/0000:03:00.0";

    /// A board with an I/O BAR, a short memory BAR, and the DPRAM as BAR 2.
    fn board() -> FakeSystem {
        let fake = FakeSystem::new();
        fake.file(&format!("{AT}/vendor"), "0x1172\n");
        fake.file(&format!("{AT}/device"), "0x0001\n");
        fake.file(&format!("{AT}/enable"), "0\n");
        fake.file(
            &format!("{AT}/resource"),
            "0x000000000000e000 0x000000000000e0ff 0x0000000000040101\n\
             0x00000000fea00000 0x00000000fea000ff 0x0000000000040200\n\
             0x00000000feb00000 0x00000000feb03fff 0x0000000000040200\n\
             0x0000000000000000 0x0000000000000000 0x0000000000000000\n",
        );
        fake.memory(&format!("{AT}/resource2"), 0x4000);
        fake
    }

    fn map_bar(fake: &FakeSystem, bar: Option<u8>) -> Result<Mapping, String> {
        let address = "0000:03:00.0".parse().unwrap();
        map(&fake.system, address, bar, 0, 0x4000)
            .map(|(window, _)| window)
            .map_err(|error| error.to_string())
    }

    #[test]
    fn addresses_are_written_as_lspci_writes_them() {
        for text in ["0000:03:00.0", "0001:ff:1f.7"] {
            assert_eq!(text.parse::<PciAddress>().unwrap().to_string(), text);
        }
        assert_eq!("03:00.0".parse(), "0000:03:00.0".parse::<PciAddress>());
        for text in
            ["", "3:0.0", "0000:03:00", "0000:03:20.0", "0000:03:00.8", "0000:zz:00.0", "+000:03:00.0"]
        {
            assert!(text.parse::<PciAddress>().is_err(), "{text}");
        }
    }

    #[test]
    fn the_first_memory_bar_long_enough_is_the_dpram_and_the_device_is_enabled() {
        let fake = board();
        map_bar(&fake, None).unwrap().write16(0x10, 0xF00D).unwrap();
        let bytes = std::fs::read(fake.path(&format!("{AT}/resource2"))).unwrap();
        assert_eq!(bytes[0x10..0x12], [0x0D, 0xF0]);
        assert_eq!(std::fs::read_to_string(fake.path(&format!("{AT}/enable"))).unwrap(), "1");
        assert!(map_bar(&fake, Some(2)).is_ok());
    }

    #[test]
    fn a_bar_that_cannot_be_the_dpram_is_refused_with_those_there_are() {
        let fake = board();
        for (bar, reason) in
            [(0, "BAR 0 lies in I/O space"), (1, "BAR 1 is shorter"), (3, "there is no BAR 3")]
        {
            let error = map_bar(&fake, Some(bar)).err().unwrap();
            assert!(error.contains(reason) && error.contains("bar=2 (memory, 0x4000 bytes)"), "{error}");
        }
        fake.file(&format!("{AT}/resource"), "0x0 0x0 0x0\n");
        assert!(map_bar(&fake, None).err().unwrap().contains("no memory BAR has the 0x4000 bytes"));
        let address = "0000:04:00.0".parse().unwrap();
        assert!(matches!(
            map(&fake.system, address, None, 0, 0x4000).err().unwrap().why,
            Why::Missing { .. }
        ));
    }

    #[test]
    fn a_device_with_a_driver_of_its_own_is_left_alone() {
        let fake = board();
        fake.link(&format!("{AT}/driver"), "../../../bus/pci/drivers/somedriver");
        let error = map_bar(&fake, None).err().unwrap();
        assert!(error.contains("driver somedriver has the device"), "{error}");
        assert_eq!(std::fs::read_to_string(fake.path(&format!("{AT}/enable"))).unwrap(), "0\n");
        std::fs::remove_file(fake.path(&format!("{AT}/driver"))).unwrap();
        fake.link(&format!("{AT}/driver"), "../../../bus/pci/drivers/uio_pci_generic");
        assert!(map_bar(&fake, None).is_ok());
    }

    #[test]
    fn what_the_kernel_refuses_is_told_apart() {
        let fake = board();
        let range = 0xFEB0_0000..0xFEB0_4000;
        let why = |errno| {
            let path = Path::new("/sys/bus/pci/devices/0000:03:00.0/resource2");
            sysfs_refused(&fake.system, path, &range, io::Error::from_raw_os_error(errno))
        };
        assert!(matches!(why(libc::EACCES), Why::Permission { .. }));
        assert!(why(libc::EROFS).to_string().contains("ReadWritePaths="));
        assert!(matches!(why(libc::EINVAL), Why::NotMappable(_)));
        fake.file("proc/iomem", "feb00000-feb03fff : foo\n");
        assert!(matches!(why(libc::EINVAL), Why::Claimed { .. }));
        fake.file("sys/kernel/security/lockdown", "none [confidentiality]");
        assert!(matches!(why(libc::EPERM), Why::Lockdown(..)));
    }
}
