//! The wait for programs: whether a coordinate system's program has ended, and its motors stand.
//!
//! The board clears the running bit as soon as it has calculated the last move, "even if the motors are still executing
//! the last move" (Software Reference, `??`), so the motors of the coordinate system have to stand as well.
//!
//! No report tells a program that a client has ended by `Q` or at the end of a block from a program that has come to
//! its end. The daemon reports its clients' lines; lines of another host stay unknown.

use std::collections::BTreeSet;
use std::time::Duration;

use serde_json::json;

use super::motors::{fault, position, stands};
use super::stops::{ends_program, system_of};
use super::{Awaited, BEGINS, Observed, Progress, Watch};
use crate::cli::console::note;
use crate::cli::context::{Context, Failure, Verdict};
use crate::cli::show::motors::motors;
use crate::client::motor::Motor;
use crate::client::{Connection, Snapshot, identity};
use crate::decode::CoordinateSystem;
use crate::map::DEFAULT_FAMILY;

/// Flags of the program status word that give the cause of a program's end, and their texts.
const PROGRAM_FAULTS: [(&str, &str); 5] = [
    ("run_time_error", "a run-time error"),
    ("circle_radius_error", "a circle whose radius does not fit (Ix96)"),
    ("amplifier_fault", "an amplifier fault"),
    ("fatal_following_error", "a fatal following error"),
    ("program_hold_stop", "a program hold"),
];

impl Watch {
    /// Refuses coordinate systems whose programs already run, or whose end the reports would not show, before the
    /// command sends a line.
    ///
    /// # Errors
    /// [`Failure::Refused`].
    pub fn check_systems(&mut self, numbers: &[u8]) -> Result<(), Failure> {
        let snapshot = self.snapshot()?;
        for &number in numbers {
            let why = match system(&snapshot, number).and_then(running) {
                Some(false) => continue,
                Some(true) => format!(
                    "coordinate system {number} runs a program already; pmacctl resume {number} ends a hold"
                ),
                None => format!("the board does not report the status of coordinate system {number}"),
            };
            return Err(Failure::Refused(why));
        }
        Ok(())
    }
}

/// The name of the awaited motion.
const PROGRAM: &str = "the program of coordinate system";

/// How long the reports may take to show that a program has begun.
const SEEN_TO_BEGIN: Duration = Duration::from_secs(3);

/// Waits until the reports show that the programs of the coordinate systems `numbers` run, or have moved their motors.
/// The start went over `connection`.
///
/// # Errors
/// [`Failure::Refused`] if a program does not.
pub fn see_programs_begin(
    connection: &mut Connection,
    watch: &mut Watch,
    numbers: &[u8],
) -> Result<Verdict, Failure> {
    let moving = "the start was taken, and nobody has seen yet whether the program runs";
    let awaited = Awaited { numbers, name: PROGRAM, moving, timeout: SEEN_TO_BEGIN, ends: &ends_program };
    let failed = watch.until_over(connection, &awaited, |number, snapshot, look| {
        let Some(system) = system(snapshot, number) else { return Progress::GoesOn };
        let motors = motors(snapshot);
        let own = own_motors(&motors, number.into(), snapshot);
        if running(system) == Some(true) || moved(&own, look) {
            return Progress::Done;
        }
        if look.elapsed < BEGINS { Progress::GoesOn } else { not_begun(system, &own) }
    })?;
    Verdict::without(&failed)
}

/// Waits until the programs of the coordinate systems `numbers` have ended and their motors stand. The start went over
/// `connection`.
///
/// # Errors
/// [`Failure::Refused`] if a program did not come to its end, if another client ended it, or if the wait ends first: by
/// ^C, by the time limit, or because no report comes.
pub fn wait_for_programs(
    context: &mut Context,
    connection: &mut Connection,
    watch: &mut Watch,
    numbers: &[u8],
    timeout: Duration,
) -> Result<Verdict, Failure> {
    let list: Vec<String> = numbers.iter().map(ToString::to_string).collect();
    let moving = format!(
        "the program of coordinate system {} MAY BE RUNNING: only the wait has ended; pmacctl panel stop {} aborts it",
        list.join(", "),
        list.join(" ")
    );
    let mut ran = BTreeSet::new();
    let awaited = Awaited { numbers, name: PROGRAM, moving: &moving, timeout, ends: &ends_program };
    let failed = watch.until_over(connection, &awaited, |number, snapshot, look| {
        let Some(system) = system(snapshot, number) else { return Progress::GoesOn };
        if running(system) == Some(true) {
            ran.insert(number);
            return Progress::GoesOn;
        }
        judge(system, snapshot, look, ran.contains(&number))
    })?;
    let unseen = unseen_motors(&watch.snapshot()?, numbers);
    if !unseen.is_empty() {
        note(format_args!(
            "pmacctl: whether motor {} stands is not known: nothing reports it (I59; [servo] motors in pmacd's configuration)",
            unseen.join(", ")
        ));
    }
    if context.output.is_json() {
        context.output.json(&json!({ "coordinate_systems": numbers, "failed": failed }))?;
        context.output.flush()?;
    }
    Verdict::without(&failed)
}

/// The outcome of a program that does not run; `ran`: the reports showed it running.
fn judge(system: &CoordinateSystem, snapshot: &Snapshot, look: &Observed<'_>, ran: bool) -> Progress {
    let number = system.coordinate_system;
    let motors = motors(snapshot);
    let own = own_motors(&motors, number, snapshot);
    let failed =
        |why: &str| Progress::Failed(format!("the program of coordinate system {number} was ended by {why}"));
    if !ran && look.elapsed < BEGINS {
        return Progress::GoesOn;
    }
    let has_run = ran || moved(&own, look);
    // The flags of an earlier program stay until the next program runs.
    if let Some(why) = program_fault(system).filter(|_| has_run) {
        return failed(why);
    }
    for motor in own.iter().filter(|_| has_run) {
        if let Some(why) = fault(motor) {
            return Progress::Failed(format!(
                "the program of coordinate system {number} ended, because motor {} has failed: {why}; the motor is at {}",
                motor.servo.motor,
                position(motor)
            ));
        }
    }
    if has_run && !own.iter().all(|motor| stands(motor)) {
        return Progress::GoesOn;
    }
    let seen = |motor: usize| look.seen.get(motor - 1).copied().unwrap_or_default();
    if own.iter().any(|motor| seen(motor.servo.motor).aborted) {
        return failed("an abort");
    }
    if has_run { Progress::Done } else { not_begun(system, &own) }
}

/// The cause of the last program's end, if its status tells it.
fn program_fault(system: &CoordinateSystem) -> Option<&'static str> {
    let flags = system.program_status?;
    PROGRAM_FAULTS.iter().find(|(flag, _)| flags.has(flag)).map(|(_, why)| *why)
}

/// The reported motors of coordinate system `number`.
fn own_motors<'a, 'b>(motors: &'b [Motor<'a>], number: usize, snapshot: &Snapshot) -> Vec<&'b Motor<'a>> {
    let is_own = |motor: &&Motor<'_>| system_of(motor.servo.motor, snapshot) == Some(number);
    motors.iter().filter(is_own).collect()
}

/// The motors that may belong to the coordinate systems `numbers` and are in no servo report.
fn unseen_motors(snapshot: &Snapshot, numbers: &[u8]) -> Vec<String> {
    let seen = motors(snapshot);
    let count = identity::family(&snapshot.identity).unwrap_or(DEFAULT_FAMILY).motors;
    let is_seen = |motor: usize| seen.iter().any(|seen| seen.servo.motor == motor);
    let may_belong = |motor: usize| {
        system_of(motor, snapshot)
            .is_none_or(|system| numbers.iter().any(|number| usize::from(*number) == system))
    };
    (1..=count)
        .filter(|motor| !is_seen(*motor) && may_belong(*motor))
        .map(|motor| motor.to_string())
        .collect()
}

/// Whether the reports showed a move of one of the motors.
fn moved(own: &[&Motor<'_>], look: &Observed<'_>) -> bool {
    own.iter().any(|motor| look.seen.get(motor.servo.motor - 1).is_some_and(|seen| seen.moved))
}

/// The text for a program that the reports never showed running, with the likely cause.
fn not_begun(system: &CoordinateSystem, own: &[&Motor<'_>]) -> Progress {
    let earlier = program_fault(system).map(|why| format!("; an earlier program was ended by {why}"));
    let faults =
        own.iter().filter_map(|motor| Some(format!("; motor {}: {}", motor.servo.motor, fault(motor)?)));
    let signs: String = earlier.into_iter().chain(faults).collect();
    Progress::Failed(format!(
        "coordinate system {} was not seen to run: the board did not start its program, or the program ended at once{signs}",
        system.coordinate_system
    ))
}

fn system(snapshot: &Snapshot, number: u8) -> Option<&CoordinateSystem> {
    let background = snapshot.background.as_ref().filter(|background| background.is_fresh())?;
    background.data.coordinate_systems.iter().find(|system| system.coordinate_system == usize::from(number))
}

/// Those of `numbers` whose coordinate systems run no program, as far as the board reports.
pub fn without_program(snapshot: &Snapshot, numbers: &[u8]) -> Vec<u8> {
    let is_idle =
        |number: &u8| system(snapshot, *number).is_some_and(|system| running(system) == Some(false));
    numbers.iter().copied().filter(is_idle).collect()
}

fn running(system: &CoordinateSystem) -> Option<bool> {
    Some(system.status?.has("running_program"))
}
