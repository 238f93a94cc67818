//! `vme:`: a master window of a VME bridge, as a node that can be mapped (`/dev/bus/vme/m0` of the kernel's vme_user).
//!
//! [`set_window`] gives the window its address on the VME bus, its address lines and its width. [`map`] maps it always from
//! its start: the kernel would add an offset twice. vme_master_mmap passes the offset to vm_iomap_memory as a part of the
//! address and as the page to begin at, and vm_iomap_memory refuses with EINVAL (drivers/staging/vme_user/vme.c).

use std::fs::{File, OpenOptions};
use std::io::{self, Seek, SeekFrom};
use std::os::unix::fs::{FileTypeExt, MetadataExt, OpenOptionsExt};
use std::path::Path;

use nix::errno::Errno;
use nix::fcntl::OFlag;
use nix::sys::stat::{major, minor};

use crate::device::mapping::{Mapping, set_vme_master};
use crate::device::refusal::{OpenError, Why, node_refused};
use crate::device::system::System;
use crate::setup::vme::{AddressBits, BridgeWindow};

/// The major number of vme_user's nodes (Documentation/admin-guide/devices.txt).
const VME_MAJOR: u64 = 221;
/// The minor numbers of its master windows: m0 to m3.
const MASTERS: std::ops::Range<u64> = 0..4;
/// Single cycles of user data, and accesses of 16 bits: VME_SCT, VME_USER, VME_DATA and VME_D16.
const CYCLE: u32 = 0x1 | 0x2000 | 0x8000;
const D16: u32 = 0x2;

/// Has the bridge show `window` of the VME bus at `node`, until the bridge's driver is unloaded: vme_user leaves the window as it is.
///
/// # Errors
/// [`OpenError`] when the machine has no such node, this user may not use it, it is no master window, or the bridge
/// cannot show that.
pub fn set_window(system: &System, node: &Path, window: BridgeWindow) -> Result<(), OpenError> {
    let refuse = |why| OpenError::new(format!("vme:{}", node.display()), why);
    let file = open(system, node).map_err(refuse)?;
    let io = |doing: &str, source| refuse(Why::Io { doing: doing.to_owned(), source });
    let found = file.metadata().map_err(|error| io("asking for its kind", error))?;
    let is_master = major(found.rdev()) == VME_MAJOR && MASTERS.contains(&minor(found.rdev()));
    if !found.file_type().is_char_device() || !is_master {
        let text = "it is no master window of vme_user; write one of /dev/bus/vme/m0 to m3";
        return Err(refuse(Why::Unsuitable(text.to_owned())));
    }
    set_vme_master(&file, &vme_master(window)).map_err(|errno| match errno {
        Errno::EPERM => refuse(Why::Unsuitable(
            "a program has mapped the window; stop pmacd, and whatever else uses this node, first".to_owned(),
        )),
        errno => io(
            "setting it (the bridge may have no such window, or no room for its size: see dmesg; another node may do)",
            errno.into(),
        ),
    })
}

/// The kernel's packed `struct vme_master` (drivers/staging/vme_user/vme_user.h): enable, vme_addr, size, aspace, cycle,
/// dwidth.
fn vme_master(window: BridgeWindow) -> [u8; 32] {
    let aspace: u32 = match window.address_bits {
        AddressBits::A16 => 0x1,
        AddressBits::A24 => 0x2,
        AddressBits::A32 => 0x4,
    };
    let mut bytes = [0; 32];
    bytes[..4].copy_from_slice(&1_u32.to_ne_bytes());
    bytes[4..12].copy_from_slice(&u64::from(window.address).to_ne_bytes());
    bytes[12..20].copy_from_slice(&u64::from(window.size).to_ne_bytes());
    for (place, number) in bytes[20..].chunks_exact_mut(4).zip([aspace, CYCLE, D16]) {
        place.copy_from_slice(&number.to_ne_bytes());
    }
    bytes
}

fn open(system: &System, node: &Path) -> Result<File, Why> {
    let mut options = OpenOptions::new();
    options.read(true).write(true).custom_flags((OFlag::O_SYNC | OFlag::O_CLOEXEC).bits());
    options.open(system.path(node)).map_err(|error| {
        let missing =
            "the kernel needs a driver of the VME bridge and pmac_vme or vme_user, which distributions do not build";
        let permission = "have a udev rule give the node to user pmacd alone (mode 0600; pmacctl doctor --boards \
            prints the rule)";
        node_refused(system, node, error, missing, permission)
    })
}

/// Maps `length` bytes of the window at `node` from `offset` on, and returns the mapped file.
///
/// # Errors
/// [`OpenError`] when the machine has no such node, this user may not use it, or the window is not set up or too
/// short.
pub fn map(system: &System, node: &Path, offset: u64, length: usize) -> Result<(Mapping, File), OpenError> {
    map_by(Mapping::within, system, node, offset, length)
}

/// As [`map`], by the kernel's `mmap` or a test's: `mmap` takes a file, a start, the bytes to skip, and a length.
fn map_by(
    mmap: impl FnOnce(&File, u64, usize, usize) -> io::Result<Mapping>,
    system: &System,
    node: &Path,
    offset: u64,
    length: usize,
) -> Result<(Mapping, File), OpenError> {
    let refuse = |why| OpenError::new(format!("vme:{}", node.display()), why);
    let mut file = open(system, node).map_err(refuse)?;
    let io = |doing: &str, source| refuse(Why::Io { doing: doing.to_owned(), source });
    let size = file.seek(SeekFrom::End(0)).map_err(|error| io("asking for the window's size", error))?;
    let needed = offset.saturating_add(length as u64);
    if size < needed {
        return Err(refuse(Why::Unsuitable(format!(
            "the window has {size:#x} bytes, {needed:#x} are needed; set it by pmacctl setup vme --window before the \
            daemon starts"
        ))));
    }
    let skip = usize::try_from(offset).map_err(|_| io("mapping it", io::ErrorKind::InvalidInput.into()))?;
    match mmap(&file, 0, skip, length) {
        Ok(mapping) => Ok((mapping, file)),
        Err(error) => Err(io("mapping it (is the window enabled, and does its bridge's driver map?)", error)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::testing::FakeSystem;

    /// Maps as vme_user does: only from the window's start.
    fn by_vme_user(file: &File, start: u64, skip: usize, length: usize) -> io::Result<Mapping> {
        if start > 0 {
            return Err(nix::Error::EINVAL.into());
        }
        Mapping::within(file, start, skip, length)
    }

    #[test]
    fn an_offset_of_pages_lies_inside_a_mapping_of_the_whole_window() {
        let fake = FakeSystem::new();
        let node = Path::new("/dev/bus/vme/m0");
        let map = |offset, length| map_by(by_vme_user, &fake.system, node, offset, length);
        assert!(matches!(map(0, 0x4000).err().unwrap().why, Why::Missing { .. }));
        fake.memory("dev/bus/vme/m0", 0xC000);
        for (offset, value) in [(0, 0x0102), (0x4000, 0x0304), (0x8000, 0x1234), (0x6FF0, 0x0506)] {
            map(offset, 0x4000).unwrap().0.write16(0, value).unwrap();
            let bytes = std::fs::read(fake.path("dev/bus/vme/m0")).unwrap();
            assert_eq!(bytes[offset as usize..][..2], value.to_le_bytes(), "{offset:#x}");
        }
        let error = map(0x8002, 0x4000).err().unwrap().to_string();
        assert!(error.contains("has 0xc000 bytes, 0xc002 are needed"), "{error}");
    }

    /// The bytes that GCC 12 lays out on x86-64 for
    /// `struct vme_master m = { 1, 0x700000, 0x100000, VME_A24, VME_SCT | VME_USER | VME_DATA, VME_D16 };`
    #[cfg(target_endian = "little")]
    #[test]
    fn a_windows_bytes_are_those_of_the_kernels_header() {
        let bytes =
            vme_master(BridgeWindow { address: 0x70_0000, size: 0x10_0000, address_bits: AddressBits::A24 });
        let as_text: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(
            as_text,
            concat!("01000000", "0000700000000000", "0000100000000000", "02000000", "01a00000", "02000000")
        );
        for (address_bits, aspace) in [(AddressBits::A16, 1), (AddressBits::A32, 4)] {
            assert_eq!(vme_master(BridgeWindow { address: 0, size: 0x10000, address_bits })[20], aspace);
        }
    }

    #[test]
    fn a_node_that_is_no_master_window_gets_no_request() {
        let window = BridgeWindow { address: 0, size: 0x10000, address_bits: AddressBits::A16 };
        let fake = FakeSystem::new();
        let node = Path::new("/dev/bus/vme/m0");
        let refused =
            |system: &System, node: &Path| set_window(system, node, window).unwrap_err().to_string();
        assert!(refused(&fake.system, node).contains("there is no /dev/bus/vme/m0; the kernel needs"));
        fake.memory("dev/bus/vme/m0", 0x10000);
        for text in [refused(&fake.system, node), refused(&System::here(), Path::new("/dev/null"))] {
            assert!(
                text.contains("no master window of vme_user; write one of /dev/bus/vme/m0 to m3"),
                "{text}"
            );
        }
    }
}
