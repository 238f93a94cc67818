//! `vme:`: a master window of a VME bridge, as a node that can be mapped (`/dev/bus/vme/m0` of the kernel's vme_user).
//!
//! Whoever set up the machine set the window's address on the VME bus, its address modifier and its width; here it is
//! only mapped.

use std::fs::{File, OpenOptions};
use std::io::{Seek, SeekFrom};
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;

use nix::fcntl::OFlag;

use crate::device::board::mapping::Mapping;
use crate::device::board::refusal::{OpenError, Why, node_refused};
use crate::device::machine::system::System;

/// Maps `length` bytes of the window at `node` from `offset` on, and returns the mapped file.
///
/// # Errors
/// [`OpenError`] when there is no such node, this user may not use it, or the window is not set up or too short.
pub fn map(system: &System, node: &Path, offset: u64, length: usize) -> Result<(Mapping, File), OpenError> {
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
    match Mapping::new(&file, offset, length) {
        Ok(mapping) => Ok((mapping, file)),
        Err(error) => Err(io("mapping it (is the window enabled, and does its bridge's driver map?)", error)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::testing::FakeSystem;

    #[test]
    fn the_window_is_mapped_from_the_offset_on_if_it_is_long_enough() {
        let fake = FakeSystem::new();
        let node = Path::new("/dev/bus/vme/m0");
        assert!(matches!(map(&fake.system, node, 0, 0x4000).err().unwrap().why, Why::Missing { .. }));
        fake.memory("dev/bus/vme/m0", 0xC000);
        map(&fake.system, node, 0x8000, 0x4000).unwrap().0.write16(0, 0x1234).unwrap();
        assert_eq!(std::fs::read(fake.path("dev/bus/vme/m0")).unwrap()[0x8000..0x8002], [0x34, 0x12]);
        let error = map(&fake.system, node, 0x8002, 0x4000).err().unwrap().to_string();
        assert!(error.contains("has 0xc000 bytes, 0xc002 are needed"), "{error}");
    }
}
