//! A capture of the simulator that is started from a recording, in a private directory that is gone afterwards.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;

use crate::cli::context::Failure;
use crate::recording::Recording;

/// The longest trace of the simulator.
const LONGEST: Duration = Duration::from_secs(5);
/// Time limit of the daemon's end.
const END: Duration = Duration::from_secs(5);
/// Time limit of the daemon's start.
const START: Duration = Duration::from_secs(20);

/// Captures the simulator of the recording in `directory` for as long as that was captured, and no longer than [`LONGEST`].
pub fn capture(directory: &Path, recording: &Recording) -> Result<Recording, Failure> {
    let accesses = &recording.accesses;
    let traced = accesses.first().zip(accesses.last()).map_or(0, |(first, last)| last.t_ns - first.t_ns);
    let seconds = Duration::from_nanos(traced).clamp(Duration::from_millis(200), LONGEST).as_secs_f64();
    let mut stage = Stage::set(directory)?;
    stage.wait()?;
    let captured = stage.directory.join("capture");
    let mut command = Command::new(own());
    command.args(["--name", &stage.name, "--socket"]).arg(stage.directory.join("socket"));
    command.arg("capture").arg(&captured).args(["--seconds", &format!("{seconds:.3}")]);
    if recording.variables.is_none() {
        command.arg("--no-variables");
    }
    let output = command.stdin(Stdio::null()).output().map_err(Failure::request)?;
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        return Err(Failure::request(format!("the simulator could not be captured: {}", said.trim())));
    }
    Recording::read(&captured).map_err(Failure::request)
}

/// A daemon on the simulator of a recording.
struct Stage {
    daemon: Child,
    directory: PathBuf,
    name: String,
}

impl Stage {
    fn set(recorded: &Path) -> Result<Self, Failure> {
        let recorded = recorded.canonicalize().map_err(Failure::request)?;
        let template = std::env::temp_dir().join(format!("pmac-compare-{}-XXXXXX", std::process::id()));
        let directory = nix::unistd::mkdtemp(&template).map_err(Failure::request)?;
        let name = format!("pmac-compare-{}", std::process::id());
        let log = std::fs::File::create(directory.join("log")).map_err(Failure::request)?;
        let daemon = Command::new(beside("pmacd"))
            .args(["--board", &format!("sim,from={}", recorded.display()), "--name", &name, "--socket"])
            .arg(directory.join("socket"))
            .args(["--with-parent", &std::process::id().to_string()])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(log)
            .spawn();
        match daemon {
            Ok(daemon) => Ok(Self { daemon, directory, name }),
            Err(error) => {
                let _ = std::fs::remove_dir_all(&directory);
                Err(Failure::request(format!("cannot start pmacd: {error}")))
            }
        }
    }

    /// Waits until the daemon knows who the board is.
    fn wait(&mut self) -> Result<(), Failure> {
        let deadline = Instant::now() + START;
        loop {
            let log = std::fs::read_to_string(self.directory.join("log")).unwrap_or_default();
            if log.contains("the board is ") {
                return Ok(());
            }
            let ended = self.daemon.try_wait().map_err(Failure::request)?.is_some();
            if ended || Instant::now() >= deadline {
                let last = log.lines().last().unwrap_or("its log is empty");
                return Err(Failure::request(format!("the simulator of the recording does not run: {last}")));
            }
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

impl Drop for Stage {
    fn drop(&mut self) {
        let pid = nix::unistd::Pid::from_raw(self.daemon.id().cast_signed());
        let _ = nix::sys::signal::kill(pid, Signal::SIGTERM);
        let deadline = Instant::now() + END;
        while matches!(self.daemon.try_wait(), Ok(None)) {
            if Instant::now() >= deadline {
                let _ = self.daemon.kill();
                let _ = self.daemon.wait();
                break;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        let _ = std::fs::remove_dir_all(&self.directory);
    }
}

fn own() -> PathBuf {
    std::env::current_exe().unwrap_or_else(|_| "pmacctl".into())
}

/// A program beside this one, or on the search path.
fn beside(name: &str) -> PathBuf {
    let beside = std::env::current_exe().ok().and_then(|own| Some(own.parent()?.join(name)));
    beside.filter(|path| path.exists()).unwrap_or_else(|| name.into())
}
