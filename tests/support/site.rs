//! A simulated board and its daemon as real processes. Dropping it ends both.

use std::ops::Deref;
use std::os::unix::net::UnixStream;
use std::process::{Child, Command, Stdio};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use pmac_dpram::segment::Subscriber;

use super::{Control, PATIENCE, Place, status_within, wait_until};

/// A board and a daemon that run at the machine's own pace.
pub struct Site {
    place: Place,
    simulator: Option<Child>,
    daemon: Option<Child>,
    daemons_started: u32,
}

impl Deref for Site {
    type Target = Place;

    fn deref(&self) -> &Place {
        &self.place
    }
}

impl Site {
    /// A place without processes.
    pub fn new() -> Self {
        Self { place: Place::new(), simulator: None, daemon: None, daemons_started: 0 }
    }

    /// A board with all DPRAM functions enabled, and a daemon with live servo data.
    pub fn running(simulator: &[&str], daemon: &[&str]) -> Self {
        let mut site = Self::new();
        site.start_simulator(&[&["--dpram-startup"], simulator].concat());
        site.start_daemon(daemon);
        site
    }

    pub fn start_simulator(&mut self, options: &[&str]) {
        let socket = |name: &str| format!("unix:{}", self.path(name).display());
        let child = Command::new(env!("CARGO_BIN_EXE_pmac-sim"))
            .arg("--memory")
            .arg(self.path("dpram"))
            .args(["--interrupt", &socket("interrupt"), "--serial", &socket("serial")])
            .args(["--control", &socket("control")])
            .args(options)
            .stdin(Stdio::null())
            .spawn()
            .unwrap();
        self.simulator = Some(child);
        let control = self.path("control");
        wait_until("the simulator's control socket", || UnixStream::connect(&control).is_ok());
    }

    pub fn start_daemon(&mut self, options: &[&str]) {
        self.daemons_started += 1;
        let log = std::fs::File::create(self.log_path()).unwrap();
        let child = self.daemon_command(options).stderr(log).spawn().unwrap();
        self.daemon = Some(child);
        let (socket, name) = (self.socket(), self.segment());
        let pid = u64::from(self.daemon_pid());
        wait_until("the daemon's socket and segment", || {
            UnixStream::connect(&socket).is_ok()
                && Subscriber::attach(&name).is_ok_and(|subscriber| subscriber.header().owner_pid == pid)
        });
    }

    /// Takes over a daemon that the test started.
    pub fn adopt(mut self, daemon: Child) -> Self {
        self.daemon = Some(daemon);
        self
    }

    /// The command that starts the daemon on this board.
    pub fn daemon_command(&self, options: &[&str]) -> Command {
        let board =
            format!("file:{},irq=unix:{}", self.path("dpram").display(), self.path("interrupt").display());
        let mut command = Command::new(env!("CARGO_BIN_EXE_pmacd"));
        command.args(["--board", &board, "--name", &self.name]).arg("--socket").arg(self.socket());
        command.args(options).stdin(Stdio::null());
        command
    }

    fn log_path(&self) -> std::path::PathBuf {
        self.path(&format!("log{}", self.daemons_started))
    }

    /// The daemon's log.
    pub fn log(&self) -> String {
        std::fs::read_to_string(self.log_path()).unwrap_or_default()
    }

    pub fn daemon_pid(&self) -> u32 {
        self.daemon.as_ref().unwrap().id()
    }

    pub fn simulator_pid(&self) -> u32 {
        self.simulator.as_ref().unwrap().id()
    }

    pub fn signal_daemon(&self, signal: Signal) {
        kill(pid(self.daemon.as_ref().unwrap()), signal).unwrap();
    }

    pub fn kill_daemon(&mut self) {
        end(self.daemon.take(), Signal::SIGKILL);
    }

    /// Stops the daemon gracefully; returns its exit status.
    pub fn stop_daemon(&mut self) -> i32 {
        end(self.daemon.take(), Signal::SIGTERM)
    }

    pub fn kill_simulator(&mut self) {
        end(self.simulator.take(), Signal::SIGKILL);
    }

    /// Sends one line to the simulator's control socket and returns its answer.
    pub fn control(&self, line: &str) -> String {
        self.control_connection().ask(line)
    }

    /// A connection to the simulator's control socket, for many lines.
    pub fn control_connection(&self) -> Control {
        Control::open(&self.path("control"))
    }

    /// The simulator's own counters.
    pub fn status(&self) -> serde_json::Value {
        serde_json::from_str(&self.control("status")).unwrap()
    }

    /// Checks that the simulator saw the host break no handshake. In its first cycle there was none: what it saw then lay in its
    /// memory at power-on.
    pub fn assert_no_violations(&self) {
        let status = self.status();
        let all = status["violations"].as_array().unwrap().iter();
        let of_host: Vec<_> =
            all.filter(|told| !told.as_str().unwrap_or_default().starts_with("cycle 1:")).collect();
        assert!(of_host.is_empty(), "{of_host:#?}");
    }
}

impl Drop for Site {
    fn drop(&mut self) {
        if std::thread::panicking() {
            eprintln!("what the daemon had logged:\n{}", self.log());
        }
        end(self.daemon.take(), Signal::SIGKILL);
        end(self.simulator.take(), Signal::SIGKILL);
    }
}

fn pid(child: &Child) -> Pid {
    Pid::from_raw(child.id().cast_signed())
}

/// Ends a process; returns its exit status, or -1.
fn end(child: Option<Child>, signal: Signal) -> i32 {
    let Some(mut child) = child else { return -1 };
    let _ = kill(pid(&child), signal);
    // A stopped process handles no signal but SIGKILL until it continues.
    let _ = kill(pid(&child), Signal::SIGCONT);
    status_within(&mut child, PATIENCE).code().unwrap_or(-1)
}
