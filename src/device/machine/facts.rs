//! The machine's facts in a capture: files of the kernel about itself, the processors, and the board's device,
//! unchanged. None of them names a user, the host, or another process.

use std::collections::BTreeMap;

use crate::device::board::open::described;
use crate::device::system::System;
use crate::device::system::kernel::{Configuration, PCI_DEVICES};
use crate::device::uio::{CLASS, UioInfo};
use crate::device::{BoardSpec, Place};

/// The kernel and its processors.
const MACHINE: [&str; 11] = [
    "/proc/sys/kernel/osrelease",
    "/proc/sys/kernel/version",
    "/proc/sys/kernel/sched_rt_runtime_us",
    "/sys/kernel/realtime",
    "/sys/kernel/security/lockdown",
    "/sys/devices/system/clocksource/clocksource0/current_clocksource",
    "/sys/devices/system/cpu/cpufreq/policy0/scaling_governor",
    "/sys/devices/system/cpu/cpuidle/current_driver",
    "/sys/devices/system/cpu/isolated",
    "/sys/devices/system/cpu/nohz_full",
    "/sys/devices/system/cpu/online",
];
/// Build options of the kernel.
const OPTIONS: [&str; 8] = [
    "HZ",
    "IO_STRICT_DEVMEM",
    "NO_HZ_FULL",
    "PREEMPT_RT",
    "STRICT_DEVMEM",
    "UIO",
    "UIO_PCI_GENERIC",
    "VME_BUS",
];
/// Files of a PCI device.
const PCI: [&str; 8] =
    ["class", "device", "irq", "resource", "revision", "subsystem_device", "subsystem_vendor", "vendor"];
/// Files of a UIO device.
const UIO: [&str; 3] = ["event", "name", "version"];
/// Files of a UIO device's map.
const UIO_MAP: [&str; 4] = ["addr", "name", "offset", "size"];
/// The longest text that a capture keeps of a file, in characters.
const LONGEST_FACT: usize = 2000;

/// Each readable file with its text, and each known kernel option, for a machine whose board is `board`.
#[must_use]
pub fn facts(system: &System, board: Option<&BoardSpec>) -> BTreeMap<String, String> {
    let mut paths: Vec<String> = MACHINE.iter().map(|&path| path.to_owned()).collect();
    if let Some(BoardSpec::Window(window)) = board {
        match &described(system, &window.place) {
            Place::Pci { address, .. } => paths.extend(below(&format!("{PCI_DEVICES}/{address}"), &PCI)),
            Place::Uio { node, .. } => {
                let device = node.file_name().and_then(|name| name.to_str()).unwrap_or_default();
                paths.extend(uio(system, device));
            }
            Place::Memory(_) | Place::Vme(_) => {}
        }
    }
    let text = |path: &String| Some(system.text(path).ok()?.chars().take(LONGEST_FACT).collect::<String>());
    let files = paths.iter().filter_map(|path| Some((path.clone(), text(path)?)));
    let configuration = Configuration::of(system);
    let value = |option: &&str| Some((format!("CONFIG_{option}"), configuration.value(option)?.to_owned()));
    files.chain(OPTIONS.iter().filter_map(value)).collect()
}

fn below<'a>(directory: &'a str, names: &'a [&str]) -> impl Iterator<Item = String> + 'a {
    names.iter().map(move |name| format!("{directory}/{name}"))
}

/// A UIO device, its maps, and the PCI device behind it, if it is one.
fn uio(system: &System, device: &str) -> Vec<String> {
    let directory = format!("{CLASS}/{device}");
    let maps = UioInfo::of(system, device).map(|info| info.maps).unwrap_or_default();
    let mut paths: Vec<String> = below(&directory, &UIO).collect();
    paths.extend(
        maps.iter().flat_map(|map| {
            below(&format!("{directory}/maps/map{}", map.number), &UIO_MAP).collect::<Vec<_>>()
        }),
    );
    paths.extend(below(&format!("{directory}/device"), &PCI));
    paths
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::testing::FakeSystem;

    #[test]
    fn the_boards_device_is_told_and_nothing_that_names_somebody() {
        let fake = FakeSystem::new();
        fake.file("proc/sys/kernel/osrelease", "6.1.0-rt\n");
        fake.file("proc/sys/kernel/hostname", "secret\n");
        fake.file("boot/config-6.1.0-rt", "CONFIG_PREEMPT_RT=y\n");
        fake.file("sys/bus/pci/devices/0000:03:00.0/vendor", "0x1172\n");
        fake.file("sys/class/uio/uio3/name", "pmac-dpram\n");
        fake.file("sys/class/uio/uio3/maps/map0/addr", "0xd4000\n");
        fake.file("sys/class/uio/uio3/maps/map0/size", "0x4000\n");
        let found = |spec: &str| facts(&fake.system, Some(&spec.parse().unwrap()));
        let pci = found("pci:0000:03:00.0");
        assert_eq!(pci["/sys/bus/pci/devices/0000:03:00.0/vendor"], "0x1172");
        assert_eq!((pci["CONFIG_PREEMPT_RT"].as_str(), pci["CONFIG_UIO"].as_str()), ("y", "n"));
        let uio = found("uio:/dev/uio3");
        assert_eq!(uio["/sys/class/uio/uio3/maps/map0/addr"], "0xd4000");
        assert!(!format!("{pci:?}{uio:?}").contains("secret"));
        assert_eq!(facts(&fake.system, None)["/proc/sys/kernel/osrelease"], "6.1.0-rt");
    }
}
