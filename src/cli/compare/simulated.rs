//! A capture of the simulator that is started from a recording, in a private directory that is gone afterwards.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use crate::cli::console::interrupt::Interrupt;
use crate::cli::context::Failure;
use crate::cli::stage::Stage;
use crate::recording::Recording;

/// The longest trace of the simulator.
const LONGEST: Duration = Duration::from_secs(1);

/// Captures the simulator of the recording in `directory` for as long as that was captured, and no longer than [`LONGEST`].
pub fn capture(directory: &Path, recording: &Recording) -> Result<Recording, Failure> {
    let accesses = &recording.accesses;
    let traced = accesses.first().zip(accesses.last()).map_or(0, |(first, last)| last.t_ns - first.t_ns);
    let seconds = Duration::from_nanos(traced).clamp(Duration::from_millis(200), LONGEST).as_secs_f64();
    let signal = Interrupt::listen()?;
    let recorded = directory.canonicalize().map_err(Failure::request)?;
    let name = format!("pmac-compare-{}", std::process::id());
    let mut stage = Stage::set("compare", &format!("sim,from={}", recorded.display()), &name, None)?;
    let knows_the_board = |stage: &Stage| stage.log().contains("the board is ").then_some(());
    stage.wait_for("answer to TYPE", &signal, knows_the_board)?;
    let captured = stage.directory().join("capture");
    let mut command = Command::new(own());
    command.args(["--name", &name, "--socket"]).arg(stage.socket());
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

fn own() -> PathBuf {
    std::env::current_exe().unwrap_or_else(|_| "pmacctl".into())
}
