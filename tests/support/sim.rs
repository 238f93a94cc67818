//! `pmac-sim` as a process, without a daemon: its sockets, and its memory as a host sees it.

use std::fs::OpenOptions;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command};

use pmac_dpram::device::mapping::Mapping;
use tempfile::TempDir;

use super::{Control, PATIENCE, status_within, wait_until};

/// A running simulator; killed when the test ends.
pub struct Sim {
    pub child: Child,
    pub directory: TempDir,
    control: Control,
    pub memory: Mapping,
}

/// Connects as soon as a process listens.
pub fn connect(path: &Path) -> UnixStream {
    let mut stream = None;
    wait_until("a socket", || {
        stream = UnixStream::connect(path).ok();
        stream.is_some()
    });
    let stream = stream.unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream
}

impl Sim {
    pub fn start(options: &[&str]) -> Self {
        let directory = tempfile::tempdir_in("/dev/shm").unwrap();
        let (child, control) = spawn(directory.path(), options);
        let file = OpenOptions::new().read(true).write(true).open(directory.path().join("dpram")).unwrap();
        let memory = Mapping::new(&file, 0, 0x4000).unwrap();
        Self { child, directory, control, memory }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.directory.path().join(name)
    }

    /// Kills it, and starts another one with the same memory.
    pub fn replace(&mut self, options: &[&str]) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
        (self.child, self.control) = spawn(self.directory.path(), options);
    }

    /// The answer on the control socket, errors included.
    pub fn ask(&mut self, command: &str) -> String {
        self.control.try_ask(command)
    }

    pub fn ok(&mut self, command: &str) {
        assert_eq!(self.ask(command), "ok", "{command}");
    }

    pub fn status(&mut self, key: &str) -> u64 {
        let status: serde_json::Value = serde_json::from_str(&self.ask("status")).unwrap();
        status[key].as_u64().unwrap()
    }

    pub fn socket(&self, name: &str) -> UnixStream {
        connect(&self.path(name))
    }

    pub fn read(&self, offset: usize) -> u16 {
        self.memory.read16(offset).unwrap()
    }

    pub fn write(&self, offset: usize, value: u16) {
        self.memory.write16(offset, value).unwrap();
    }

    pub fn write_text(&self, text: &str) {
        let mut bytes = text.as_bytes().to_vec();
        bytes.resize(bytes.len() / 2 * 2 + 2, 0);
        for (index, pair) in bytes.chunks(2).enumerate() {
            self.write(0x0630 + 2 * index, u16::from_le_bytes([pair[0], pair[1]]));
        }
    }

    /// Waits until it ends.
    pub fn wait(&mut self) -> Option<i32> {
        status_within(&mut self.child, PATIENCE).code()
    }
}

fn spawn(directory: &Path, options: &[&str]) -> (Child, Control) {
    let at = |name: &str| directory.join(name);
    let child = Command::new(env!("CARGO_BIN_EXE_pmac-sim"))
        .arg("--memory")
        .arg(at("dpram"))
        .args(["control", "serial", "interrupt"].map(|name| format!("--{name}=unix:{}", at(name).display())))
        .args(options)
        .spawn()
        .unwrap();
    // The simulator listens on the control socket only after it has set up the memory.
    drop(connect(&at("control")));
    (child, Control::open(&at("control")))
}

impl Drop for Sim {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
