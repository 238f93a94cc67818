//! `pmacctl motors`: the servo data, as a table or JSON.

use serde_json::{Value, json};

use crate::cli::console::table::{Align, Table};
use crate::cli::console::time::rfc3339;
use crate::cli::context::{Context, Failure, Verdict};
use crate::client::{Snapshot, Staleness, View};
use crate::decode::{BackgroundData, Quantity, ServoData, ServoMotor};

pub fn run(context: &mut Context) -> Result<Verdict, Failure> {
    let snapshot = context.board()?.snapshot()?;
    if context.output.is_json() {
        context.output.json(&document(&snapshot))?;
    } else {
        context.output.text(text(&snapshot))?;
    }
    Ok(snapshot.servo.is_some_and(|servo| servo.is_fresh()).into())
}

/// The document of `motors --json`.
pub fn document(snapshot: &Snapshot) -> Value {
    let motors = snapshot.servo.as_ref().map_or(json!([]), |servo| json!(servo.data.motors));
    json!({ "servo": stamp(snapshot.servo.as_ref(), snapshot.stale), "motors": motors })
}

/// The time of a region's data, and whether they are live.
pub fn stamp<T>(view: Option<&View<T>>, otherwise: Option<Staleness>) -> Value {
    let Some(view) = view else {
        let stale = otherwise.map_or("no_data", Staleness::name);
        return json!({
            "time": null, "time_ns": null, "age_ms": null, "servo_timer": null, "sequence": 0,
            "fresh": false, "stale": stale,
        });
    };
    json!({
        "time": rfc3339(view.realtime_ns),
        "time_ns": view.time_ns,
        "age_ms": view.age_ns as f64 / 1e6,
        "servo_timer": view.servo_timer,
        "sequence": view.sequence,
        "fresh": view.is_fresh(),
        "stale": view.stale.map(Staleness::name),
    })
}

/// The text of `motors`.
pub fn text(snapshot: &Snapshot) -> String {
    let Some(servo) = &snapshot.servo else {
        let reason = snapshot.stale.map_or_else(|| Staleness::Off.to_string(), |stale| stale.to_string());
        return format!("STALE: there are no servo data yet: {reason}\n");
    };
    let note = servo.stale.map_or_else(String::new, |stale| format!("STALE: {stale}\n"));
    let background = snapshot.background.as_ref().filter(|background| background.is_fresh());
    note + &table(&servo.data, background.map(|background| &background.data))
}

/// The table of the motors, with their background status flags if known.
pub fn table(servo: &ServoData, background: Option<&BackgroundData>) -> String {
    let mut table = Table::new(&[
        ("motor", Align::Right),
        ("commanded", Align::Right),
        ("actual", Align::Right),
        ("difference", Align::Right),
        ("velocity", Align::Right),
        ("unit", Align::Left),
        ("flags", Align::Left),
    ]);
    for motor in &servo.motors {
        let positions = [motor.commanded_position, motor.actual_position].into_iter().flatten();
        let scaled = positions.map(|position| position.value.is_some()).next();
        let background =
            background.and_then(|data| data.motors.iter().find(|other| other.motor == motor.motor));
        let mut flags = flags(motor);
        flags.extend(
            background
                .into_iter()
                .filter_map(|background| background.status)
                .flat_map(|status| SHORT_BACKGROUND.short(|name| status.has(name))),
        );
        table.row([
            format!("#{}", motor.motor),
            number(motor.commanded_position),
            number(motor.actual_position),
            difference(motor.commanded_position, motor.actual_position),
            velocity(motor.actual_velocity),
            match scaled {
                Some(true) => "count".to_owned(),
                Some(false) => "raw".to_owned(),
                None => NOT_READ.to_owned(),
            },
            flags.join(" "),
        ]);
    }
    table.to_string()
}

/// Marks data that the daemon does not read from the board.
pub const NOT_READ: &str = "-";

/// A position: in counts if the scale is known, else the raw integer.
pub fn number(quantity: Option<Quantity>) -> String {
    in_places(quantity, 1)
}

/// As [`number`], for use without a unit column: `9710688raw` is not in counts.
pub fn labelled(quantity: Option<Quantity>) -> String {
    let raw = quantity.is_some_and(|quantity| quantity.value.is_none());
    number(quantity) + if raw { "raw" } else { "" }
}

/// The value with this many decimal places, else the raw integer.
fn in_places(quantity: Option<Quantity>, places: usize) -> String {
    let Some(Quantity { raw, value, .. }) = quantity else { return NOT_READ.to_owned() };
    value.map_or_else(|| raw.to_string(), |value| fixed(value, places))
}

/// Rounds to this many decimal places. A result of 0 has no sign.
fn fixed(value: f64, places: usize) -> String {
    let text = format!("{value:.places$}");
    match text.strip_prefix('-') {
        Some(zero) if zero.bytes().all(|byte| matches!(byte, b'0' | b'.')) => zero.to_owned(),
        _ => text,
    }
}

/// Commanded minus actual position. This is not the following error: the board's settings decide whether that includes
/// the compensation and master positions.
fn difference(commanded: Option<Quantity>, actual: Option<Quantity>) -> String {
    let (Some(commanded), Some(actual)) = (commanded, actual) else { return NOT_READ.to_owned() };
    match (commanded.value, actual.value) {
        (Some(commanded), Some(actual)) => fixed(commanded - actual, 1),
        _ => commanded.raw.wrapping_sub(actual.raw).to_string(),
    }
}

fn velocity(quantity: Option<Quantity>) -> String {
    in_places(quantity, 3)
}

/// Short words for flags, worst first.
struct Short(&'static [(&'static str, &'static str)]);

impl Short {
    fn short(&self, is_set: impl Fn(&str) -> bool) -> Vec<&'static str> {
        self.0.iter().filter(|(name, _)| is_set(name)).map(|(_, short)| *short).collect()
    }
}

const SHORT_SERVO: Short = Short(&[
    ("negative_limit_set", "-limit"),
    ("positive_limit_set", "+limit"),
    ("data_block_error", "data-error"),
    ("abort_deceleration", "aborting"),
    ("open_loop", "open-loop"),
    ("home_search_in_progress", "homing"),
    ("dwell_in_progress", "dwell"),
    ("definite_time_move", "timed-move"),
    ("handwheel_enabled", "following"),
]);

const SHORT_BACKGROUND: Short = Short(&[
    ("fatal_following_error", "fatal-error"),
    ("integrated_fatal_following_error", "integrated-fatal-error"),
    ("amplifier_fault", "amplifier-fault"),
    ("i2t_amplifier_fault", "i2t-fault"),
    ("phasing_search_error", "phasing-error"),
    ("stopped_on_position_limit", "limit-stop"),
    ("warning_following_error", "warning-error"),
    ("home_complete", "homed"),
    ("in_position", "in-position"),
]);

fn flags(motor: &ServoMotor) -> Vec<&'static str> {
    let Some(status) = motor.status else { return vec![NOT_READ] };
    if !status.has("motor_activated") {
        return vec!["off"];
    }
    let mut flags = SHORT_SERVO.short(|name| status.has(name));
    if !status.has("desired_velocity_zero") && !status.has("open_loop") {
        flags.push("moving");
    }
    flags
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::PMAC;

    #[test]
    fn nothing_has_no_sign_and_raw_numbers_say_so() {
        let quantity = |raw, value| Some(Quantity { raw, value, unit: "" });
        for (value, text) in [(-0.04, "0.0"), (-0.0, "0.0"), (-0.06, "-0.1"), (-10.0, "-10.0"), (0.04, "0.0")]
        {
            assert_eq!(number(quantity(-1, Some(value))), text);
            assert_eq!(labelled(quantity(-1, Some(value))), text);
        }
        assert_eq!(difference(quantity(1, Some(1.0)), quantity(1, Some(1.01))), "0.0");
        assert_eq!(velocity(quantity(0, Some(-0.0001))), "0.000");
        assert_eq!((number(quantity(-7, None)), labelled(quantity(-7, None))), ("-7".into(), "-7raw".into()));
        assert_eq!(labelled(None), NOT_READ);
    }

    #[test]
    fn every_short_word_stands_for_a_flag_there_is() {
        for (shorts, table) in
            [(SHORT_SERVO, &PMAC.status.motor[0]), (SHORT_BACKGROUND, &PMAC.status.motor[1])]
        {
            for (name, _) in shorts.0 {
                assert!(table.flags.iter().any(|(_, flag)| flag == name), "{name}");
            }
        }
        for name in ["motor_activated", "desired_velocity_zero", "open_loop"] {
            assert!(PMAC.status.motor[0].flags.iter().any(|(_, flag)| *flag == name), "{name}");
        }
    }
}
