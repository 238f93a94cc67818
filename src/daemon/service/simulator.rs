//! `--board sim`: a simulator that starts and stops with the daemon.

use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use log::{info, warn};
use nix::sys::signal::Signal;

use crate::device::InterruptSource;
use crate::device::board::spec::SimulatorSpec;
use crate::map::Family;

/// Time limit of the simulator's start, long enough for a machine that compiles beside.
const START: Duration = Duration::from_secs(20);
/// Time limit of its end.
const END: Duration = Duration::from_secs(2);

/// The simulator could not be started.
#[derive(Debug, thiserror::Error)]
#[error("the simulator {program} could not be started: {reason}")]
pub struct SimulatorError {
    program: PathBuf,
    reason: String,
}

/// A running simulator and its private directory. Drop ends the simulator and removes the directory.
pub struct Simulator {
    child: Child,
    directory: PathBuf,
}

impl Simulator {
    /// Starts `pmac-sim` from this program's directory (or the search path) as `spec` says, without a
    /// recording with the shipped start-up file.
    ///
    /// # Errors
    /// The program does not exist or is not ready in time.
    pub fn start(
        family: &Family,
        firmware: Option<&str>,
        spec: &SimulatorSpec,
    ) -> Result<Self, SimulatorError> {
        let program = program();
        let fail = |reason: String| SimulatorError { program: program.clone(), reason };
        let directory = private_directory();
        let mut command = Command::new(&program);
        command.arg("--memory").arg(directory.join("dpram"));
        command.arg("--interrupt").arg(socket(&directory, "interrupt"));
        command.arg("--serial").arg(socket(&directory, "serial"));
        command.arg("--control").arg(socket(&directory, "control"));
        if let Some(directory) = &spec.from {
            command.arg("--from").arg(directory);
        } else {
            command.args(["--family", family.name, "--dpram", family.dpram(), "--dpram-startup"]);
        }
        if let Some(firmware) = firmware.filter(|_| spec.from.is_none()) {
            command.arg("--firmware").arg(firmware);
        }
        if let Some(option) = spec.cpu {
            command.args(["--cpu", option]);
        }
        command.stdin(Stdio::null()).stdout(Stdio::null());
        // The simulator makes the directory. It ends with this process, even a killed one, and removes the directory.
        command.arg("--with-parent").arg(std::process::id().to_string());
        // Only the daemon talks to the service manager.
        for variable in ["NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"]
            .iter()
            .chain(&crate::device::system::inherited::VARIABLES)
        {
            command.env_remove(variable);
        }
        // Keep ^C from the simulator: the daemon ends it in order.
        command.process_group(0);
        let child = command.spawn().map_err(|error| fail(error.to_string()))?;
        let mut simulator = Self { child, directory };
        simulator.wait_until_ready(family.length.into()).map_err(fail)?;
        info!("simulator {} runs in {}", simulator.child.id(), simulator.directory.display());
        Ok(simulator)
    }

    /// The file of its memory.
    #[must_use]
    pub fn memory(&self) -> PathBuf {
        self.directory.join("dpram")
    }

    /// The socket of its interrupts.
    #[must_use]
    pub fn interrupt(&self) -> InterruptSource {
        InterruptSource::Unix(self.directory.join("interrupt"))
    }

    /// Its serial port, a socket with raw bytes.
    #[must_use]
    pub fn serial(&self) -> PathBuf {
        self.directory.join("serial")
    }

    /// How the simulator ended, if it has. Only this daemon ends it in order, so another process did, or the simulator
    /// failed.
    pub fn ended(&mut self) -> Option<ExitStatus> {
        self.child.try_wait().ok().flatten()
    }

    fn wait_until_ready(&mut self, dpram: u64) -> Result<(), String> {
        let deadline = Instant::now() + START;
        loop {
            let memory = std::fs::metadata(self.memory()).map_or(0, |metadata| metadata.len());
            if memory == dpram && self.directory.join("interrupt").exists() {
                return Ok(());
            }
            match self.child.try_wait() {
                Ok(Some(status)) => return Err(format!("it ended at once with {status}")),
                Ok(None) if Instant::now() < deadline => std::thread::sleep(Duration::from_millis(5)),
                Ok(None) => return Err(format!("it was not ready after {} s", START.as_secs())),
                Err(error) => return Err(error.to_string()),
            }
        }
    }
}

impl Drop for Simulator {
    fn drop(&mut self) {
        let pid = nix::unistd::Pid::from_raw(self.child.id().cast_signed());
        let _ = nix::sys::signal::kill(pid, Signal::SIGTERM);
        let deadline = Instant::now() + END;
        while matches!(self.child.try_wait(), Ok(None)) {
            if Instant::now() >= deadline {
                warn!("the simulator did not end in {} s and is killed", END.as_secs());
                let _ = self.child.kill();
                let _ = self.child.wait();
                break;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        let _ = std::fs::remove_dir_all(&self.directory);
    }
}

fn socket(directory: &Path, name: &str) -> String {
    format!("unix:{}", directory.join(name).display())
}

fn program() -> PathBuf {
    let beside = std::env::current_exe().ok().and_then(|own| Some(own.parent()?.join("pmac-sim")));
    beside.filter(|path| path.exists()).unwrap_or_else(|| "pmac-sim".into())
}

/// Where the simulator makes a directory for its files: in memory if possible, and under a name that nobody has used.
fn private_directory() -> PathBuf {
    let parent = Path::new(crate::segment::DIRECTORY);
    let parent = if parent.is_dir() { parent.to_owned() } else { std::env::temp_dir() };
    let begun = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    parent.join(format!("pmac-sim-{}-{}", std::process::id(), begun.as_nanos()))
}
