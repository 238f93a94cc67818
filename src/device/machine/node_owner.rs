//! The users who may open a board's files, and the udev rule that gives a board's node to the service alone.
//!
//! A program that opens a node, or a device's file in sysfs, can write to the board past every role of the command
//! socket. So these files belong to the service's user alone, with mode 0600; no group has access.

use std::os::unix::fs::MetadataExt;
use std::path::Path;

use nix::unistd::{AccessFlags, User, access, geteuid};

use crate::device::board::pci::PciAddress;
use crate::device::refusal::allowed;
use crate::device::system::System;
use crate::device::uio::UioMap;

/// The user of `pmacd@.service`.
pub const SERVICE_USER: &str = "pmacd";
/// The file for a site's own rule. It precedes the shipped 60-pmacd.rules, which link what `ID_PMAC` marks and start
/// its service.
pub const RULE_FILE: &str = "/etc/udev/rules.d/59-pmacd.rules";

/// The assignment of each rule.
const OURS: &str = r#"OWNER="pmacd", GROUP="root", MODE="0600""#;
/// Marks a UIO device as a board.
const MARK: &str = r#"ENV{ID_PMAC}="1""#;

/// The rule for the UIO device of the PCI device in this slot, if it has this vendor and device number.
#[must_use]
pub fn rule_for_slot(slot: PciAddress, (vendor, device): (u16, u16)) -> String {
    format!(
        r#"SUBSYSTEM=="uio", SUBSYSTEMS=="pci", KERNELS=="{slot}", ATTRS{{vendor}}=="{vendor:#06x}", ATTRS{{device}}=="{device:#06x}", {OURS}, {MARK}"#
    )
}

/// The rule for the UIO device whose map has this physical address. (The driver chose its name, so that is no key.)
#[must_use]
pub fn rule_for_window(map: &UioMap) -> String {
    let UioMap { number, address, .. } = map;
    format!(r#"SUBSYSTEM=="uio", ATTR{{maps/map{number}/addr}}=="{address:#018x}", {OURS}, {MARK}"#)
}

/// The rule for a window of vme_user, whose node is `/dev/bus/vme/WINDOW`.
#[must_use]
pub fn rule_for_vme(window: &str) -> String {
    format!(r#"KERNEL=="bus/vme/{window}", {OURS}"#)
}

/// The users who may open a file for reading and writing, from best to worst.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::device) enum Holder {
    /// The service alone, as it should be.
    Service,
    /// This user, and no third one.
    You,
    /// Its owner, not this user.
    Another,
    /// The machine has no such file.
    Nobody,
    /// Others than root, the service and this user.
    Others,
}

impl Holder {
    pub(in crate::device) fn of(system: &System, file: &str) -> Self {
        let path = system.path(file);
        let Ok(found) = path.metadata() else { return Self::Nobody };
        let service = User::from_name(SERVICE_USER).ok().flatten().map(|user| user.uid.as_raw());
        Self::by(found.uid(), found.mode(), service, geteuid().as_raw(), opens(&path))
    }

    fn by(owner: u32, mode: u32, service: Option<u32>, you: u32, you_may: bool) -> Self {
        // A user who can read the board can read every command line, passwords too.
        if mode & 0o066 != 0 || ![Some(0), Some(you), service].contains(&Some(owner)) {
            Self::Others
        } else if service == Some(owner) {
            Self::Service
        } else if you_may {
            Self::You
        } else {
            Self::Another
        }
    }
}

/// Whether this user may open `file` for reading and writing.
pub(in crate::device) fn may_open(system: &System, file: &str) -> bool {
    opens(&system.path(file))
}

fn opens(path: &Path) -> bool {
    access(path, AccessFlags::R_OK | AccessFlags::W_OK).is_ok()
}

/// A remark about the users who may open `file`, if one is due.
pub(in crate::device) fn remark(system: &System, file: &str, holder: Holder) -> Option<String> {
    let modes = || allowed(&system.path(file)).unwrap_or_default();
    match holder {
        Holder::Service => Some(format!("{file} is {SERVICE_USER}'s alone, as it should be")),
        Holder::You => None,
        Holder::Another => Some(format!("you may not read and write {file} ({})", modes())),
        Holder::Others => Some(format!(
            "others than root and {SERVICE_USER} may open {file} ({}), past every role of the command socket",
            modes()
        )),
        Holder::Nobody => Some(format!("{file} is not there; is udev running?")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slot_gets_its_owner_only_while_the_same_device_is_in_it() {
        assert_eq!(
            rule_for_slot("03:00.0".parse().unwrap(), (0x1172, 1)),
            "SUBSYSTEM==\"uio\", SUBSYSTEMS==\"pci\", KERNELS==\"0000:03:00.0\", ATTRS{vendor}==\"0x1172\", \
             ATTRS{device}==\"0x0001\", OWNER=\"pmacd\", GROUP=\"root\", MODE=\"0600\", ENV{ID_PMAC}=\"1\""
        );
    }

    #[test]
    fn a_window_is_told_by_its_address_as_sysfs_writes_it() {
        let map = UioMap { number: 1, name: "\"*\"".to_owned(), address: 0xD4000, size: 0x4000, offset: 0 };
        assert_eq!(
            rule_for_window(&map),
            "SUBSYSTEM==\"uio\", ATTR{maps/map1/addr}==\"0x00000000000d4000\", OWNER=\"pmacd\", GROUP=\"root\", \
             MODE=\"0600\", ENV{ID_PMAC}=\"1\""
        );
        assert_eq!(
            rule_for_vme("m0"),
            "KERNEL==\"bus/vme/m0\", OWNER=\"pmacd\", GROUP=\"root\", MODE=\"0600\""
        );
    }

    #[test]
    fn a_file_is_the_services_only_if_nobody_else_may_open_it() {
        let by = |owner, mode, you_may| Holder::by(owner, mode, Some(990), 1000, you_may);
        assert_eq!(by(990, 0o100_600, false), Holder::Service);
        assert_eq!(by(990, 0o100_660, false), Holder::Others);
        assert_eq!(by(990, 0o100_640, true), Holder::Others, "a group may read");
        assert_eq!(by(990, 0o100_604, true), Holder::Others);
        assert_eq!(by(0, 0o100_602, false), Holder::Others);
        assert_eq!(by(1000, 0o100_600, true), Holder::You);
        assert_eq!(by(0, 0o100_600, true), Holder::You);
        assert_eq!(by(0, 0o100_600, false), Holder::Another);
        assert_eq!(by(1001, 0o100_600, false), Holder::Others, "a stranger's");
        assert_eq!(Holder::by(1001, 0o100_600, Some(990), 0, true), Holder::Others, "root sees that, too");
        assert_eq!(Holder::by(990, 0o100_600, Some(990), 0, true), Holder::Service, "root may always");
        assert_eq!(Holder::by(0, 0o100_600, None, 1000, false), Holder::Another);
    }
}
