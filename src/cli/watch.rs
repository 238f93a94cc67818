//! `pmacctl watch`: the motors, again and again, through every restart of the daemon.

use std::time::{Duration, Instant};

use super::args::Watch;
use super::motors::{document, number, text};
use super::output::Output;
use super::{Context, Failure, Verdict};
use crate::client::Snapshot;

/// Cursor to the top left, and clear from there to the end of the screen.
const HOME: &str = "\x1b[H";
const CLEAR_LINE: &str = "\x1b[K\n";
const CLEAR_BELOW: &str = "\x1b[J";
/// How long a print without news is put off.
const NO_NEWS: Duration = Duration::from_millis(500);

pub fn run(context: &mut Context, options: &Watch) -> Result<Verdict, Failure> {
    let mut board = context.board()?;
    let mut screen = Screen::new(context.output.is_terminal());
    let end = options.seconds.and_then(|seconds| Instant::now().checked_add(seconds));
    let mut printed = 0;
    let mut fresh = false;
    let mut after = 0;
    while options.count.is_none_or(|count| printed < count) && end.is_none_or(|end| Instant::now() < end) {
        let began = Instant::now();
        board.wait(after, left(end).min(NO_NEWS))?;
        let snapshot = board.snapshot()?;
        after = snapshot.servo.as_ref().map_or(0, |servo| servo.sequence);
        fresh = snapshot.servo.as_ref().is_some_and(|servo| servo.is_fresh());
        screen.show(&mut context.output, &board.name().to_string(), &snapshot)?;
        context.output.flush()?;
        printed += 1;
        if options.count.is_none_or(|count| printed < count) {
            std::thread::sleep(options.rate.saturating_sub(began.elapsed()).min(left(end)));
        }
    }
    Ok(fresh.into())
}

fn left(end: Option<Instant>) -> Duration {
    end.map_or(Duration::MAX, |end| end.saturating_duration_since(Instant::now()))
}

/// Live data on a terminal, repainted in place, or as plain lines.
pub struct Screen {
    repaint: bool,
}

impl Screen {
    pub fn new(repaint: bool) -> Self {
        Self { repaint }
    }

    pub fn show(&mut self, output: &mut Output, title: &str, snapshot: &Snapshot) -> Result<(), Failure> {
        if output.is_json() {
            output.json_line(&document(snapshot))?;
        } else if self.repaint {
            let sequence = snapshot.servo.as_ref().map_or(0, |servo| servo.sequence);
            let screen = format!("{title}  update {sequence}\n{}", text(snapshot));
            output.text(HOME)?;
            for line in screen.lines() {
                output.text(format_args!("{line}{CLEAR_LINE}"))?;
            }
            output.text(CLEAR_BELOW)?;
        } else {
            output.line(plain(snapshot))?;
        }
        Ok(())
    }
}

/// One line: the update's number, whether it is live, and each motor's actual position.
fn plain(snapshot: &Snapshot) -> String {
    let Some(servo) = &snapshot.servo else {
        let reason = snapshot.stale.map_or("no_data", |stale| stale.name());
        return format!("update=0 stale={reason}");
    };
    let state = servo.stale.map_or_else(|| "fresh".to_owned(), |stale| format!("stale={}", stale.name()));
    let positions =
        servo.data.motors.iter().map(|motor| format!(" #{}={}", motor.motor, number(motor.actual_position)));
    format!("update={} {state}{}", servo.sequence, positions.collect::<String>())
}
