//! `mem:`: physical memory through /dev/mem, for boards at a fixed bus address (ISA, a VME bridge's window).
//!
//! Maps exactly the window, uncached (`O_SYNC`), and closes the descriptor again, which gives access to all of the
//! machine's memory.

use std::fs::{File, OpenOptions};
use std::io;
use std::ops::Range;
use std::os::fd::AsFd;
use std::os::unix::fs::{FileTypeExt, MetadataExt, OpenOptionsExt};
use std::path::Path;

use nix::fcntl::{FcntlArg, OFlag, fcntl};
use nix::unistd::{AccessFlags, access};

use crate::device::mapping::Mapping;
use crate::device::refusal::{OpenError, Why, raw_node_refused};
use crate::device::system::System;
use crate::device::system::inherited::Inherited;
use crate::device::system::kernel::{Claim, Lockdown, claim, may_do_raw_io};

/// The node for physical memory.
const NODE: &str = "/dev/mem";
/// The name of the descriptor that a service manager may hand over instead.
pub const HANDED_OVER: &str = "mem";
/// Below 1 MiB the processor's fixed memory types decide about caching, whatever a mapping asks for.
#[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
const FIXED_RANGES: u64 = 0x10_0000;

/// Maps `length` bytes of physical memory from `address` on.
///
/// # Errors
/// [`OpenError`], which distinguishes a missing permission, a missing capability, lockdown and the two STRICT_DEVMEM.
pub fn map(
    system: &System,
    inherited: &Inherited,
    address: u64,
    length: usize,
) -> Result<Mapping, OpenError> {
    let refuse = |why| OpenError::new(format!("mem:{address:#x}"), why);
    let range = address..address.saturating_add(length as u64);
    let file = match inherited.find(HANDED_OVER) {
        Some(file) => {
            check_handed_over(&file, &range).map_err(refuse)?;
            file
        }
        None => open(system).map_err(refuse)?,
    };
    check_length(&file, &range).map_err(refuse)?;
    Mapping::new(&file, address, length).map_err(|error| refuse(map_refused(system, range, error)))
}

/// Checks without opening /dev/mem whether this process may open it.
///
/// # Errors
/// The reason why not, with the cure.
pub fn may_open(system: &System) -> Result<(), Why> {
    let path = Path::new(NODE);
    let refused = |errno| Err(raw_node_refused(system, path, io::Error::from_raw_os_error(errno)));
    if let Err(errno) = access(&system.path(path), AccessFlags::R_OK | AccessFlags::W_OK) {
        return refused(errno as i32);
    }
    // The kernel checks these when a process opens the node, and answers EPERM.
    if Lockdown::of(system).mode().is_some() || !may_do_raw_io(system) {
        refused(libc::EPERM)
    } else {
        Ok(())
    }
}

fn open(system: &System) -> Result<File, Why> {
    let path = Path::new(NODE);
    let mut options = OpenOptions::new();
    // Without O_SYNC the kernel caches the mapping of addresses that it takes for memory.
    options.read(true).write(true).custom_flags((OFlag::O_SYNC | OFlag::O_CLOEXEC).bits());
    options.open(system.path(path)).map_err(|error| raw_node_refused(system, path, error))
}

/// An inherited descriptor must be /dev/mem, writable, and uncached.
fn check_handed_over(file: &File, range: &Range<u64>) -> Result<(), Why> {
    let io =
        |source: io::Error| Why::Io { doing: "inspecting the descriptor handed over".to_owned(), source };
    let metadata = file.metadata().map_err(io)?;
    let unsuitable = |what: &str| Err(Why::Unsuitable(format!("the descriptor handed over as `mem` {what}")));
    if metadata.file_type().is_char_device() && metadata.rdev() != nix::sys::stat::makedev(1, 1) {
        return unsuitable("is not /dev/mem but another device; correct OpenFile= of the service");
    }
    let flags = fcntl(file.as_fd(), FcntlArg::F_GETFL).map_err(|errno| io(errno.into()))?;
    let flags = OFlag::from_bits_truncate(flags);
    if flags & OFlag::O_ACCMODE != OFlag::O_RDWR {
        return unsuitable("is not open for reading and writing; leave `read-only` out of OpenFile=");
    }
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    if metadata.file_type().is_char_device() && range.end > FIXED_RANGES && !flags.contains(OFlag::O_SYNC) {
        return unsuitable(
            "was opened without O_SYNC, as systemd does, so a window above 1 MiB would be cached; let the service \
            open /dev/mem itself (AmbientCapabilities=CAP_SYS_RAWIO), or use a UIO driver",
        );
    }
    // Elsewhere the kernel caches nothing that is no memory.
    #[cfg(not(any(target_arch = "x86", target_arch = "x86_64")))]
    let _ = range;
    Ok(())
}

/// A file used in place of /dev/mem must reach to the window's end: an access beyond it would kill the process.
fn check_length(file: &File, range: &Range<u64>) -> Result<(), Why> {
    match file.metadata() {
        Ok(metadata) if metadata.is_file() && metadata.len() < range.end => Err(Why::Unsuitable(format!(
            "the file that stands for the machine's memory ends at {:#x}, before the window does at {:#x}",
            metadata.len(),
            range.end
        ))),
        _ => Ok(()),
    }
}

/// Why the kernel did not map `range`.
fn map_refused(system: &System, range: Range<u64>, error: io::Error) -> Why {
    match error.raw_os_error() {
        Some(libc::EPERM) => match claim(system, &range) {
            Claim::MainMemory => Why::MainMemory(range),
            Claim::By(by) => Why::Claimed { range, by },
            Claim::Nobody | Claim::Hidden => Why::Restricted(range),
        },
        Some(libc::EINVAL | libc::EAGAIN) => Why::NotMappable(range),
        _ => Why::Io { doing: "mapping it".to_owned(), source: error },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::testing::FakeSystem;

    fn refused(fake: &FakeSystem) -> Why {
        map(&fake.system, &Inherited::default(), 0xD4000, 0x4000).err().unwrap().why
    }

    fn eperm() -> io::Error {
        io::Error::from_raw_os_error(libc::EPERM)
    }

    #[test]
    fn the_window_begins_at_the_address_even_inside_a_page() {
        let fake = FakeSystem::new();
        fake.memory("dev/mem", 0x10_0000);
        let window = map(&fake.system, &Inherited::default(), 0xD_4802, 0x4000).unwrap();
        assert_eq!(window.length(), 0x4000);
        window.write16(0x3FFE, 0x1234).unwrap();
        let file = File::open(fake.path("dev/mem")).unwrap();
        let mut bytes = [0; 2];
        std::os::unix::fs::FileExt::read_exact_at(&file, &mut bytes, 0xD_8800).unwrap();
        assert_eq!(bytes, [0x34, 0x12]);
    }

    #[test]
    fn what_would_keep_one_out_is_found_without_opening() {
        let fake = FakeSystem::new();
        assert!(matches!(may_open(&fake.system), Err(Why::Missing { .. })));
        fake.memory("dev/mem", 16);
        assert!(matches!(may_open(&fake.system), Err(Why::RawIo(_))));
        fake.file("proc/self/status", "CapEff:\t0000000000020000\n");
        assert!(may_open(&fake.system).is_ok());
        fake.file("sys/kernel/security/lockdown", "[integrity]");
        assert!(matches!(may_open(&fake.system), Err(Why::Lockdown(..))));
    }

    #[test]
    fn a_missing_or_short_node_is_told() {
        let fake = FakeSystem::new();
        assert!(matches!(refused(&fake), Why::Missing { .. }));
        fake.memory("dev/mem", 0xD_7FFE);
        assert!(refused(&fake).to_string().contains("ends at 0xd7ffe"));
    }

    #[test]
    fn what_the_kernel_refuses_at_opening_is_told_apart() {
        let why = |fake: &FakeSystem, errno| {
            raw_node_refused(&fake.system, Path::new(NODE), io::Error::from_raw_os_error(errno))
        };
        let fake = FakeSystem::new();
        assert!(matches!(why(&fake, libc::EACCES), Why::Permission { .. }));
        assert!(matches!(why(&fake, libc::EPERM), Why::RawIo(_)));
        fake.file("proc/self/status", "CapEff:\t0000000000020000\n");
        assert!(matches!(why(&fake, libc::EPERM), Why::DeviceControl(_)));
        fake.file("sys/kernel/security/lockdown", "none [integrity] confidentiality");
        let why = why(&fake, libc::EPERM);
        assert!(matches!(&why, Why::Lockdown(mode, _) if mode == "integrity"), "{why}");
        assert!(why.to_string().contains("UIO"), "{why}");
    }

    #[test]
    fn what_the_kernel_refuses_at_mapping_is_told_apart() {
        let fake = FakeSystem::new();
        let range = 0xFEBF_0000..0xFEBF_4000;
        let why = |fake: &FakeSystem| map_refused(&fake.system, range.clone(), eperm());
        assert!(matches!(why(&fake), Why::Restricted(_)));
        fake.file("proc/iomem", "febf0000-febf3fff : foo\n");
        let claimed = why(&fake);
        assert!(matches!(&claimed, Why::Claimed { by, .. } if by == "foo"), "{claimed}");
        assert!(claimed.to_string().contains("0xfebf0000 to 0xfebf3fff is claimed by foo"), "{claimed}");
        fake.file("proc/iomem", "00100000-ffffffff : System RAM\n");
        assert!(matches!(why(&fake), Why::MainMemory(_)));
        let invalid = io::Error::from_raw_os_error(libc::EINVAL);
        assert!(matches!(map_refused(&fake.system, range.clone(), invalid), Why::NotMappable(_)));
    }

    #[test]
    fn a_descriptor_handed_over_is_used_and_looked_at_first() {
        let fake = FakeSystem::new();
        fake.memory("elsewhere", 0x10_0000);
        let open =
            |write: bool| File::options().read(true).write(write).open(fake.path("elsewhere")).unwrap();
        let with = |file: File| {
            let inherited = Inherited::of(vec![(HANDED_OVER.to_owned(), file.into())]);
            map(&fake.system, &inherited, 0xD_4000, 0x4000)
        };
        assert!(with(open(true)).is_ok(), "there is no /dev/mem here at all");
        let why = with(open(false)).err().unwrap().to_string();
        assert!(why.contains("not open for reading and writing"), "{why}");
        let why = with(File::options().read(true).write(true).open("/dev/null").unwrap()).err().unwrap();
        assert!(why.to_string().contains("another device"), "{why}");
    }
}
