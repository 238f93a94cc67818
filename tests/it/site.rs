//! A simulated board and its daemon as real processes, in a private directory. Both are gone when it is dropped.

use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use pmac_dpram::client::Connection;
use pmac_dpram::segment::{Counter, RegionId, RegionState, SegmentName, Subscriber};

/// Longer than anything takes on a busy machine; reached only by a failure.
pub const PATIENCE: Duration = Duration::from_secs(20);

/// Two processes that want to run every 442 us need the machine's two cores: one site at a time.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

pub struct Site {
    pub directory: tempfile::TempDir,
    pub name: String,
    simulator: Option<Child>,
    daemon: Option<Child>,
    daemons_started: u32,
    // Last, so that it is let go after everything else.
    _alone: MutexGuard<'static, ()>,
}

impl Site {
    /// A place without a process yet.
    pub fn new() -> Self {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        Self {
            directory: tempfile::tempdir_in("/dev/shm").unwrap(),
            name: format!("pmac-test-{}-{number}", std::process::id()),
            simulator: None,
            daemon: None,
            daemons_started: 0,
            _alone: ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner),
        }
    }

    /// A board with all DPRAM functions enabled and a daemon on it, with live servo data.
    pub fn running(simulator: &[&str], daemon: &[&str]) -> Self {
        let mut site = Self::new();
        site.start_simulator(&[&["--dpram-startup"], simulator].concat());
        site.start_daemon(daemon);
        site
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.directory.path().join(name)
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

    /// Takes over a daemon that the test has started.
    pub fn adopt(mut self, daemon: Child) -> Self {
        self.daemon = Some(daemon);
        self
    }

    /// How the daemon is started on this board.
    pub fn daemon_command(&self, options: &[&str]) -> Command {
        let board =
            format!("file:{},irq=unix:{}", self.path("dpram").display(), self.path("interrupt").display());
        let mut command = Command::new(env!("CARGO_BIN_EXE_pmacd"));
        command.args(["--board", &board, "--name", &self.name]).arg("--socket").arg(self.socket());
        command.args(options).stdin(Stdio::null());
        command
    }

    fn log_path(&self) -> PathBuf {
        self.path(&format!("log{}", self.daemons_started))
    }

    /// What the daemon has logged.
    pub fn log(&self) -> String {
        std::fs::read_to_string(self.log_path()).unwrap_or_default()
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

    /// Runs `pmacctl` on this daemon: exit status, stdout, stderr.
    pub fn pmacctl(&self, arguments: &[&str]) -> (i32, String, String) {
        let output = Command::new(env!("CARGO_BIN_EXE_pmacctl"))
            .args(["--name", &self.name])
            .arg("--socket")
            .arg(self.socket())
            .args(arguments)
            .output()
            .unwrap();
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        (output.status.code().unwrap_or(-1), text(output.stdout), text(output.stderr))
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

    /// Stops the daemon in good order; returns its exit status.
    pub fn stop_daemon(&mut self) -> i32 {
        end(self.daemon.take(), Signal::SIGTERM)
    }

    pub fn kill_simulator(&mut self) {
        end(self.simulator.take(), Signal::SIGKILL);
    }

    /// Sends one line to the simulator's control socket and returns its answer.
    pub fn control(&self, line: &str) -> String {
        Control::open(&self.path("control")).ask(line)
    }

    /// A connection to the simulator's control socket, for many lines.
    pub fn control_connection(&self) -> Control {
        Control::open(&self.path("control"))
    }

    /// The simulator's own counts.
    pub fn status(&self) -> serde_json::Value {
        serde_json::from_str(&self.control("status")).unwrap()
    }

    /// The simulator has seen the host break no handshake.
    pub fn assert_no_violations(&self) {
        assert_eq!(self.status()["violations"], serde_json::json!([]));
    }

    pub fn connection_refused(&self) -> bool {
        Connection::open(&self.socket()).is_err()
    }

    pub fn wait_for_live_servo(&self) {
        let name = self.segment();
        wait_until("live servo data", || {
            Subscriber::attach(&name).is_ok_and(|subscriber| is_live(&subscriber, RegionId::Servo))
        });
    }
}

impl Drop for Site {
    fn drop(&mut self) {
        if std::thread::panicking() {
            eprintln!("what the daemon had logged:\n{}", self.log());
        }
        end(self.daemon.take(), Signal::SIGKILL);
        end(self.simulator.take(), Signal::SIGKILL);
        let _ = std::fs::remove_file(Path::new("/dev/shm").join(&self.name));
        let _ = std::fs::remove_file(Path::new("/dev/shm").join(format!("{}.lock", self.name)));
    }
}

pub struct Control(BufReader<UnixStream>);

impl Control {
    fn open(path: &Path) -> Self {
        let stream = UnixStream::connect(path).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        Self(BufReader::new(stream))
    }

    pub fn ask(&mut self, line: &str) -> String {
        self.0.get_mut().write_all(format!("{line}\n").as_bytes()).unwrap();
        let mut answer = String::new();
        self.0.read_line(&mut answer).unwrap();
        assert!(!answer.starts_with("error"), "{line}: {answer}");
        answer.trim_end().to_owned()
    }
}

pub fn is_live(subscriber: &Subscriber, region: RegionId) -> bool {
    subscriber.region(region).is_ok_and(|info| info.state == RegionState::Live)
}

pub fn counter(subscriber: &Subscriber, counter: Counter) -> u64 {
    subscriber.counter(counter)
}

#[track_caller]
pub fn wait_until(what: &str, mut condition: impl FnMut() -> bool) {
    let deadline = Instant::now() + PATIENCE;
    while !condition() {
        assert!(Instant::now() < deadline, "waited in vain for {what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Set when this is dropped, however its scope ends: threads that go on until it is set end with a test that fails, too.
pub struct Ended<'a>(pub &'a AtomicBool);

impl Drop for Ended<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Waits for the end of a process, at most `patience`; then it is killed and the test has failed.
#[track_caller]
pub fn status_within(child: &mut Child, patience: Duration) -> ExitStatus {
    let deadline = Instant::now() + patience;
    loop {
        if let Some(status) = child.try_wait().unwrap() {
            return status;
        }
        if Instant::now() > deadline {
            let _ = child.kill();
            let _ = child.wait();
            panic!("a process did not end in {patience:?}");
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// As [`status_within`], with what the process printed where its streams are pipes.
#[track_caller]
pub fn output_within(child: &mut Child, patience: Duration) -> Output {
    fn all_of(stream: Option<impl Read + Send + 'static>) -> JoinHandle<Vec<u8>> {
        std::thread::spawn(move || {
            let mut bytes = Vec::new();
            if let Some(mut stream) = stream {
                stream.read_to_end(&mut bytes).unwrap();
            }
            bytes
        })
    }
    let (stdout, stderr) = (all_of(child.stdout.take()), all_of(child.stderr.take()));
    let status = status_within(child, patience);
    Output { status, stdout: joined(stdout), stderr: joined(stderr) }
}

/// What a thread that is to end returns.
#[track_caller]
pub fn joined<T>(thread: JoinHandle<T>) -> T {
    wait_until("the end of a thread", || thread.is_finished());
    thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}

/// How large a process is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Weight {
    /// All of its memory, with what it shares with others.
    pub resident_kib: u64,
    pub descriptors: usize,
    pub threads: usize,
}

impl Weight {
    pub fn of(pid: u32) -> Self {
        let count = |what: &str| std::fs::read_dir(format!("/proc/{pid}/{what}")).unwrap().count();
        Self { resident_kib: kib(pid, "status", "VmRSS:"), descriptors: count("fd"), threads: count("task") }
    }
}

impl std::fmt::Display for Weight {
    fn fmt(&self, formatter: &mut std::fmt::Formatter) -> std::fmt::Result {
        let Self { resident_kib, descriptors, threads } = self;
        write!(formatter, "{resident_kib} KiB, {descriptors} descriptors, {threads} threads")
    }
}

/// Memory that is a process's own: heap and stacks, counted page by page. A segment that fills with data does not change it.
pub fn own_kib(pid: u32) -> u64 {
    kib(pid, "smaps_rollup", "Anonymous:")
}

fn kib(pid: u32, file: &str, key: &str) -> u64 {
    let text = std::fs::read_to_string(format!("/proc/{pid}/{file}")).unwrap();
    let line = text.lines().find_map(|line| line.strip_prefix(key)).unwrap();
    line.trim().trim_end_matches(" kB").parse().unwrap()
}

fn pid(child: &Child) -> Pid {
    Pid::from_raw(child.id().cast_signed())
}

/// Ends a process, and says how it ended: its exit status, or -1.
fn end(child: Option<Child>, signal: Signal) -> i32 {
    let Some(mut child) = child else { return -1 };
    let _ = kill(pid(&child), signal);
    // A stopped process is not ended by anything but SIGKILL until it goes on.
    let _ = kill(pid(&child), Signal::SIGCONT);
    status_within(&mut child, PATIENCE).code().unwrap_or(-1)
}
