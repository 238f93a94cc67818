//! A private directory with all files of one board, and the programs and sockets that serve the board.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};

use pmac_dpram::client::Connection;
use pmac_dpram::segment::{RegionId, SegmentName, Subscriber};

use super::rig::{Ran, command};
use super::{PATIENCE, is_live, wait_until};

/// The directory, and the board's name. Dropping it removes its files and its segment.
pub struct Place {
    pub directory: tempfile::TempDir,
    pub name: String,
}

impl Place {
    pub fn new() -> Self {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        Self {
            directory: tempfile::tempdir_in("/dev/shm").unwrap(),
            name: format!("pmac-test-{}-{number}", std::process::id()),
        }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.directory.path().join(name)
    }

    /// Creates a file `name` that contains `text`, and returns its path.
    pub fn file(&self, name: &str, text: &str) -> String {
        let path = self.path(name);
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    }

    pub fn socket(&self) -> PathBuf {
        self.path("socket")
    }

    pub fn segment(&self) -> SegmentName {
        SegmentName::new(&self.name).unwrap()
    }

    pub fn attach(&self) -> Subscriber {
        Subscriber::attach(&self.segment()).unwrap()
    }

    pub fn connection(&self) -> Connection {
        Connection::open(&self.socket()).unwrap()
    }

    pub fn connection_refused(&self) -> bool {
        Connection::open(&self.socket()).is_err()
    }

    /// `pmacctl` for this daemon, with no input.
    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = command();
        command.args(["--name", &self.name]).arg("--socket").arg(self.socket()).args(arguments);
        command.stdin(Stdio::null());
        command
    }

    /// Runs `pmacctl` for this daemon.
    pub fn run(&self, arguments: &[&str]) -> Ran {
        self.command(arguments).output().unwrap().into()
    }

    /// Runs `pmacctl` for this daemon; returns exit status, stdout, stderr.
    pub fn pmacctl(&self, arguments: &[&str]) -> (i32, String, String) {
        let Ran { code, stdout, stderr } = self.run(arguments);
        (code.unwrap_or(-1), stdout, stderr)
    }

    /// Whether the board has told the scales of its motors, and the data are fresh.
    pub fn has_scales(&self) -> bool {
        let Ran { code, stdout, .. } = self.run(&["motors"]);
        code == Some(0) && !stdout.contains("raw")
    }

    /// The board's answer to `line`.
    pub fn ask(&self, line: &str) -> Vec<String> {
        self.connection().send(line, PATIENCE).unwrap_or_else(|error| panic!("{line}: {error}"))
    }

    pub fn wait_for_live_servo(&self) {
        let name = self.segment();
        wait_until("live servo data", || {
            Subscriber::attach(&name).is_ok_and(|subscriber| is_live(&subscriber, RegionId::Servo))
        });
    }

    /// Waits until the daemon knows of every function whether the board's own programs leave it free.
    pub fn wait_for_its_functions(&self) {
        wait_until("functions that do not wait", || {
            self.connection().info().is_ok_and(|info| info.waiting.is_empty())
        });
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(Path::new("/dev/shm").join(&self.name));
        let _ = std::fs::remove_file(Path::new("/dev/shm").join(format!("{}.lock", self.name)));
    }
}

/// A connection to a simulator's control socket.
pub struct Control(BufReader<UnixStream>);

impl Control {
    pub fn open(path: &Path) -> Self {
        let stream = UnixStream::connect(path).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        Self(BufReader::new(stream))
    }

    /// The answer to `line`; fails on an error.
    pub fn ask(&mut self, line: &str) -> String {
        let answer = self.try_ask(line);
        assert!(!answer.starts_with("error"), "{line}: {answer}");
        answer
    }

    /// The answer to `line`, errors included.
    pub fn try_ask(&mut self, line: &str) -> String {
        self.0.get_mut().write_all(format!("{line}\n").as_bytes()).unwrap();
        let mut answer = String::new();
        self.0.read_line(&mut answer).unwrap();
        answer.trim_end().to_owned()
    }
}
