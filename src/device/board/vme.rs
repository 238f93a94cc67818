//! `vme:`: a master window of a VME bridge, as a node that can be mapped (`/dev/bus/vme/m0` of the kernel's vme_user).
//!
//! The machine's set-up gives the window its address on the VME bus, its address modifier and its width. This module
//! only maps the window, always from its start: the kernel would add an offset twice. vme_master_mmap passes the
//! offset to vm_iomap_memory as a part of the address and as the page to begin at, and vm_iomap_memory refuses with
//! EINVAL (drivers/staging/vme_user/vme.c).

use std::fs::{File, OpenOptions};
use std::io::{self, Seek, SeekFrom};
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;

use nix::fcntl::OFlag;

use crate::device::mapping::Mapping;
use crate::device::refusal::{OpenError, Why, node_refused};
use crate::device::system::System;

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
    let mut options = OpenOptions::new();
    options.read(true).write(true).custom_flags((OFlag::O_SYNC | OFlag::O_CLOEXEC).bits());
    let mut file = options.open(system.path(node)).map_err(|error| {
        let missing =
            "the kernel needs a driver of the VME bridge and vme_user, which distributions do not build";
        let permission = "have a udev rule give the node to user pmacd alone (mode 0600; pmacctl doctor --boards \
            prints the rule)";
        refuse(node_refused(system, node, error, missing, permission))
    })?;
    let io = |doing: &str, source| refuse(Why::Io { doing: doing.to_owned(), source });
    let size = file.seek(SeekFrom::End(0)).map_err(|error| io("asking for the window's size", error))?;
    let needed = offset.saturating_add(length as u64);
    if size < needed {
        return Err(refuse(Why::Unsuitable(format!(
            "the window has {size:#x} bytes, {needed:#x} are needed; set it up (address, size, address modifier, \
            width) before the daemon starts"
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
}
