//! The wait for motors: whether each motor has come to its goal.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use serde_json::json;

use super::stops::stops_motor;
use super::{Awaited, BEGINS, NO_REPORT_FOR, Observed, Progress, SAMPLE_WITHIN, STOOD_FOR, Watch, since};
use crate::cli::context::{Context, Failure, Verdict};
use crate::cli::show::motors::motors;
use crate::client::motor::Motor;
use crate::client::number::{fixed, labelled};
use crate::client::{Connection, Snapshot};
use crate::protocol::board::SentStop;
use crate::segment::Counter;

/// Servo flags of a motor that moves or is about to.
pub(super) const MOVES: [&str; 2] = ["definite_time_move", "home_search_in_progress"];
/// Servo flag of a motor that is commanded to stand.
pub(super) const STANDS_STILL: &str = "desired_velocity_zero";
/// Flags of faults that end a motion for good, and their texts. `open_loop` is last: it follows from the others.
const MOTOR_FAULTS: [(&str, &str); 6] = [
    ("fatal_following_error", "its following error is fatal (Ix11)"),
    ("integrated_fatal_following_error", "its integrated following error is fatal (Ix63)"),
    ("amplifier_fault", "its amplifier has a fault"),
    ("i2t_amplifier_fault", "its amplifier is overloaded (I2T)"),
    ("phasing_search_error", "its phasing search failed"),
    ("open_loop", "its loop is open: it was killed"),
];
/// How far from its target the commanded position of a motor that has arrived may be, in counts. A target is rounded to 1/32
/// of a count.
const TARGET_WITHIN: f64 = 0.5;
/// How far the position of a motor that rests may flicker, in counts.
const RESTS_WITHIN: f64 = 2.0;
/// How long a motor must have stood if the board does not tell its scale any more.
const TOLD: Duration = Duration::from_secs(10);

/// The goal of a wait.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Goal {
    /// The motor stands at this position, in counts.
    At(f64),
    /// The motor has found home.
    Home,
    /// The motor stands.
    Stands,
}

/// Refuses a motor that cannot move, or whose motion the reports would not show.
fn can_move(motor: &Motor<'_>) -> Result<(), String> {
    let number = motor.servo.motor;
    match (motor.has("motor_activated"), motor.has("open_loop"), motor.has("in_position")) {
        (Some(false), ..) => Err(format!("motor {number} is off; I{number}00=1 activates it")),
        (_, Some(true), _) => Err(format!(
            "the loop of motor {number} is open (killed, or a fault); '#{number}J/' closes it where the motor stands"
        )),
        (Some(_), Some(_), Some(_)) => Ok(()),
        _ => Err(format!(
            "pmacd does not read both status words of motor {number}; see [servo] and [background] in its configuration"
        )),
    }
}

impl Watch {
    /// Refuses motors that cannot move, or whose end of motion the reports would not show, before the command sends a
    /// line.
    ///
    /// # Errors
    /// [`Failure::Refused`].
    pub fn check_motors(&mut self, numbers: &[u8]) -> Result<(), Failure> {
        let snapshot = self.snapshot()?;
        let motors = motors(&snapshot);
        for &number in numbers {
            let motor = motors.iter().find(|motor| motor.servo.motor == usize::from(number));
            let missing = || Err(format!("the board does not report motor {number}; see I59"));
            motor.map_or_else(missing, can_move).map_err(Failure::Refused)?;
        }
        Ok(())
    }

    /// The commanded position of the standing motor `number`, in counts.
    ///
    /// # Errors
    /// [`Failure::Refused`] if the motor moves, or its position is unknown.
    pub fn standing_at(&mut self, number: u8) -> Result<f64, Failure> {
        let snapshot = self.snapshot()?;
        let motors = motors(&snapshot);
        let motor = motors.iter().find(|motor| motor.servo.motor == usize::from(number));
        let refused = |why: String| Err(Failure::Refused(why));
        match motor.map(|motor| (stands(motor), commanded(motor))) {
            Some((true, Some(position))) => Ok(position),
            Some((true, None)) => {
                refused(format!("the position of motor {number} in counts is not known yet"))
            }
            _ => refused(format!("motor {number} does not stand in position; wait until it does")),
        }
    }

    /// The position of motor `number` in counts, once its reports have not moved for a moment: a motor whose loop is open
    /// may still turn.
    ///
    /// # Errors
    /// [`Failure::Refused`] if the motor moves, or its position is unknown.
    pub fn rests_at(&mut self, number: u8) -> Result<f64, Failure> {
        let begun = Instant::now();
        let (first, _, since_ns) = rests_now(&self.snapshot()?, number)?;
        loop {
            let last = self.board.servo_sequence()?;
            self.board.wait(last, SAMPLE_WITHIN)?;
            let (counts, _, now_ns) = rests_now(&self.snapshot()?, number)?;
            if (counts - first).abs() > RESTS_WITHIN {
                return Err(Failure::Refused(format!("motor {number} moves; wait until it stands")));
            }
            if since(since_ns, now_ns) >= STOOD_FOR {
                return Ok(counts);
            }
            if begun.elapsed() > NO_REPORT_FOR {
                return Err(Failure::Refused(format!("no report has come of motor {number}")));
            }
        }
    }

    /// The counts from `start`, where motor `number` stood before its move to `target`, to its present place. `None`
    /// while the motor moves or its loop is open, and after a home search or a reset, since its positions may count
    /// from another zero.
    pub fn away_from(&mut self, number: u8, start: f64, target: f64) -> Option<f64> {
        self.follow().ok()?;
        let subscriber = self.board.subscriber();
        if (subscriber.generation(), subscriber.counter(Counter::Resets)) != (self.generation, self.resets) {
            return None;
        }
        let now = self.standing_at(number).ok()?;
        let seen = self.seen.get(usize::from(number).checked_sub(1)?)?;
        // Lost samples may have shown a home search. A motor that stands at its target has not searched for home.
        let is_sure = !seen.homed && (!seen.lost || (now - target).abs() <= TARGET_WITHIN);
        (is_sure && (now - start).abs() > TARGET_WITHIN).then_some(now - start)
    }
}

/// The position of motor `number` as the user reads it.
///
/// # Errors
/// [`Failure::Refused`] if the motor moves, or its position is unknown.
pub fn place_of(snapshot: &Snapshot, number: u8) -> Result<String, Failure> {
    rests_now(snapshot, number).map(|(_, place, _)| place)
}

/// The position of motor `number`, which stands or whose loop is open, in counts and as the user reads it, and the time
/// of the report.
fn rests_now(snapshot: &Snapshot, number: u8) -> Result<(f64, String, u64), Failure> {
    let motors = motors(snapshot);
    let fresh = snapshot.servo.as_ref().filter(|servo| servo.is_fresh());
    let motor = motors.iter().find(|motor| motor.servo.motor == usize::from(number));
    let counts = motor.and_then(|motor| motor.servo.actual_position?.value);
    let why = match (fresh, motor, counts) {
        (Some(servo), Some(motor), Some(counts)) if stands(motor) || motor.has("open_loop") == Some(true) => {
            return Ok((counts, position(motor), servo.time_ns));
        }
        (None, ..) => "the servo data are not live; pmacctl doctor says what to do".to_owned(),
        (_, None, _) => format!("the board does not report motor {number}; see I59"),
        (.., None) => format!("the position of motor {number} in counts is not known yet"),
        _ => format!("motor {number} does not stand in position; wait until it does"),
    };
    Err(Failure::Refused(why))
}

/// Waits until every motor in `numbers` has come to its goal, and prints its position. The request went over
/// `connection`.
///
/// # Errors
/// [`Failure::Refused`] if a motor stands elsewhere, has a fault or was stopped by another client, or if the wait ends
/// before the motion: by ^C, by the time limit, or because no report comes.
pub fn wait_for_motors(
    context: &mut Context,
    connection: &mut Connection,
    watch: &mut Watch,
    numbers: &[u8],
    goal: Goal,
    timeout: Duration,
) -> Result<Verdict, Failure> {
    let failed = motors_end(connection, watch, numbers, goal, timeout)?;
    print_motors(context, watch, numbers, &failed)
}

/// Prints the positions of the motors in `numbers`, or why they `failed`.
fn print_motors(
    context: &mut Context,
    watch: &mut Watch,
    numbers: &[u8],
    failed: &[String],
) -> Result<Verdict, Failure> {
    let snapshot = watch.snapshot()?;
    let motors = motors(&snapshot);
    let waited_for =
        motors.iter().filter(|motor| numbers.iter().any(|number| usize::from(*number) == motor.servo.motor));
    if context.output.is_json() {
        let documents: Vec<_> = waited_for.map(Motor::document).collect();
        context.output.json(&json!({ "motors": documents, "failed": failed }))?;
        context.output.flush()?;
    } else if failed.is_empty() {
        for motor in waited_for {
            context.output.line(format_args!("#{}: {}", motor.servo.motor, position(motor)))?;
        }
    }
    Verdict::without(failed)
}

/// Waits until every motor in `numbers` has come to the goal of the request over `connection`. Returns the failures.
///
/// # Errors
/// [`Failure::Refused`] if the wait ends before the motion.
pub fn motors_end(
    connection: &mut Connection,
    watch: &mut Watch,
    numbers: &[u8],
    goal: Goal,
    timeout: Duration,
) -> Result<Vec<String>, Failure> {
    let list = numbers.iter().map(ToString::to_string).collect::<Vec<_>>().join(",");
    let told = list.replace(',', ", ");
    let moving =
        format!("motor {told} MAY BE MOVING: only the wait has ended; pmacctl jog {list} stop stops it");
    // The time since which each motor has stood.
    let mut stood = BTreeMap::new();
    // A second stop does no harm to a wait for a stop.
    let ends = |number: u8, stop: &SentStop, snapshot: &Snapshot| {
        goal != Goal::Stands && stops_motor(number, stop, snapshot)
    };
    let awaited = Awaited { numbers, name: "motor", moving: &moving, timeout, ends: &ends };
    watch.until_over(connection, &awaited, |number, snapshot, look| {
        let motors = motors(snapshot);
        let Some(motor) = motors.iter().find(|motor| motor.servo.motor == usize::from(number)) else {
            return Progress::Failed(format!("the board does not report motor {number} any more"));
        };
        if let Some(why) = fault(motor) {
            return Progress::Failed(format!("motor {number}: {why}; it is at {}", position(motor)));
        }
        if !stands(motor) {
            stood.remove(&number);
            return Progress::GoesOn;
        }
        let stood = since(*stood.entry(number).or_insert(look.now_ns), look.now_ns);
        judge(motor, goal, look, stood)
    })
}

/// Waits until the reports show that motor `number` is at the position `to`, where it was at `from` before, and prints
/// it. The request went over `connection`.
///
/// # Errors
/// [`Failure::Refused`] if the reports show another position, or do not come.
pub fn see_position(
    context: &mut Context,
    connection: &mut Connection,
    watch: &mut Watch,
    number: u8,
    [from, to]: [f64; 2],
) -> Result<Verdict, Failure> {
    let moving = "the board took the position, and no report shows it yet";
    let awaited =
        Awaited { numbers: &[number], name: "motor", moving, timeout: NO_REPORT_FOR, ends: &|_, _, _| false };
    let failed = watch.until_over(connection, &awaited, |_, snapshot, look| {
        let motors = motors(snapshot);
        let motor = motors.iter().find(|motor| motor.servo.motor == usize::from(number));
        let at = motor.and_then(|motor| motor.servo.actual_position?.value);
        // A motor whose loop is open may creep, and a closed loop keeps its following error.
        let is_set = at.is_some_and(|at| (at - to).abs() <= RESTS_WITHIN.max((at - from).abs() / 10.0));
        match (is_set, motor) {
            (true, _) => Progress::Done,
            (false, Some(motor)) if look.elapsed >= BEGINS => Progress::Failed(format!(
                "the board took the line, but motor {number} is at {}, not at {}",
                position(motor),
                fixed(to, 1)
            )),
            _ => Progress::GoesOn,
        }
    })?;
    print_motors(context, watch, &[number], &failed)
}

/// Whether the motor stands in position.
pub(super) fn stands(motor: &Motor<'_>) -> bool {
    let is = |flag| motor.has(flag) == Some(true);
    is(STANDS_STILL) && is("in_position") && !MOVES.iter().any(|flag| is(flag))
}

/// The fault that has ended its motion for good.
pub(super) fn fault(motor: &Motor<'_>) -> Option<&'static str> {
    let mut faults = MOTOR_FAULTS.iter();
    let why = faults.find(|(flag, _)| motor.has(flag) == Some(true)).map(|(_, why)| *why);
    let off = (motor.has("motor_activated") == Some(false)).then_some("it is off: was the board reset?");
    off.or(why)
}

/// The motor's position, in counts and in its user's unit.
pub(super) fn position(motor: &Motor<'_>) -> String {
    let counts = labelled(motor.servo.actual_position);
    motor.user_position().map_or_else(|| counts.clone(), |user| format!("{counts} ({user})"))
}

/// The commanded position, in counts. A Turbo board does not report it: there the commanded position is the actual
/// position plus the following error.
fn commanded(motor: &Motor<'_>) -> Option<f64> {
    let servo = motor.servo;
    match servo.commanded_position {
        Some(commanded) => commanded.value,
        None => Some(servo.actual_position?.value? + servo.following_error?.value?),
    }
}

/// Whether a motor that stands in position has reached its goal.
fn judge(motor: &Motor<'_>, goal: Goal, look: &Observed<'_>, stood: Duration) -> Progress {
    let number = motor.servo.motor;
    let seen = look.seen.get(number - 1).copied().unwrap_or_default();
    if seen.homed && matches!(goal, Goal::At(_)) {
        // The motor's positions count from another home than at the request for the jog.
        return Progress::Failed(format!(
            "motor {number} searched for home meanwhile, so its position may count from another place: it stands at {}",
            position(motor)
        ));
    }
    let moved = seen.moved;
    let has_begun = moved || look.elapsed >= BEGINS;
    let missed = match goal {
        Goal::At(target) => match commanded(motor) {
            Some(commanded) => {
                ((commanded - target).abs() > TARGET_WITHIN).then(|| format!("not at {}", fixed(target, 1)))
            }
            None if stood < TOLD => return Progress::GoesOn,
            None => {
                return Progress::Failed(format!(
                    "motor {number} stands at {}; the board has not told its scale (Ix08), so whether that is {} is not known",
                    position(motor),
                    fixed(target, 1)
                ));
            }
        },
        Goal::Home => {
            let is_home = has_begun && motor.has("home_complete") == Some(true);
            // The flag of an earlier search stays until another search begins, and the board may have dropped the
            // request for one.
            match is_home && !seen.homed && !seen.lost {
                true => Some(
                    "and has not searched for home: does a program run in its coordinate system?".to_owned(),
                ),
                false => (!is_home).then(|| "and has not found home".to_owned()),
            }
        }
        Goal::Stands if has_begun => None,
        Goal::Stands => return Progress::GoesOn,
    };
    let Some(wanted) = missed else { return Progress::Done };
    if !has_begun || stood < STOOD_FOR {
        return Progress::GoesOn;
    }
    let limits: Vec<&str> = [
        ("positive_limit_set", "+limit"),
        ("negative_limit_set", "-limit"),
        ("stopped_on_position_limit", "limit stop"),
    ]
    .into_iter()
    .filter_map(|(flag, short)| (motor.has(flag) == Some(true)).then_some(short))
    .collect();
    let why = if limits.is_empty() { String::new() } else { format!(" ({})", limits.join(", ")) };
    let began = if moved { "stands" } else { "did not move: it stands" };
    Progress::Failed(format!("motor {number} {began} at {}, {wanted}{why}", position(motor)))
}
