//! Finds devices that may be boards, from sysfs. Opens nothing, writes nothing.
//!
//! The search cannot find an ISA board: only the user knows its address.

use serde::Serialize;

use super::node_owner::{Holder, RULE_FILE, may_open, remark, rule_for_slot, rule_for_vme, rule_for_window};
use crate::device::board::pci::{self, PciInfo};
use crate::device::system::System;
use crate::device::uio::UioInfo;
use crate::map::FAMILIES;

/// PCI vendor and device of a PMAC PCI, as a driver of 2002 probes them. Altera's example designs use the same.
const KNOWN_ID: (u16, u16) = (0x1172, 0x0001);
/// The largest window that may be a DPRAM, in bytes.
const LONGEST_DPRAM: u64 = 0x1_0000;
/// UIO drivers of PMAC boards have names with this prefix.
const NAME: &str = "pmac";
/// The directory of vme_user's windows.
const VME_WINDOWS: &str = "/dev/bus/vme";

/// How certain it is that this is a PMAC.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Certainty {
    /// By its name or id.
    Likely,
    /// By the size of its memory alone.
    Maybe,
}

/// A device that may be a board.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Candidate {
    /// Its `--board` specification.
    pub spec: String,
    /// How certain it is.
    pub certainty: Certainty,
    /// A description.
    pub what: String,
    /// The driver bound to it, if any.
    pub driver: Option<String>,
    /// Whether this user may open everything that the specification needs.
    pub usable: bool,
    /// Whether only the service may open it, as it should be.
    pub reserved: bool,
    /// Whether users other than root, the service and this user may open it, past every role of the command socket.
    pub exposed: bool,
    /// Obstacles and improvements, each with what to do.
    pub hints: Vec<String>,
    /// The udev rule that gives its node to the service alone, if the shipped rules do not.
    pub rule: Option<String>,
}

impl Candidate {
    /// A board behind these files; `cure` says how to give them to the service alone.
    fn new(
        system: &System,
        spec: String,
        certainty: Certainty,
        what: String,
        files: &[(String, String)],
    ) -> Self {
        let mut hints = Vec::new();
        let mut worst = Holder::Service;
        for (file, cure) in files {
            let holder = Holder::of(system, file);
            hints.extend(remark(system, file, holder));
            if !matches!(holder, Holder::Service | Holder::Nobody) {
                hints.push(cure.clone());
            }
            worst = worst.max(holder);
        }
        hints.dedup();
        let usable = files.iter().all(|(file, _)| may_open(system, file));
        let (reserved, exposed) = (worst == Holder::Service, worst == Holder::Others);
        Self { spec, certainty, what, driver: None, usable, reserved, exposed, hints, rule: None }
    }

    fn with_driver(self, driver: Option<String>) -> Self {
        Self { driver, ..self }
    }

    /// Adds the rule, unless it is in force already.
    fn with_rule(self, rule: String) -> Self {
        Self { rule: (!self.reserved).then_some(rule), ..self }
    }
}

/// All candidates, the likely ones first.
#[must_use]
pub fn candidates(system: &System) -> Vec<Candidate> {
    let uio = UioInfo::all(system);
    let pci = PciInfo::all(system);
    // PCI devices appear below, by their id.
    let on_pci = |info: &UioInfo| pci.iter().any(|device| device.uio.as_deref() == Some(&info.device));
    let mut found: Vec<Candidate> =
        uio.iter().filter(|info| !on_pci(info)).filter_map(|info| of_uio(system, info)).collect();
    found.extend(pci.iter().filter_map(|device| {
        let own = uio.iter().find(|info| device.uio.as_deref() == Some(&info.device));
        of_pci(system, device, own)
    }));
    let windows = system.names(VME_WINDOWS);
    found.extend(windows.iter().filter(|name| name.starts_with('m')).map(|name| of_vme(system, name)));
    found.sort_by_key(|candidate| candidate.certainty);
    found
}

/// Whether a window of `size` bytes may be the DPRAM of a board of this certainty.
fn fits(size: u64, certainty: Certainty) -> bool {
    let holds = FAMILIES.iter().any(|family| size >= u64::from(family.length));
    holds && (certainty == Certainty::Likely || size <= LONGEST_DPRAM)
}

/// A UIO device that is not on PCI: by its name, or by a map that may be a DPRAM.
fn of_uio(system: &System, info: &UioInfo) -> Option<Candidate> {
    let certainty = if info.name.starts_with(NAME) { Certainty::Likely } else { Certainty::Maybe };
    let map = info.maps.iter().find(|map| fits(map.size.saturating_sub(map.offset), certainty))?;
    let what = format!("UIO device {}, {:#x} bytes at {:#x}", info.name, map.size, map.address);
    let spec = uio_spec(info, map.number);
    // The shipped rules recognize drivers by that prefix.
    let (cure, rule) = match certainty {
        Certainty::Likely => (
            "to give it to the service alone, install the package and run udevadm trigger -s uio".to_owned(),
            None,
        ),
        Certainty::Maybe => (rule_hint("uio"), Some(rule_for_window(map))),
    };
    let found = Candidate::new(system, spec, certainty, what, &[(info.node(), cure)])
        .with_driver(Some(info.name.clone()));
    Some(rule.into_iter().fold(found, Candidate::with_rule))
}

/// A window of a VME bridge.
fn of_vme(system: &System, name: &str) -> Candidate {
    let node = format!("{VME_WINDOWS}/{name}");
    let what = "a window of a VME bridge".to_owned();
    Candidate::new(system, format!("vme:{node}"), Certainty::Maybe, what, &[(node, rule_hint("vme_user"))])
        .with_rule(rule_for_vme(name))
}

/// A PCI device: by its id, or by a BAR that may be a DPRAM, unless another kind of driver is bound to it.
fn of_pci(system: &System, device: &PciInfo, uio: Option<&UioInfo>) -> Option<Candidate> {
    let known = device.id == KNOWN_ID;
    let foreign = device.driver.as_deref().filter(|driver| *driver != pci::INTERRUPTS_ONLY);
    if foreign.is_some() && !known {
        return None;
    }
    let certainty = if known { Certainty::Likely } else { Certainty::Maybe };
    let bar = device.bars.iter().find(|bar| bar.is_memory && fits(bar.size(), certainty))?;
    let address = device.address;
    let directory = pci::directory(address);
    let resource = format!("{directory}/resource{}", bar.number);
    // The shipped drop-in gives the files in sysfs to the service, and tells it where they are.
    let drop_in = format!(
        "to give its files to the service alone, copy /usr/share/pmacd/dropins/pci.conf and write {address} {} in it",
        bar.number
    );
    // A UIO device that maps this very BAR needs only access to its node.
    let map = uio.and_then(|info| Some((info, info.maps.iter().find(|map| map.address == bar.range.start)?)));
    let node = |info: &UioInfo| (info.node(), rule_hint("uio"));
    let (spec, files) = match (map, uio) {
        (Some((info, map)), _) => (uio_spec(info, map.number), vec![node(info)]),
        (None, Some(info)) => {
            let spec = format!("pci:{address},bar={},irq=uio:{}", bar.number, info.node());
            (spec, vec![(resource, drop_in), node(info)])
        }
        (None, None) => (format!("pci:{address},bar={}", bar.number), vec![(resource, drop_in)]),
    };
    let (vendor, id) = device.id;
    let like = if known { "the id of a PMAC PCI, and of Altera's example designs" } else { "of that size" };
    let what = format!("PCI device {vendor:04x}:{id:04x} at {address}, {bar}, {like}");
    let mut found = Candidate::new(system, spec, certainty, what, &files).with_driver(device.driver.clone());
    let bind = format!("driverctl set-override {address} {}", pci::INTERRUPTS_ONLY);
    match (foreign, uio) {
        (Some(driver), _) => {
            found.usable = false;
            found.hints.insert(0, format!("driver {driver} has it; give it another: {bind}"));
        }
        (None, None) => {
            let hint = format!(
                "for its interrupt, and to need no right but a node's: {bind}; before that, {}",
                rule_hint("uio")
            );
            found.hints.insert(0, hint);
        }
        (None, Some(_)) => {}
    }
    Some(if foreign.is_none() { found.with_rule(rule_for_slot(address, device.id)) } else { found })
}

/// How to install a rule for a device of this class.
fn rule_hint(class: &str) -> String {
    format!(
        "if it is your board, put the udev rule below into {RULE_FILE}, then udevadm control --reload and udevadm \
        trigger -s {class}"
    )
}

fn uio_spec(info: &UioInfo, map: u32) -> String {
    match map {
        0 if info.is_vme_card() => format!("vme:{}", info.node()),
        0 => format!("uio:{}", info.node()),
        map => format!("uio:{},map={map}", info.node()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::testing::FakeSystem;

    fn pci(fake: &FakeSystem, address: &str, id: (u16, u16), resource: &str, driver: Option<&str>) {
        let at = format!("sys/bus/pci/devices/{address}");
        fake.file(&format!("{at}/vendor"), &format!("{:#06x}\n", id.0));
        fake.file(&format!("{at}/device"), &format!("{:#06x}\n", id.1));
        fake.file(&format!("{at}/resource"), resource);
        for number in 0..6 {
            fake.file(&format!("{at}/resource{number}"), "");
        }
        if let Some(driver) = driver {
            fake.link(&format!("{at}/driver"), &format!("../../drivers/{driver}"));
        }
    }

    /// 16 KiB of memory as the first BAR.
    const FITS: &str = "0xfea00000 0xfea03fff 0x40200\n";

    fn specs(fake: &FakeSystem) -> Vec<(String, Certainty)> {
        candidates(&fake.system).into_iter().map(|found| (found.spec, found.certainty)).collect()
    }

    #[test]
    fn an_empty_machine_has_no_candidate() {
        let fake = FakeSystem::new();
        assert_eq!(candidates(&fake.system), []);
    }

    #[test]
    fn a_uio_device_counts_by_its_name_or_the_size_of_its_memory() {
        let fake = FakeSystem::new();
        fake.uio(0, "something", 0xFE00_0000, 0x8000, 0, 16);
        fake.uio(1, "pmac-dpram", 0xD4000, 0x200, 0, 16);
        fake.uio_map(1, 1, "dpram", 0xD4000, 0x4000, 0);
        fake.uio(2, "camera", 0xFD00_0000, 0x10_0000, 0, 16);
        assert_eq!(
            specs(&fake),
            [
                ("uio:/dev/uio1,map=1".to_owned(), Certainty::Likely),
                ("uio:/dev/uio0".to_owned(), Certainty::Maybe)
            ]
        );
        let found = &candidates(&fake.system)[0];
        assert!(found.usable && !found.reserved && found.what.contains("pmac-dpram"), "{found:?}");
        assert!(found.rule.is_none() && found.hints[0].contains("install the package"), "{found:?}");
        let found = &candidates(&fake.system)[1];
        assert!(
            found.hints[0].contains("udev rule below into /etc/udev/rules.d/59-pmacd.rules"),
            "{found:?}"
        );
        let rule = found.rule.as_deref().unwrap();
        assert!(rule.contains("ATTR{maps/map0/addr}==\"0x00000000fe000000\""), "{rule}");
        std::fs::remove_file(fake.path("dev/uio1")).unwrap();
        let found = &candidates(&fake.system)[0];
        assert!(!found.usable && found.hints[0].contains("/dev/uio1 is not there"), "{found:?}");
    }

    #[test]
    fn a_vme_card_is_one_board_although_it_has_three_uio_devices() {
        let fake = FakeSystem::new();
        for (number, name) in [(0, "pmac-vme0-taken"), (1, "pmac-vme0-reply")] {
            fake.file(&format!("sys/class/uio/uio{number}/name"), name);
        }
        fake.uio(2, "pmac-vme0", 0x70_0000, 0x8000, 0x4000, 16);
        fake.uio_map(2, 1, "mailbox", 0x7F_0000, 0xB000, 0xA000);
        assert_eq!(specs(&fake), [("vme:/dev/uio2".to_owned(), Certainty::Likely)]);
    }

    #[test]
    fn a_pci_device_counts_by_its_id_or_a_bar_of_that_size_that_nobody_has() {
        let fake = FakeSystem::new();
        pci(&fake, "0000:00:01.0", (0x8086, 0x1234), FITS, Some("nvme"));
        pci(&fake, "0000:00:02.0", (0x10B5, 0x9050), FITS, None);
        pci(&fake, "0000:00:03.0", (0x8086, 0x1111), "0xfe000000 0xfe0fffff 0x40200\n", None);
        pci(&fake, "0000:00:04.0", KNOWN_ID, "0xe000 0xe0ff 0x40101\n0xfeb00000 0xfeb03fff 0x40200\n", None);
        assert_eq!(
            specs(&fake),
            [
                ("pci:0000:00:04.0,bar=1".to_owned(), Certainty::Likely),
                ("pci:0000:00:02.0,bar=0".to_owned(), Certainty::Maybe)
            ]
        );
        let found = &candidates(&fake.system)[0];
        assert!(found.what.contains("1172:0001"), "{found:?}");
        assert!(found.hints[0].contains("driverctl set-override 0000:00:04.0 uio_pci_generic"), "{found:?}");
        assert!(found.hints[1].contains("pci.conf and write 0000:00:04.0 1 in it"), "{found:?}");
        let rule = found.rule.as_deref().unwrap();
        assert!(rule.contains("KERNELS==\"0000:00:04.0\", ATTRS{vendor}==\"0x1172\""), "{rule}");
        let rule = candidates(&fake.system)[1].rule.clone().unwrap();
        assert!(rule.contains("KERNELS==\"0000:00:02.0\", ATTRS{vendor}==\"0x10b5\""), "{rule}");
    }

    #[test]
    fn files_that_others_may_write_are_told() {
        use std::os::unix::fs::PermissionsExt;
        let fake = FakeSystem::new();
        fake.uio(0, "pmac-dpram", 0xD4000, 0x4000, 0, 16);
        let mode = std::fs::Permissions::from_mode;
        std::fs::set_permissions(fake.path("dev/uio0"), mode(0o660)).unwrap();
        let found = &candidates(&fake.system)[0];
        assert!(
            found.exposed
                && found.hints[0].contains("others than root and pmacd may open /dev/uio0 (mode 0660"),
            "{found:?}"
        );
        std::fs::set_permissions(fake.path("dev/uio0"), mode(0o600)).unwrap();
        assert!(!candidates(&fake.system)[0].exposed);
    }

    #[test]
    fn a_known_device_with_a_foreign_driver_is_named_with_what_to_do() {
        let fake = FakeSystem::new();
        pci(&fake, "0000:00:04.0", KNOWN_ID, FITS, Some("altera"));
        let found = &candidates(&fake.system)[0];
        assert!(!found.usable && found.hints[0].contains("driver altera has it"), "{found:?}");
        assert_eq!((found.driver.as_deref(), &found.rule), (Some("altera"), &None));
    }

    #[test]
    fn with_uio_pci_generic_the_map_of_the_bar_is_used_where_there_is_one() {
        let fake = FakeSystem::new();
        pci(&fake, "0000:00:04.0", KNOWN_ID, FITS, Some("uio_pci_generic"));
        fake.file("sys/bus/pci/devices/0000:00:04.0/uio/uio3/name", "uio_pci_generic\n");
        fake.uio(3, "uio_pci_generic", 0xFEA0_0000, 0x4000, 0, 16);
        assert_eq!(specs(&fake), [("uio:/dev/uio3".to_owned(), Certainty::Likely)]);
        fake.uio_map(3, 0, "bar1", 0xFEB0_0000, 0x100, 0);
        assert_eq!(
            specs(&fake),
            [("pci:0000:00:04.0,bar=0,irq=uio:/dev/uio3".to_owned(), Certainty::Likely)]
        );
    }

    #[test]
    fn every_specification_is_one_the_daemon_takes() {
        let fake = FakeSystem::new();
        pci(&fake, "0000:00:04.0", KNOWN_ID, FITS, Some("uio_pci_generic"));
        fake.file("sys/bus/pci/devices/0000:00:04.0/uio/uio3/name", "x\n");
        fake.uio(3, "uio_pci_generic", 0, 0x100, 0, 16);
        fake.uio(1, "pmac-dpram", 0xD4000, 0x4000, 0, 16);
        fake.memory("dev/bus/vme/m0", 0x4000);
        fake.memory("dev/bus/vme/ctl", 0);
        let found = candidates(&fake.system);
        assert_eq!(found.len(), 3, "{found:?}");
        for candidate in found {
            candidate.spec.parse::<crate::device::BoardSpec>().unwrap();
        }
    }
}
