//! Whether the program of a coordinate system has ended, and its motors stand.
//!
//! The running bit is 0 as soon as the last move has been calculated, "even if the motors are still executing the last move"
//! (Software Reference, `??`), so the motors of the coordinate system have to stand as well.
//!
//! No report tells a program that somebody ends by `Q` or at the end of a block from one that has come to its end.

use std::collections::BTreeSet;
use std::time::Duration;

use serde_json::json;

use super::motors::{fault, position, stands};
use super::{BEGINS, Look, Progress, Watch};
use crate::cli::context::{Context, Failure, Verdict};
use crate::cli::show::motors::motors;
use crate::client::Snapshot;
use crate::decode::CoordinateSystem;

/// Flags of the program status word that say why a program has ended, and what is said of it.
const FAULTS: [(&str, &str); 5] = [
    ("run_time_error", "a run-time error"),
    ("circle_radius_error", "a circle whose radius does not fit (Ix96)"),
    ("amplifier_fault", "an amplifier fault"),
    ("fatal_following_error", "a fatal following error"),
    ("program_hold_stop", "a program hold"),
];

impl Watch {
    /// Refuses coordinate systems whose programs run already, or whose end nobody would see. Nothing has been sent yet.
    ///
    /// # Errors
    /// [`Failure::Refused`].
    pub fn check_systems(&mut self, numbers: &[u8]) -> Result<(), Failure> {
        let snapshot = self.snapshot()?;
        for &number in numbers {
            let why = match system(&snapshot, number).and_then(running) {
                Some(false) => continue,
                Some(true) => format!("coordinate system {number} runs a program already"),
                None => format!("the board does not report the status of coordinate system {number}"),
            };
            return Err(Failure::Refused(why));
        }
        Ok(())
    }
}

/// Waits until the programs of the coordinate systems `numbers` have ended and their motors stand.
///
/// # Errors
/// [`Failure::Refused`] where a program did not come to its end, or where the wait ends first: by ^C, by the time limit, or
/// because no report comes.
pub fn wait_for_programs(
    context: &mut Context,
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
    let failed = watch.until_over(numbers, timeout, &moving, |number, snapshot, look| {
        let Some(system) = system(snapshot, number) else { return Progress::GoesOn };
        if running(system) == Some(true) {
            ran.insert(number);
            return Progress::GoesOn;
        }
        judge(system, snapshot, look, ran.contains(&number))
    })?;
    if context.output.is_json() {
        context.output.json(&json!({ "coordinate_systems": numbers, "failed": failed }))?;
        context.output.flush()?;
    }
    if failed.is_empty() { Ok(Verdict::Yes) } else { Err(Failure::Refused(failed.join("\n"))) }
}

/// What has become of a program that does not run; `ran` if it was seen to.
fn judge(system: &CoordinateSystem, snapshot: &Snapshot, look: &Look<'_>, ran: bool) -> Progress {
    let number = system.coordinate_system;
    let motors = motors(snapshot);
    let own = |motor: usize| {
        let background = snapshot.background.as_ref()?;
        background.data.motors.iter().find(|other| other.motor == motor)?.coordinate_system
    };
    let own: Vec<_> = motors
        .iter()
        .filter(|motor| own(motor.servo.motor).is_some_and(|system| system as usize == number))
        .collect();
    let failed =
        |why: &str| Progress::Failed(format!("the program of coordinate system {number} was ended by {why}"));
    if !ran && look.elapsed < BEGINS {
        return Progress::GoesOn;
    }
    let flags = system.program_status;
    if let Some((_, why)) = FAULTS.iter().find(|(flag, _)| flags.is_some_and(|flags| flags.has(flag))) {
        return failed(why);
    }
    for motor in &own {
        if let Some(why) = fault(motor) {
            return failed(&format!("motor {}: {why}; it is at {}", motor.servo.motor, position(motor)));
        }
    }
    if !own.iter().all(|motor| stands(motor)) {
        return Progress::GoesOn;
    }
    let seen = |motor: usize| look.seen.get(motor - 1).copied().unwrap_or_default();
    if own.iter().any(|motor| seen(motor.servo.motor).aborted) {
        return failed("an abort");
    }
    if ran || own.iter().any(|motor| seen(motor.servo.motor).moved) {
        return Progress::Done;
    }
    Progress::Failed(format!(
        "coordinate system {number} was not seen to run: the board did not start its program, or the program ended at once"
    ))
}

fn system(snapshot: &Snapshot, number: u8) -> Option<&CoordinateSystem> {
    let background = snapshot.background.as_ref().filter(|background| background.is_fresh())?;
    background.data.coordinate_systems.iter().find(|system| system.coordinate_system == usize::from(number))
}

fn running(system: &CoordinateSystem) -> Option<bool> {
    Some(system.status?.has("running_program"))
}
