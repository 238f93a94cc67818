//! `pmacctl demo`: runs the whole system without hardware or privilege, in a private directory.
//!
//! It starts the daemon on a simulated board, jogs motors back and forth, and shows them live from the shared memory,
//! as any program could. The last line gives the counts.

use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Args;
use nix::sys::signal::Signal;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

use crate::cli::args::values::{family, rate, seconds};
use crate::cli::console::keys::Keys;
use crate::cli::context::{Context, Failure, Verdict};
use crate::cli::show::screen::Screen;
use crate::client::{Board, ClientError};
use crate::map::Family;
use crate::segment::{Counter, RegionId, SegmentName};

#[derive(Debug, Args)]
pub struct Demo {
    /// Stop after this time, in seconds; without it, on q or ^C
    #[arg(long, value_name = "S", value_parser = seconds, allow_negative_numbers = true)]
    pub seconds: Option<Duration>,
    /// The family of the simulated board
    #[arg(long, value_name = "FAMILY", default_value = "pmac", value_parser = family)]
    pub family: &'static Family,
    /// The most views a second
    #[arg(long, value_name = "HZ", default_value = "5", value_parser = rate, allow_negative_numbers = true)]
    pub rate: Duration,
}

/// Time limit of the daemon and the simulator for the first live data.
const START: Duration = Duration::from_secs(15);
/// Time limit of their end.
const END: Duration = Duration::from_secs(5);
/// Time limit of a command.
const COMMAND: Duration = Duration::from_secs(2);
/// The time between jogs.
const JOG_EVERY: Duration = Duration::from_millis(1200);
/// How many motors are shown. The first four move.
const SHOWN: usize = 8;
/// The motors' moves, in turn. Speeds are in counts per millisecond, positions in counts.
const SET_UP: &str = "I122=20 I222=12 I322=8 I422=4";
const JOGS: [&str; 4] = ["#1J=20000 #2J=8000", "#3J=-5000 #4J^2500", "#1J=0 #2J=-8000", "#3J=5000 #4J^-2500"];

pub fn run(context: &mut Context, options: &Demo) -> Result<Verdict, Failure> {
    let interrupted = Arc::new(AtomicBool::new(false));
    for signal in [SIGTERM, SIGINT, SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&interrupted)).map_err(Failure::request)?;
    }
    let mut stage = Stage::set(context, options.family, &interrupted)?;
    let mut board = stage.wait_for_data(&interrupted)?;
    let interactive = context.output.is_terminal();
    let keys = Keys::listen(interactive);
    let socket = stage.socket.display().to_string();
    let note = format!("try: pmacctl --socket {socket} send '#1P'");
    if !interactive && !context.output.is_quiet() {
        // Nobody reads it: nothing to be done.
        let _ = writeln!(io::stderr(), "{note}");
    }
    let mut screen = Screen::new(interactive).with_note(note);
    let hint = if keys.are_heard() { "; q ends it" } else { "" };

    let began = Instant::now();
    let first = board.subscriber().counter(Counter::Updates);
    let mut cursor =
        board.subscriber().cursor(RegionId::Servo, board.servo_sequence()? + 1).map_err(ClientError::from)?;
    let mut sample = crate::segment::Sample::new();
    let missed_before = board.subscriber().counter(Counter::Missed);
    board.send(SET_UP, COMMAND)?;
    let mut jogs = JOGS.iter().cycle();
    let mut next_jog = began;
    loop {
        if Instant::now() >= next_jog {
            next_jog += JOG_EVERY;
            if let Some(jog) = jogs.next() {
                board.send(jog, COMMAND)?;
            }
        }
        // Fetch every sample, as a logging program would. The table shows the latest.
        while board.subscriber().next(&mut cursor, &mut sample).map_err(ClientError::from)? {}
        let mut snapshot = board.snapshot()?;
        if let Some(servo) = &mut snapshot.servo {
            servo.data.motors.truncate(SHOWN);
        }
        screen.show(&mut context.output, &format!("{} (simulated{hint})", board.name()), &snapshot)?;
        context.output.flush()?;
        let over = options.seconds.is_some_and(|seconds| began.elapsed() >= seconds);
        if over || interrupted.load(Ordering::Relaxed) || keys.quit_within(options.rate) {
            break;
        }
    }
    let elapsed = began.elapsed().as_secs_f64();
    let subscriber = board.subscriber();
    let updates = subscriber.counter(Counter::Updates) - first;
    let missed = subscriber.counter(Counter::Missed) - missed_before;
    let lost = cursor.lost() + subscriber.counter(Counter::Lost);
    drop(keys);
    stage.clear();
    context.output.line(format_args!(
        "updates={updates} lost={lost} missed={missed} rate_hz={:.1}",
        updates as f64 / elapsed
    ))?;
    Ok((updates > 0 && lost == 0).into())
}

/// The daemon in a private directory. It starts the simulator.
struct Stage {
    daemon: Child,
    /// Of its own.
    directory: PathBuf,
    name: SegmentName,
    socket: PathBuf,
}

impl Stage {
    /// With the name and the socket that `context` was told; else with its own.
    fn set(context: &Context, family: &Family, interrupted: &AtomicBool) -> Result<Self, Failure> {
        let template = std::env::temp_dir().join(format!("pmac-demo-{}-XXXXXX", std::process::id()));
        let directory = nix::unistd::mkdtemp(&template).map_err(|error| {
            Failure::request(format!("cannot make a directory like {}: {error}", template.display()))
        })?;
        let own = || SegmentName::new(&format!("pmac-demo-{}", std::process::id()));
        let name = context.told_name().cloned().map_or_else(own, Ok).map_err(Failure::request)?;
        let socket = context.told_socket().map_or_else(|| directory.join("socket"), Path::to_owned);
        let log = std::fs::File::create(directory.join("log")).map_err(Failure::request)?;
        let program = program();
        let daemon = Command::new(&program)
            .args(["--board", &format!("sim,family={}", family.name)])
            .args(["--name", name.as_str(), "--socket"])
            .arg(&socket)
            // If the demo is killed, the daemon ends too.
            .args(["--with-parent", &std::process::id().to_string()])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(log)
            // Keep ^C from the daemon: the demo ends it in order.
            .process_group(0)
            .spawn()
            .map_err(|error| Failure::request(format!("cannot start {}: {error}", program.display())));
        if daemon.is_err() || interrupted.load(Ordering::Relaxed) {
            let _ = std::fs::remove_dir_all(&directory);
        }
        Ok(Self { daemon: daemon?, directory, name, socket })
    }

    fn wait_for_data(&mut self, interrupted: &AtomicBool) -> Result<Board, Failure> {
        let deadline = Instant::now() + START;
        loop {
            if let Ok(board) = Board::attach(self.name.as_str()) {
                let mut board = board.with_socket(&self.socket);
                if board.snapshot().is_ok_and(|snapshot| snapshot.servo.is_some_and(|servo| servo.is_fresh()))
                {
                    return Ok(board);
                }
            }
            let ended = self.daemon.try_wait().map_err(Failure::request)?;
            if ended.is_some() || Instant::now() >= deadline || interrupted.load(Ordering::Relaxed) {
                let said = self.said();
                return Err(Failure::request(format!("the demo's daemon gave no live data: {said}")));
            }
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// The last lines of the daemon's log, in one line.
    fn said(&self) -> String {
        let log = std::fs::read_to_string(self.directory.join("log")).unwrap_or_default();
        let mut said = String::new();
        for line in log.lines().rev().take(3).collect::<Vec<_>>().into_iter().rev() {
            let _ = write!(said, "{}{line}", if said.is_empty() { "" } else { "; " });
        }
        if said.is_empty() { "its log is empty".to_owned() } else { said }
    }

    /// Ends the daemon, which ends the simulator, and removes the directory.
    fn clear(&mut self) {
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

impl Drop for Stage {
    fn drop(&mut self) {
        self.clear();
    }
}

/// `pmacd` beside this program, or on the search path.
fn program() -> PathBuf {
    let beside = std::env::current_exe().ok().and_then(|own| Some(own.parent()?.join("pmacd")));
    beside.filter(|path| path.exists()).unwrap_or_else(|| Path::new("pmacd").to_owned())
}
