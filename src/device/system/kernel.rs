//! Kernel and process facts that decide which memory a process may map: lockdown, capabilities, configuration, and the
//! drivers' claims on physical addresses.

use std::ops::Range;

use crate::device::system::{System, number, plain};

/// Bit of CAP_SYS_RAWIO in a capability set.
const CAP_SYS_RAWIO: u32 = 17;
/// The directory of PCI devices.
pub(in crate::device) const PCI_DEVICES: &str = "/sys/bus/pci/devices";

/// Kernel lockdown (`lockdown=`, or Secure Boot).
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Lockdown {
    /// The kernel does not say: it has no lockdown, or securityfs is not mounted.
    Unknown,
    /// Off.
    Off,
    /// On, in this mode.
    On(String),
}

impl Lockdown {
    /// Reads the kernel's state.
    #[must_use]
    pub fn of(system: &System) -> Self {
        let Ok(text) = system.text("/sys/kernel/security/lockdown") else { return Self::Unknown };
        match text.split_whitespace().find_map(|mode| mode.strip_prefix('[')?.strip_suffix(']')) {
            None => Self::Unknown,
            Some("none") => Self::Off,
            Some(mode) => Self::On(plain(mode)),
        }
    }

    /// Its mode, when it is on.
    #[must_use]
    pub fn mode(&self) -> Option<&str> {
        match self {
            Self::On(mode) => Some(mode),
            Self::Unknown | Self::Off => None,
        }
    }
}

/// Whether this process has CAP_SYS_RAWIO.
#[must_use]
pub fn may_do_raw_io(system: &System) -> bool {
    let status = system.text("/proc/self/status").unwrap_or_default();
    let effective = status.lines().find_map(|line| line.strip_prefix("CapEff:"));
    let effective = effective.and_then(|bits| u64::from_str_radix(bits.trim(), 16).ok());
    effective.is_some_and(|bits| bits >> CAP_SYS_RAWIO & 1 != 0)
}

/// The claim on a range of physical addresses.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Claim {
    /// The range is main memory, wholly or in part.
    MainMemory,
    /// A driver claims it.
    By(String),
    /// No claim that this process may see.
    Nobody,
    /// The kernel hides the addresses from this process.
    Hidden,
}

/// The claim on `range`: from sysfs for PCI devices, and from /proc/iomem where this process may read it.
#[must_use]
pub fn claim(system: &System, range: &Range<u64>) -> Claim {
    let of_pci = system.names(PCI_DEVICES).into_iter().find_map(|device| {
        let directory = format!("{PCI_DEVICES}/{device}");
        let resources = system.text(format!("{directory}/resource")).ok()?;
        let overlaps = resources.lines().filter_map(resource).any(|bar| overlap(&bar.range, range));
        let driver = overlaps.then(|| system.link_name(format!("{directory}/driver"))).flatten()?;
        Some(Claim::By(format!("driver {driver} of PCI device {device}")))
    });
    of_pci.unwrap_or_else(|| iomem_claim(&system.text("/proc/iomem").unwrap_or_default(), range))
}

fn iomem_claim(iomem: &str, range: &Range<u64>) -> Claim {
    let entries = iomem.lines().filter_map(|line| {
        let (span, name) = line.split_once(" : ")?;
        let (first, last) = span.trim().split_once('-')?;
        let first = u64::from_str_radix(first, 16).ok()?;
        Some((first..u64::from_str_radix(last, 16).ok()?.checked_add(1)?, name.trim()))
    });
    let entries: Vec<_> = entries.collect();
    // The kernel shows zeros to processes that may not see the addresses.
    if entries.iter().all(|(entry, _)| *entry == (0..1)) {
        return Claim::Hidden;
    }
    let mut claim = Claim::Nobody;
    for (_, name) in entries.iter().filter(|(entry, _)| overlap(entry, range)) {
        match *name {
            "System RAM" => return Claim::MainMemory,
            // A bus is no driver, and no driver owns a range that the firmware reserved.
            name if name == "Reserved" || name.starts_with("PCI Bus") || name.contains("ROM") => {}
            // A device's own resource is named by its place; the entry below it names the driver.
            name if name.len() == 12 && name.as_bytes()[4] == b':' && name.as_bytes()[7] == b':' => {}
            name => claim = Claim::By(plain(name)),
        }
    }
    claim
}

fn overlap(a: &Range<u64>, b: &Range<u64>) -> bool {
    a.start < b.end && b.start < a.end
}

/// A resource of a PCI device: its addresses and flags.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::device) struct Resource {
    pub range: Range<u64>,
    pub flags: u64,
}

/// A line of sysfs's `resource`: first and last address, flags. `None` for one that is unused, or ends before it
/// begins.
pub(in crate::device) fn resource(line: &str) -> Option<Resource> {
    let mut fields = line.split_whitespace().map(number);
    let (first, last, flags) = (fields.next()??, fields.next()??, fields.next()??);
    (flags != 0 && first <= last).then_some(Resource { range: first..last.checked_add(1)?, flags })
}

/// The kernel's release, as `uname -r` gives it.
#[must_use]
pub fn release(system: &System) -> Option<String> {
    system.text("/proc/sys/kernel/osrelease").ok()
}

/// The kernel's command line has `iomem=relaxed`, which lifts IO_STRICT_DEVMEM.
#[must_use]
pub fn is_iomem_relaxed(system: &System) -> bool {
    let line = system.text("/proc/cmdline").unwrap_or_default();
    line.split_whitespace().any(|word| word == "iomem=relaxed")
}

/// The options that the kernel was built with.
#[cfg(feature = "cli")]
#[derive(Debug)]
pub struct Configuration(Option<String>);

#[cfg(feature = "cli")]
impl Configuration {
    /// Reads them from the kernel itself, or from the file that a distribution ships beside the kernel.
    #[must_use]
    pub fn of(system: &System) -> Self {
        let release = release(system).unwrap_or_default();
        let places = [format!("/boot/config-{release}"), format!("/usr/lib/modules/{release}/config")];
        Self(own(system).or_else(|| places.iter().find_map(|place| system.text(place).ok())))
    }

    /// The value of `option` (`y`, `m`), or `n`; `None` when no configuration can be read.
    #[must_use]
    pub fn value(&self, option: &str) -> Option<&str> {
        let value = |line| str::strip_prefix(line, "CONFIG_")?.strip_prefix(option)?.strip_prefix('=');
        self.0.as_ref().map(|text| text.lines().find_map(value).unwrap_or("n"))
    }
}

/// The options as a kernel built with IKCONFIG_PROC tells them.
#[cfg(feature = "cli")]
fn own(system: &System) -> Option<String> {
    use std::io::Read;
    let packed = std::fs::File::open(system.path("/proc/config.gz")).ok()?;
    let mut text = String::new();
    flate2::read::GzDecoder::new(packed).read_to_string(&mut text).ok()?;
    Some(text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::testing::FakeSystem;

    #[test]
    fn the_mode_in_brackets_is_the_one_in_force() {
        for (text, lockdown) in [
            ("none [integrity] confidentiality\n", Lockdown::On("integrity".to_owned())),
            ("[none] integrity confidentiality\n", Lockdown::Off),
            ("", Lockdown::Unknown),
        ] {
            let fake = FakeSystem::new();
            fake.file("sys/kernel/security/lockdown", text);
            assert_eq!(Lockdown::of(&fake.system), lockdown);
        }
        assert_eq!(Lockdown::of(&FakeSystem::new().system), Lockdown::Unknown);
    }

    #[test]
    fn the_capability_is_bit_17_of_the_effective_set() {
        for (bits, may) in
            [("0000000000020000", true), ("000001ffffffffff", true), ("0000000000000000", false)]
        {
            let fake = FakeSystem::new();
            fake.file("proc/self/status", &format!("Name:\tx\nCapPrm:\t{bits}\nCapEff:\t{bits}\n"));
            assert_eq!(may_do_raw_io(&fake.system), may);
        }
        assert!(!may_do_raw_io(&FakeSystem::new().system));
    }

    #[test]
    fn who_claims_an_address_is_found_where_it_is_shown() {
        let fake = FakeSystem::new();
        let window = 0xFEBF_0000..0xFEBF_4000;
        assert_eq!(claim(&fake.system, &window), Claim::Hidden);
        fake.file("proc/iomem", "00000000-00000000 : Reserved\n00000000-00000000 : System RAM\n");
        assert_eq!(claim(&fake.system, &window), Claim::Hidden);
        fake.file(
            "proc/iomem",
            "00000000-00000fff : Reserved\n00001000-0009fbff : System RAM\n000a0000-000bffff : PCI Bus 0000:00\n\
             000f0000-000fffff : System ROM\n00100000-0fffffff : System RAM\nfe000000-febfffff : PCI Bus 0000:00\n\
             \x20 febf0000-febf3fff : 0000:00:03.0\n    febf0000-febf3fff : foo\n",
        );
        assert_eq!(claim(&fake.system, &window), Claim::By("foo".to_owned()));
        assert_eq!(claim(&fake.system, &(0xD4000..0xD8000)), Claim::Nobody);
        assert_eq!(claim(&fake.system, &(0x20_0000..0x20_4000)), Claim::MainMemory);
        fake.file(
            "sys/bus/pci/devices/0000:00:03.0/resource",
            "0x00000000febf0000 0x00000000febf3fff 0x0000000000040200\n0x0 0x0 0x0\n",
        );
        fake.link("sys/bus/pci/devices/0000:00:03.0/driver", "../../../bus/pci/drivers/ivshmem");
        assert_eq!(
            claim(&fake.system, &window),
            Claim::By("driver ivshmem of PCI device 0000:00:03.0".to_owned())
        );
    }

    #[test]
    fn a_resource_that_ends_before_it_begins_is_none() {
        assert_eq!(resource("0x10 0x1f 0x200").unwrap().range, 0x10..0x20);
        assert_eq!(resource("0x10 0x10 0x200").unwrap().range, 0x10..0x11);
        for line in
            ["0x10 0xf 0x200", "0x10 0x0 0x200", "0x0 0xffffffffffffffff 0x200", "0x10 0x1f 0x0", "0x10"]
        {
            assert_eq!(resource(line), None, "{line}");
        }
    }

    #[cfg(feature = "cli")]
    #[test]
    fn an_option_that_does_not_stand_in_the_configuration_is_off() {
        let fake = FakeSystem::new();
        assert_eq!(Configuration::of(&fake.system).value("STRICT_DEVMEM"), None);
        fake.file("proc/sys/kernel/osrelease", "6.1.0-9-amd64\n");
        fake.file(
            "boot/config-6.1.0-9-amd64",
            "CONFIG_STRICT_DEVMEM=y\nCONFIG_UIO=m\n# CONFIG_VME_BUS is not set\n",
        );
        for (option, value) in [("STRICT_DEVMEM", "y"), ("UIO", "m"), ("VME_BUS", "n"), ("DEVMEM", "n")] {
            assert_eq!(Configuration::of(&fake.system).value(option), Some(value), "{option}");
        }
        // The kernel itself knows better than a file.
        let own = std::fs::File::create(fake.path("proc/config.gz")).unwrap();
        let mut own = flate2::write::GzEncoder::new(own, flate2::Compression::default());
        std::io::Write::write_all(&mut own, b"CONFIG_VME_BUS=m\n").unwrap();
        own.finish().unwrap();
        assert_eq!(Configuration::of(&fake.system).value("VME_BUS"), Some("m"));
    }

    #[test]
    fn iomem_is_relaxed_by_a_word_of_the_command_line() {
        let fake = FakeSystem::new();
        for (line, relaxed) in
            [("quiet iomem=relaxed\n", true), ("iomem=strict", false), ("xiomem=relaxed", false)]
        {
            fake.file("proc/cmdline", line);
            assert_eq!(is_iomem_relaxed(&fake.system), relaxed, "{line}");
        }
    }
}
