//! A simulated board and its daemon, each a process, in a directory of their own.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use pmac_dpram::client::{Board, Connection};
use pmac_dpram::segment::{SegmentName, Subscriber};
use tempfile::TempDir;

/// How long either program may take to be there, or to end.
const PATIENCE: Duration = Duration::from_secs(10);

/// How long a Turbo board at the lowest rate may take for its M-variables.
const DEFINITIONS: Duration = Duration::from_secs(120);

/// The programs and where they meet.
pub struct Rig {
    pub simulator: Program,
    pub daemon: Option<Program>,
    pub name: String,
    directory: TempDir,
}

/// What to run.
#[derive(Clone, Copy)]
pub struct Setup {
    /// The board's family. Of any but `pmac` all motors are reported, by the shipped start-up file.
    pub family: &'static str,
    pub servo_hz: f64,
    pub motors: u8,
    pub reading: &'static str,
    /// Whether the daemon keeps the processors awake (`cpu_latency_us = 0`), which takes root.
    pub awake: bool,
    /// Whether the daemon serves command lines and nothing else.
    pub only_ascii: bool,
}

impl Default for Setup {
    fn default() -> Self {
        Self {
            family: "pmac",
            servo_hz: 2258.8,
            motors: 8,
            reading: "optimistic",
            awake: false,
            only_ascii: false,
        }
    }
}

impl Rig {
    /// Starts both and waits until servo data come and the board has said who it is.
    pub fn start(setup: &Setup) -> Self {
        let mut rig = Self::simulator_alone(setup);
        rig.start_daemon(setup);
        rig
    }

    /// Starts the simulator only.
    pub fn simulator_alone(setup: &Setup) -> Self {
        let directory =
            tempfile::Builder::new().prefix("pmac-bench-").tempdir_in("/dev/shm").expect("a directory");
        let at = |file: &str| directory.path().join(file);
        let unix = |file: &str| format!("unix:{}", at(file).display());
        let startup = at("startup");
        let text = include_str!("../../src/sim/dpram-startup.pmc");
        std::fs::write(&startup, text.replace("I59=8", &format!("I59={}", setup.motors))).expect("written");
        let mut simulator = Command::new(program("pmac-sim"));
        simulator.arg("--memory").arg(at("dpram"));
        simulator.args(["--interrupt", &unix("irq"), "--control", &unix("control")]);
        simulator.args(["--family", setup.family, "--servo-hz", &setup.servo_hz.to_string()]);
        match setup.family {
            "pmac" => simulator.arg("--startup").arg(startup),
            _ => simulator.arg("--dpram-startup"),
        };
        let simulator = Program::start(&mut simulator);
        // It is there before anybody listens at it.
        until("the simulator's control socket", || UnixStream::connect(at("control")).is_ok());
        let name = format!("pmac-bench-{}", std::process::id());
        let rig = Self { simulator, daemon: None, name, directory };
        rig.control("time on");
        rig
    }

    /// Starts the daemon; returns when it has published servo data and knows the board.
    pub fn start_daemon(&mut self, setup: &Setup) {
        self.start_daemon_of("pmacd", setup, &[]);
    }

    /// Starts a program that is to the outside what `pmacd` is, and waits for nothing.
    pub fn spawn_daemon_of(&mut self, daemon: &str, setup: &Setup, environment: &[(&str, &Path)]) {
        let config = self.directory.path().join("pmacd.toml");
        let board = format!("file:{},irq=unix:{}", self.memory().display(), self.interrupt().display());
        let Setup { family, reading, .. } = setup;
        let mut text = format!("board = \"{board}\"\nfamily = \"{family}\"\nservo_reading = \"{reading}\"\n");
        if setup.awake {
            text += "cpu_latency_us = 0\n";
        }
        if setup.only_ascii {
            text += "functions = [\"ascii\"]\n";
        }
        std::fs::write(&config, text).expect("written");
        let daemon = Program::start(
            Command::new(program(daemon))
                .envs(environment.iter().copied())
                .args(["--name", &self.name])
                .arg("--socket")
                .arg(self.socket())
                .arg("--config")
                .arg(config),
        );
        self.daemon = Some(daemon);
    }

    /// As [`Rig::start_daemon`], of a program that is to the outside what `pmacd` is.
    pub fn start_daemon_of(&mut self, daemon: &str, setup: &Setup, environment: &[(&str, &Path)]) {
        self.spawn_daemon_of(daemon, setup, environment);
        let mut board = None;
        until("the daemon's data", || {
            board = board.take().or_else(|| Board::attach(&self.name).ok());
            let snapshot = board.as_mut().and_then(|board| board.snapshot().ok());
            let has_servo = |servo: bool| servo || setup.only_ascii;
            snapshot.is_some_and(|snapshot| {
                has_servo(snapshot.servo.is_some()) && snapshot.identity.motor_mask.is_some()
            })
        });
        // Until then it asks the board where its M-variables point, which takes time of both.
        let mut connection = self.connection();
        until_within(DEFINITIONS, "the M-variables' definitions", || {
            connection.info().is_ok_and(|info| info.lines.definitions.read == info.lines.definitions.of)
        });
    }

    pub fn stop_daemon(&mut self) {
        self.daemon = None;
    }

    pub fn memory(&self) -> PathBuf {
        self.directory.path().join("dpram")
    }

    pub fn interrupt(&self) -> PathBuf {
        self.directory.path().join("irq")
    }

    pub fn socket(&self) -> PathBuf {
        self.directory.path().join("socket")
    }

    pub fn connection(&self) -> Connection {
        Connection::open(&self.socket()).expect("a connection")
    }

    pub fn subscriber(&self) -> Subscriber {
        Subscriber::attach(&SegmentName::new(&self.name).expect("a name")).expect("the segment")
    }

    pub fn daemon(&self) -> &Program {
        self.daemon.as_ref().expect("the daemon runs")
    }

    /// One line to the simulator's control socket, and its answer.
    pub fn control(&self, line: &str) -> String {
        let mut stream =
            UnixStream::connect(self.directory.path().join("control")).expect("the control socket");
        stream.set_read_timeout(Some(PATIENCE)).expect("a time-out");
        writeln!(stream, "{line}").expect("sent");
        let mut answer = String::new();
        BufReader::new(stream).read_line(&mut answer).expect("an answer");
        assert!(!answer.starts_with("error"), "{line}: {answer}");
        answer
    }

    /// A number of the simulator's status.
    pub fn simulated(&self, key: &str) -> u64 {
        let status: serde_json::Value = serde_json::from_str(&self.control("status")).expect("JSON");
        status[key].as_u64().expect("a number")
    }
}

/// A program that ends when this is dropped.
pub struct Program(Child);

impl Program {
    /// What `command` runs.
    pub fn start(command: &mut Command) -> Self {
        let shown = format!("{command:?}");
        let child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
        Self(child.unwrap_or_else(|error| panic!("{shown}: {error}")))
    }

    pub fn pid(&self) -> Pid {
        Pid::from_raw(self.0.id().cast_signed())
    }

    /// Processor seconds used so far, over all threads.
    pub fn processor_seconds(&self) -> f64 {
        let tasks = std::fs::read_dir(format!("/proc/{}/task", self.0.id())).into_iter().flatten().flatten();
        let ns = tasks.filter_map(|task| {
            let text = std::fs::read_to_string(task.path().join("schedstat")).ok()?;
            text.split_whitespace().next()?.parse::<f64>().ok()
        });
        ns.sum::<f64>() / 1e9
    }

    /// Memory in use, in MiB: all of it, and what no other process shares.
    pub fn memory_mib(&self) -> [f64; 2] {
        let text = std::fs::read_to_string(format!("/proc/{}/smaps_rollup", self.0.id())).unwrap_or_default();
        let sum = |keys: &[&str]| {
            let lines = text.lines().filter(|line| keys.iter().any(|key| line.starts_with(key)));
            let kib = lines.filter_map(|line| line.split_whitespace().nth(1)?.parse::<f64>().ok());
            kib.sum::<f64>() / 1024.0
        };
        [sum(&["Rss:"]), sum(&["Private_Clean:", "Private_Dirty:"])]
    }
}

impl Program {
    /// Memory that cannot be paged out, in MiB.
    pub fn locked_mib(&self) -> f64 {
        let text = std::fs::read_to_string(format!("/proc/{}/status", self.0.id())).unwrap_or_default();
        let line = text.lines().find_map(|line| line.strip_prefix("VmLck:")?.trim().strip_suffix(" kB"));
        line.and_then(|kib| kib.trim().parse::<f64>().ok()).unwrap_or(f64::NAN) / 1024.0
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        let _ = kill(self.pid(), Signal::SIGTERM);
        let end = Instant::now() + PATIENCE;
        while matches!(self.0.try_wait(), Ok(None)) {
            if Instant::now() > end {
                let _ = self.0.kill();
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }
}

/// A program of the driver: beside this one, or where `cargo build --release` puts it.
pub fn program(name: &str) -> PathBuf {
    let beside = std::env::current_exe().ok().and_then(|own| Some(own.parent()?.join(name)));
    let built = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/release").join(name);
    let named = std::env::var_os("PMAC_PROGRAMS").map(|directory| Path::new(&directory).join(name));
    let found = [named, beside, Some(built)].into_iter().flatten().find(|path| path.exists());
    found.unwrap_or_else(|| panic!("there is no {name}; first: cargo build --release"))
}

fn until(what: &str, there: impl FnMut() -> bool) {
    until_within(PATIENCE, what, there);
}

fn until_within(patience: Duration, what: &str, mut there: impl FnMut() -> bool) {
    let end = Instant::now() + patience;
    while !there() {
        assert!(Instant::now() < end, "{what} did not come in {} s", patience.as_secs());
        std::thread::sleep(Duration::from_millis(1));
    }
}
