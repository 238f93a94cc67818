//! What the kernel shows of boards, as files with any content: attributes of UIO and PCI devices, `/proc/iomem`, lockdown, the
//! kernel's configuration. What is found is one that can be asked for, and what is mapped is there to its end.

use std::cell::RefCell;
use std::fs;
use std::path::{Path, PathBuf};

use pmac_dpram::device::board::open::open_window;
use pmac_dpram::device::board::pci::{self, PciAddress, PciInfo};
use pmac_dpram::device::machine::candidates::candidates;
use pmac_dpram::device::machine::probe::{Verdict, probe_by};
use pmac_dpram::device::system::kernel::{Configuration, Lockdown, claim, may_do_raw_io, release};
use pmac_dpram::device::uio::{UioDevice, UioInfo};
use pmac_dpram::device::{BoardSpec, Bus, Inherited, OpenError, Place, System};
use pmac_dpram::map::{HostOffset, PMAC};

use super::bus::RamBus;
use super::tape::Tape;

/// Files with a text. A `driver` is a link to it.
const TEXTS: [&str; 37] = [
    "sys/class/uio/uio0/name",
    "sys/class/uio/uio0/event",
    "sys/class/uio/uio0/dev",
    "sys/class/uio/uio0/maps/map0/name",
    "sys/class/uio/uio0/maps/map0/addr",
    "sys/class/uio/uio0/maps/map0/size",
    "sys/class/uio/uio0/maps/map0/offset",
    "sys/class/uio/uio0/maps/map1/addr",
    "sys/class/uio/uio0/maps/map1/size",
    "sys/class/uio/uio0/maps/map+1/addr",
    "sys/class/uio/uio0/maps/map+1/size",
    "sys/class/uio/uio0/maps/map4294967295/addr",
    "sys/class/uio/uio0/maps/map4294967295/size",
    "sys/class/uio/uio3/name",
    "sys/class/uio/uio3/maps/map0/addr",
    "sys/class/uio/uio3/maps/map0/size",
    "sys/class/uio/uio3/maps/map0/offset",
    "sys/bus/pci/devices/0000:03:00.0/vendor",
    "sys/bus/pci/devices/0000:03:00.0/device",
    "sys/bus/pci/devices/0000:03:00.0/resource",
    "sys/bus/pci/devices/0000:03:00.0/enable",
    "sys/bus/pci/devices/0000:03:00.0/driver",
    "sys/bus/pci/devices/0000:03:00.0/uio/uio3",
    "sys/bus/pci/devices/0000:04:1f.7/vendor",
    "sys/bus/pci/devices/0000:04:1f.7/device",
    "sys/bus/pci/devices/0000:04:1f.7/resource",
    "sys/bus/pci/devices/0000:04:1f.7/driver",
    "sys/bus/pci/devices/nonsense/vendor",
    "sys/bus/pci/devices/nonsense/resource",
    "sys/kernel/security/lockdown",
    "proc/self/status",
    "proc/iomem",
    "proc/sys/kernel/osrelease",
    "boot/config-6.1",
    "usr/lib/modules/6.1/config",
    "dev/bus/vme/m0",
    "dev/bus/vme/ctl",
];
/// Files that are memory: only their length matters.
const MEMORIES: [&str; 6] = [
    "dev/uio0",
    "dev/uio3",
    "sys/bus/pci/devices/0000:03:00.0/resource0",
    "sys/bus/pci/devices/0000:03:00.0/resource1",
    "sys/bus/pci/devices/0000:03:00.0/resource2",
    "sys/bus/pci/devices/0000:04:1f.7/resource0",
];

/// The files of the input before, most of which the next one has, too.
struct Machine {
    directory: tempfile::TempDir,
    system: System,
    texts: [Option<Vec<u8>>; TEXTS.len()],
    lengths: [Option<u64>; MEMORIES.len()],
}

thread_local! {
    static MACHINE: RefCell<Option<Machine>> = const { RefCell::new(None) };
}

/// First byte: whether a window is probed instead. Files, each a number and a text or a length; then, after the number 0xFF, what
/// is asked for.
pub fn body(data: &[u8]) {
    let mut tape = Tape::new(data);
    if tape.u8() & 15 == 15 {
        return probed(&mut tape);
    }
    MACHINE.with_borrow_mut(|place| {
        let machine = place.get_or_insert_with(Machine::new);
        machine.arrange(&mut tape);
        look(&machine.system, &mut tape);
    });
}

impl Machine {
    fn new() -> Self {
        let directory = tempfile::tempdir_in("/dev/shm").unwrap();
        for path in TEXTS.iter().chain(&MEMORIES) {
            fs::create_dir_all(directory.path().join(path).parent().unwrap()).unwrap();
        }
        let system = System::below(directory.path());
        Self { directory, system, texts: [const { None }; TEXTS.len()], lengths: [None; MEMORIES.len()] }
    }

    fn arrange(&mut self, tape: &mut Tape<'_>) {
        let mut texts: [Option<Vec<u8>>; TEXTS.len()] = [const { None }; TEXTS.len()];
        let mut lengths: [Option<u64>; MEMORIES.len()] = [None; MEMORIES.len()];
        while !tape.is_over() {
            let number = usize::from(tape.u8());
            if number == 0xFF {
                break;
            }
            let number = number % (TEXTS.len() + MEMORIES.len());
            match number.checked_sub(TEXTS.len()) {
                Some(memory) => lengths[memory] = Some(u64::from(tape.u16()) << (tape.u8() & 7)),
                None => texts[number] = Some(tape.piece().to_vec()),
            }
        }
        for ((path, old), new) in TEXTS.iter().zip(&mut self.texts).zip(texts) {
            // Whoever enables a device writes to a file.
            if *old != new || path.ends_with("enable") {
                let path = self.directory.path().join(path);
                put(&path, old.as_deref(), new.as_deref());
                *old = new;
            }
        }
        for ((path, old), new) in MEMORIES.iter().map(Path::new).zip(&mut self.lengths).zip(lengths) {
            match new {
                // What arms an interrupt writes to the node.
                Some(_) if *old == new && !path.starts_with("dev") => {}
                Some(length) => {
                    fs::File::create(self.directory.path().join(path)).unwrap().set_len(length).unwrap()
                }
                None => drop(fs::remove_file(self.directory.path().join(path))),
            }
            *old = new;
        }
    }
}

fn put(path: &Path, old: Option<&[u8]>, new: Option<&[u8]>) {
    let is_link = path.ends_with("driver");
    if old.is_some() && (is_link || new.is_none()) {
        let _ = fs::remove_file(path);
    }
    match new {
        Some(text) if is_link => {
            let text = String::from_utf8_lossy(text).replace('\0', "");
            // An empty one cannot be made.
            let _ = std::os::unix::fs::symlink(format!("../drivers/{text}"), path);
        }
        Some(text) => fs::write(path, text).unwrap(),
        None if path.ends_with("enable") => drop(fs::remove_file(path)),
        None => {}
    }
}

fn one_line(text: &str) {
    assert!(!text.is_empty() && !text.contains(char::is_control), "{text:?}");
}

fn told<T>(result: Result<T, OpenError>) -> Option<T> {
    result.inspect_err(|error| one_line(&error.to_string())).ok()
}

fn look(system: &System, tape: &mut Tape<'_>) {
    for found in candidates(system) {
        one_line(&found.what);
        found.hints.iter().for_each(|hint| one_line(hint));
        let spec: BoardSpec = found.spec.parse().expect("it can be asked for");
        if let BoardSpec::Window(spec) = spec
            && let Some(mut bus) = told(open_window(&spec, PMAC.length as usize, system))
            && matches!(spec.place, Place::Pci { .. })
        {
            let last = HostOffset::new(PMAC.length - 2);
            assert!(bus.read16(HostOffset::new(0)).is_ok() && bus.read16(last).is_ok());
        }
    }
    for info in PciInfo::all(system) {
        assert!(info.bars.len() <= 6 && info.bars.iter().all(|bar| bar.size() > 0 && bar.number < 6));
    }
    let (number, offset, length) =
        (tape.u8(), tape.u64() >> (tape.u8() & 63), usize::from(tape.u16()) * 2 + 2);
    for address in ["0000:03:00.0", "0000:04:1f.7", "0000:05:00.0"] {
        let address: PciAddress = address.parse().unwrap();
        let bar = (number & 8 == 0).then_some(number & 7);
        if let Some((mapping, file)) = told(pci::map(system, address, bar, offset, length)) {
            assert!(file.metadata().unwrap().len() >= offset + length as u64);
            assert!(
                mapping.length() == length
                    && mapping.read16(0).is_some()
                    && mapping.read16(length - 2).is_some()
            );
        }
    }
    for info in UioInfo::all(system) {
        let node = PathBuf::from(format!("/dev/{}", info.device));
        let Some(device) = told(UioDevice::open(system, &Inherited::default(), &node)) else { continue };
        assert_eq!(device.info(), &info);
        let map = [0, 1, 2, u32::MAX][usize::from(number & 3)];
        if let Some(mapping) = told(device.map(map, offset, length)) {
            let size = info.maps.iter().find(|info| info.number == map).unwrap().size;
            assert!(mapping.length() == length && offset + length as u64 <= size);
        }
        let _ = device.interrupt().map_err(|error| one_line(&error.to_string()));
    }
    let start = tape.u64() >> (tape.u8() & 63);
    let range = start..start.saturating_add(u64::from(tape.u32()));
    let _ = (claim(system, &range), Lockdown::of(system), may_do_raw_io(system), release(system));
    let _ = Configuration::of(system).value("STRICT_DEVMEM");
    if let Ok(text) = std::str::from_utf8(tape.rest())
        && let Ok(address) = text.parse::<PciAddress>()
    {
        assert_eq!(address.to_string().parse(), Ok(address));
    }
}

/// A window in which anything changes between two looks, and in the midst of one.
fn probed(tape: &mut Tape<'_>) {
    let mut bus = RamBus::new([0, u16::MAX, 0x8000, 1][usize::from(tape.u8() & 3)]);
    let mut looks = 0;
    let seen = probe_by(&mut bus, &PMAC, |bus| {
        looks += 1;
        for _ in 0..if tape.is_over() { 0 } else { tape.u8() & 3 } {
            let how = tape.u8();
            bus.change(how, tape);
        }
    });
    let seen = seen.expect("the window is as long as a DPRAM");
    assert!(looks >= seen.timer_moves && seen.ones + seen.zeros <= seen.words);
    assert_eq!(seen.verdict == Verdict::Reporting, seen.servo_hz.is_some_and(f64::is_finite));
    assert_eq!(seen.verdict == Verdict::Absent, seen.ones == seen.words);
    bus.assert_written("probe", |_| false);
}
