//! `--wait`: follows the board's reports until a motion has ended, and tells the outcome.
//!
//! A wait only looks. ^C and the time limit end the wait, never the motion.
//!
//! A report may be older than the request: PMAC copies its registers into the DPRAM in its own time. So the wait
//! believes no report before two reports of each kind have come after the board took the request. It looks at every
//! servo sample since then, so it sees even the shortest move. The reports' time stamps measure delays.

mod motors;
mod stops;
mod systems;

use std::time::{Duration, Instant};

use clap::Args;
use stops::Stops;

use crate::cli::args::values::seconds;
use crate::cli::console::Interrupt;
use crate::cli::context::{Context, Failure};
use crate::client::{Board, CommandError, Connection, Snapshot, Staleness};
use crate::decode::ServoData;
use crate::protocol::CallError;
use crate::protocol::board::SentStop;
use crate::segment::Counter;
use crate::segment::identity::MOTORS;

pub use motors::{Goal, motors_end, place_of, see_position, wait_for_motors};
pub use systems::{see_programs_begin, wait_for_programs, without_program};

/// The longest sleep until the next look.
const SAMPLE_WITHIN: Duration = Duration::from_millis(20);
/// The longest pause between reports. A board that stalls, or a `GATHER`, holds reports up for a quarter of a second.
const NO_REPORT_FOR: Duration = Duration::from_secs(2);
/// How long the board may take to begin the requested motion: it answers first and begins afterwards, at a real-time
/// interrupt.
const BEGINS: Duration = Duration::from_millis(500);
/// How long a motor must stand before the wait says that it stopped in the wrong place. A motor that turns round stands
/// for an instant.
const STOOD_FOR: Duration = Duration::from_millis(200);
/// Samples per look.
const SAMPLES: usize = 4096;
/// Reports of each kind that may be older than the request.
const OLD_REPORTS: u64 = 1;

/// `--wait` and `--timeout`.
#[derive(Debug, Clone, Copy, Default, Args)]
pub struct Wait {
    /// Wait until the motion has ended. Exit status 1: the motion ended elsewhere or by a fault, or the wait ended first.
    /// ^C ends the wait, not the motion
    #[arg(long)]
    pub wait: bool,
    /// Time limit of --wait, in seconds. The limit ends the wait, not the motion
    #[arg(long, value_name = "S", requires = "wait", default_value = "60", value_parser = seconds, allow_negative_numbers = true)]
    pub timeout: Duration,
}

/// The events of a motor that reports have shown since the watch began.
#[derive(Debug, Clone, Copy, Default)]
struct Seen {
    /// The motor has moved.
    moved: bool,
    /// The motor has decelerated because of an abort.
    aborted: bool,
    /// The motor has searched for home.
    homed: bool,
    /// The watch missed samples of the motor.
    lost: bool,
}

/// The motions of a wait.
struct Awaited<'a> {
    numbers: &'a [u8],
    /// The kind of each motion: `motor`.
    name: &'a str,
    /// The note on a motion that may go on when the wait ends first.
    moving: &'a str,
    timeout: Duration,
    /// Whether another client's stop ends the motion of this number.
    ends: &'a dyn Fn(u8, &SentStop, &Snapshot) -> bool,
}

/// Looks at the board from before the request on.
pub struct Watch {
    board: Board,
    interrupt: Interrupt,
    /// The daemon's segment: a new generation means that a daemon has started since.
    generation: u64,
    /// How many resets of the board the daemon had found.
    resets: u64,
    /// The number of the next servo sample to look at.
    next: u64,
    /// Motor 1 first.
    seen: [Seen; MOTORS],
    /// Lines of other clients that end motions.
    stops: Stops,
}

/// The progress of one awaited motion.
#[derive(Debug, Clone, PartialEq)]
enum Progress {
    GoesOn,
    /// The motion has ended at its goal.
    Done,
    /// The motion has ended otherwise.
    Failed(String),
}

impl Watch {
    /// Begins before the command sends the request over `connection`. From here on ^C only ends the wait.
    ///
    /// # Errors
    /// [`Failure::Refused`] if this is a replay, or the reports are not live: the wait could not see the motion end.
    pub fn begin(context: &Context, connection: &mut Connection) -> Result<Self, Failure> {
        is_no_replay(connection)?;
        let mut board = context.board()?;
        let snapshot = board.snapshot()?;
        let servo = snapshot.servo.as_ref().map(|servo| servo.stale);
        let background = snapshot.background.as_ref().map(|background| background.stale);
        for (report, stale) in [("servo", servo), ("background", background)] {
            let why = match stale {
                Some(None) => continue,
                Some(Some(stale)) => stale,
                None => snapshot.stale.unwrap_or(Staleness::Off),
            };
            return Err(Failure::Refused(format!(
                "the {report} data are not live ({why}), so nobody can see what the motor does; pmacctl doctor says what to do"
            )));
        }
        let (generation, next) = (board.subscriber().generation(), board.servo_sequence()? + 1);
        let resets = board.subscriber().counter(Counter::Resets);
        Ok(Self {
            board,
            interrupt: Interrupt::listen()?,
            generation,
            resets,
            next,
            seen: Default::default(),
            stops: Stops::begin(connection),
        })
    }

    /// The present snapshot of the board.
    ///
    /// # Errors
    /// When the segment cannot be read.
    pub fn snapshot(&mut self) -> Result<Snapshot, Failure> {
        Ok(self.board.snapshot()?)
    }

    /// Waits until `judge` has decided on all `awaited` motions, or a stop over another connection ends it. Returns the
    /// motions that failed.
    ///
    /// # Errors
    /// When the wait ends first.
    fn until_over(
        &mut self,
        connection: &mut Connection,
        awaited: &Awaited<'_>,
        mut judge: impl FnMut(u8, &Snapshot, &Observed<'_>) -> Progress,
    ) -> Result<Vec<String>, Failure> {
        let Awaited { numbers, name, moving, timeout, ends } = *awaited;
        let first = self.snapshot()?;
        let (servo, background) = (sequence(&first).0 + OLD_REPORTS, sequence(&first).1 + OLD_REPORTS);
        let mut begun_ns = None;
        let mut open: Vec<u8> = numbers.to_vec();
        let mut failed = Vec::new();
        let started = Instant::now();
        loop {
            let ended = |why: String| Err(Failure::Refused(format!("{why}; {moving}")));
            if self.interrupt.came() {
                return ended("the wait was interrupted".to_owned());
            }
            if started.elapsed() >= timeout {
                return ended(format!("{} s are over", timeout.as_secs_f64()));
            }
            let last = self.board.servo_sequence()?;
            self.board.wait(last, SAMPLE_WITHIN)?;
            let snapshot = self.snapshot()?;
            if self.board.subscriber().generation() != self.generation {
                return ended("pmacd was restarted".to_owned());
            }
            if self.board.subscriber().counter(Counter::Resets) != self.resets {
                // A stop would close the loop of a motor whose loop is open by now.
                let list: Vec<String> = numbers.iter().map(ToString::to_string).collect();
                return Err(Failure::Refused(format!(
                    "the board was reset; {name} {} has forgotten this command, and whether anything moves is not known: see \
                     pmacctl motors; pmacctl abort stops everything",
                    list.join(", ")
                )));
            }
            self.follow()?;
            let now = sequence(&snapshot);
            if self.board.subscriber().own_condition().is_over() {
                return ended(
                    "pmacd is gone, and until it is there again pmacctl moves and stops nothing".to_owned(),
                );
            }
            if is_silent(&snapshot) {
                return ended(format!("no report has come for {} s", NO_REPORT_FOR.as_secs()));
            }
            let fresh = snapshot.servo.as_ref().filter(|servo| servo.is_fresh());
            let Some(sample) = fresh.filter(|_| now.0 > servo && now.1 > background) else { continue };
            let look = Observed {
                seen: &self.seen,
                elapsed: since(*begun_ns.get_or_insert(sample.time_ns), sample.time_ns),
                now_ns: sample.time_ns,
            };
            self.stops.look(connection);
            let stops = &mut self.stops;
            open.retain(|&number| {
                let progress = judge(number, &snapshot, &look);
                let is_over = progress != Progress::GoesOn;
                if is_over {
                    stops.ask(connection);
                }
                // A stop without a number went to the addressed motor or system, and may have ended another motion.
                let stop = stops.last(|stop| (stop.named || is_over) && ends(number, stop, &snapshot));
                match (progress, stop) {
                    (Progress::GoesOn, None) => return true,
                    (Progress::Done, None) => {}
                    (Progress::Failed(why), None) => failed.push(why),
                    (Progress::Failed(why), Some(stop)) => failed.push(format!("{why}; {stop}")),
                    (Progress::Done, Some(stop)) => {
                        failed.push(format!("{name} {number} was stopped before its end: {stop}"));
                    }
                    (Progress::GoesOn, Some(stop)) => {
                        failed.push(format!("{name} {number} was stopped: {stop}; it may still move"));
                    }
                }
                false
            });
            if open.is_empty() {
                return Ok(failed);
            }
        }
    }

    /// Looks at the servo samples that have come.
    fn follow(&mut self) -> Result<(), Failure> {
        let history = self.board.history(self.next, SAMPLES)?;
        self.next = history.next;
        for sample in &history.samples {
            self.see(&sample.data);
        }
        // The lost samples may have shown a move.
        if history.lost > 0 {
            self.seen.iter_mut().for_each(|seen| (seen.moved, seen.lost) = (true, true));
        }
        Ok(())
    }

    fn see(&mut self, servo: &ServoData) {
        for motor in &servo.motors {
            let (Some(status), Some(seen)) = (motor.status, self.seen.get_mut(motor.motor - 1)) else {
                continue;
            };
            seen.moved |=
                motors::MOVES.iter().any(|flag| status.has(flag)) || !status.has(motors::STANDS_STILL);
            seen.aborted |= status.has("abort_deceleration");
            seen.homed |= status.has("home_search_in_progress");
        }
    }
}

/// The facts that a judge needs besides the reports.
struct Observed<'a> {
    seen: &'a [Seen; MOTORS],
    /// Since the board took the request.
    elapsed: Duration,
    /// The time of the servo sample.
    now_ns: u64,
}

fn since(earlier_ns: u64, now_ns: u64) -> Duration {
    Duration::from_nanos(now_ns.saturating_sub(earlier_ns))
}

/// Whether one of the reports has stayed away for too long, by the segment's clock.
fn is_silent(snapshot: &Snapshot) -> bool {
    let ages = [
        snapshot.servo.as_ref().map(|servo| servo.age_ns),
        snapshot.background.as_ref().map(|view| view.age_ns),
    ];
    ages.into_iter().flatten().any(|age_ns| age_ns > NO_REPORT_FOR.as_nanos() as u64)
}

/// Checks that the daemon has a board that can move, not a replay, whatever the data show.
///
/// # Errors
/// [`Failure::Refused`] if this is a replay.
pub fn is_no_replay(connection: &mut Connection) -> Result<(), Failure> {
    match connection.info()?.replay {
        Some(_) => Err(CommandError::from(CallError::replay_moves_nothing()).into()),
        None => Ok(()),
    }
}

/// The numbers of the latest servo and background reports.
fn sequence(snapshot: &Snapshot) -> (u64, u64) {
    let servo = snapshot.servo.as_ref().map_or(0, |servo| servo.sequence);
    (servo, snapshot.background.as_ref().map_or(0, |background| background.sequence))
}
