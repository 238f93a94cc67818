//! For tests: a machine made of ordinary files in its own directory.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::PathBuf;

use crate::device::system::System;

/// The files; removed on drop.
pub struct FakeSystem {
    directory: tempfile::TempDir,
    /// The machine.
    pub system: System,
}

impl FakeSystem {
    /// A machine without any file.
    pub fn new() -> Self {
        let directory = tempfile::tempdir().unwrap();
        let system = System::below(directory.path());
        Self { directory, system }
    }

    /// The path of a file.
    pub fn path(&self, path: &str) -> PathBuf {
        self.directory.path().join(path)
    }

    /// Makes a file of mode 0600, and the directories above it.
    pub fn file(&self, path: &str, content: &str) {
        let path = self.path(path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, content).unwrap();
        // Sets the mode that the kernel gives nodes, whatever this process's umask.
        fs::set_permissions(path, fs::Permissions::from_mode(0o600)).unwrap();
    }

    /// Makes a file of zeros.
    pub fn memory(&self, path: &str, length: u64) {
        self.file(path, "");
        fs::File::options().write(true).open(self.path(path)).unwrap().set_len(length).unwrap();
    }

    /// Makes a symbolic link.
    pub fn link(&self, path: &str, target: &str) {
        let path = self.path(path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::os::unix::fs::symlink(target, path).unwrap();
    }

    /// A UIO device with one map, and a node of `node_bytes` zeros.
    pub fn uio(&self, number: u32, name: &str, address: u64, size: u64, offset: u64, node_bytes: u64) {
        let class = format!("sys/class/uio/uio{number}");
        self.file(&format!("{class}/name"), &format!("{name}\n"));
        self.file(&format!("{class}/event"), "0\n");
        self.file(&format!("{class}/dev"), &format!("240:{number}\n"));
        self.uio_map(number, 0, "dpram", address, size, offset);
        self.memory(&format!("dev/uio{number}"), node_bytes);
    }

    /// A further map of a UIO device.
    pub fn uio_map(&self, number: u32, map: u32, name: &str, address: u64, size: u64, offset: u64) {
        let map = format!("sys/class/uio/uio{number}/maps/map{map}");
        self.file(&format!("{map}/name"), &format!("{name}\n"));
        self.file(&format!("{map}/addr"), &format!("{address:#018x}\n"));
        self.file(&format!("{map}/size"), &format!("{size:#018x}\n"));
        self.file(&format!("{map}/offset"), &format!("{offset:#x}\n"));
    }
}
