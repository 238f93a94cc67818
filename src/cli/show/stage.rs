//! Runs a daemon with a simulated board for a while, in a private directory that is removed afterwards.

use std::fmt::Write as _;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use nix::sys::signal::Signal;

use crate::cli::console::Interrupt;
use crate::cli::context::Failure;

/// Time limit of the daemon's end.
const ENDS_WITHIN: Duration = Duration::from_secs(5);
/// Time limit of the daemon's start and of the simulator's.
const STARTS_WITHIN: Duration = Duration::from_secs(20);

/// The daemon, which starts the simulator and ends it. The daemon ends on drop.
pub struct Stage {
    daemon: Child,
    directory: PathBuf,
    socket: PathBuf,
}

impl Stage {
    /// Starts `pmacd` on `board` with the name `name`; without `socket`, with a socket in its own directory.
    pub fn set(board: &str, name: &str, socket: Option<&Path>) -> Result<Self, Failure> {
        let own = std::process::id();
        let template = std::env::temp_dir().join(format!("pmac-demo-{own}-XXXXXX"));
        let directory = nix::unistd::mkdtemp(&template).map_err(|error| {
            Failure::request(format!("cannot make a directory like {}: {error}", template.display()))
        })?;
        let socket = socket.map_or_else(|| directory.join("socket"), Path::to_owned);
        let program = program();
        let daemon = std::fs::File::create(directory.join("log")).and_then(|log| {
            Command::new(&program)
                .args(["--board", board, "--name", name, "--socket"])
                .arg(&socket)
                // If this program is killed, the daemon ends too.
                .args(["--with-parent", &own.to_string()])
                .stdin(Stdio::null())
                .stdout(Stdio::null())
                .stderr(log)
                // Keep ^C from the daemon: the stage ends it in order.
                .process_group(0)
                .spawn()
        });
        match daemon {
            Ok(daemon) => Ok(Self { daemon, directory, socket }),
            Err(error) => {
                let _ = std::fs::remove_dir_all(&directory);
                Err(Failure::request(format!("cannot start {}: {error}", program.display())))
            }
        }
    }

    /// Its socket.
    pub fn socket(&self) -> &Path {
        &self.socket
    }

    /// Waits until `look` gives something; fails if that takes too long, the daemon ends, or a `signal` comes.
    pub fn wait_for<T>(
        &mut self,
        signal: &Interrupt,
        mut look: impl FnMut(&Self) -> Option<T>,
    ) -> Result<T, Failure> {
        let deadline = Instant::now() + STARTS_WITHIN;
        loop {
            if let Some(found) = look(self) {
                return Ok(found);
            }
            let ended = self.daemon.try_wait().map_err(Failure::request)?;
            if ended.is_some() || Instant::now() >= deadline || signal.came() {
                return Err(Failure::request(format!(
                    "the simulated board gave no live data: {}",
                    self.said()
                )));
            }
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// The last lines of the daemon's log, joined to one line.
    fn said(&self) -> String {
        let log = std::fs::read_to_string(self.directory.join("log")).unwrap_or_default();
        let mut said = String::new();
        for line in log.lines().rev().take(3).collect::<Vec<_>>().into_iter().rev() {
            let _ = write!(said, "{}{line}", if said.is_empty() { "" } else { "; " });
        }
        if said.is_empty() { "its log is empty".to_owned() } else { said }
    }
}

impl Drop for Stage {
    fn drop(&mut self) {
        let pid = nix::unistd::Pid::from_raw(self.daemon.id().cast_signed());
        let _ = nix::sys::signal::kill(pid, Signal::SIGTERM);
        let deadline = Instant::now() + ENDS_WITHIN;
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

/// `pmacd` beside this program, or on the search path.
fn program() -> PathBuf {
    let beside = std::env::current_exe().ok().and_then(|own| Some(own.parent()?.join("pmacd")));
    beside.filter(|path| path.exists()).unwrap_or_else(|| Path::new("pmacd").to_owned())
}
