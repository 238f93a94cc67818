//! `pmacctl demo`: runs the whole system without hardware or privilege, in a private directory.
//!
//! The demo starts the daemon on a simulated board, jogs motors back and forth, and shows them live from the shared
//! memory, as any program could. Its last line gives the counts.

use std::time::{Duration, Instant};

use clap::Args;

use crate::cli::args::values::{family, rate, seconds};
use crate::cli::console::{Interrupt, Keys, note};
use crate::cli::context::{Context, Failure, Verdict};
use crate::cli::show::motors::Motors;
use crate::cli::show::screen::Screen;
use crate::cli::show::stage::Stage;
use crate::client::{Board, ClientError};
use crate::map::Family;
use crate::segment::{Counter, RegionId, SegmentName};

#[derive(Debug, Args)]
pub struct Demo {
    /// Stop after this time, in seconds [default: on q or ^C]
    #[arg(long, value_name = "S", value_parser = seconds, allow_negative_numbers = true)]
    pub seconds: Option<Duration>,
    /// The family of the simulated board
    #[arg(long, value_name = "FAMILY", default_value = "pmac", value_parser = family)]
    pub family: &'static Family,
    /// The most views a second
    #[arg(long, value_name = "HZ", default_value = "5", value_parser = rate, allow_negative_numbers = true)]
    pub rate: Duration,
}

/// Time limit of a command.
const COMMAND: Duration = Duration::from_secs(2);
/// The time between jogs.
const JOG_EVERY: Duration = Duration::from_millis(1200);
/// The number of motors shown. The first four move.
const SHOWN: usize = 8;
/// The motors' moves, in turn. Speeds are in counts per millisecond, positions in counts.
const SET_UP: &str = "I122=20 I222=12 I322=8 I422=4";
const JOGS: [&str; 4] = ["#1J=20000 #2J=8000", "#3J=-5000 #4J^2500", "#1J=0 #2J=-8000", "#3J=5000 #4J^-2500"];

pub fn run(context: &mut Context, options: &Demo) -> Result<Verdict, Failure> {
    let signal = Interrupt::listen()?;
    // With the name and the socket of the command line, else with the demo's own.
    let own = || SegmentName::new(&format!("pmac-demo-{}", std::process::id()));
    let name = context.told_name().cloned().map_or_else(own, Ok).map_err(Failure::request)?;
    let simulated = format!("sim,family={}", options.family.name);
    let mut stage = Stage::set(&simulated, name.as_str(), context.told_socket())?;
    let mut board = stage.wait_for(&signal, |stage| {
        let mut board = Board::attach(name.as_str()).ok()?.with_socket(stage.socket());
        let is_live =
            board.snapshot().is_ok_and(|snapshot| snapshot.servo.is_some_and(|servo| servo.is_fresh()));
        is_live.then_some(board)
    })?;
    let interactive = context.output.is_terminal();
    let keys = Keys::listen(interactive);
    let socket = stage.socket().display().to_string();
    let hint = format!("try: pmacctl --socket {socket} send '#1P'");
    if !interactive && !context.output.is_quiet() {
        note(&hint);
    }
    let mut screen = Screen::new(interactive).with_note(hint);
    let ends = if keys.are_heard() { "; q ends it" } else { "" };

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
        screen.show(
            &mut context.output,
            &format!("{} (simulated{ends})", board.name()),
            &Motors(&snapshot),
        )?;
        context.output.flush()?;
        let over = options.seconds.is_some_and(|seconds| began.elapsed() >= seconds);
        if over || signal.came() || keys.quit_within(options.rate) {
            break;
        }
    }
    let elapsed = began.elapsed().as_secs_f64();
    let subscriber = board.subscriber();
    let updates = subscriber.counter(Counter::Updates) - first;
    let missed = subscriber.counter(Counter::Missed) - missed_before;
    let lost = cursor.lost() + subscriber.counter(Counter::Lost);
    drop(keys);
    drop(stage);
    context.output.line(format_args!(
        "updates={updates} lost={lost} missed={missed} rate_hz={:.1}",
        updates as f64 / elapsed
    ))?;
    Ok((updates > 0 && lost == 0).into())
}
