//! The motors, as a table, a line or JSON.

use serde_json::{Value, json};

use crate::cli::console::{Table, rfc3339};
use crate::cli::show::screen::{Live, state, update};
use crate::client::motor::Motor;
use crate::client::number::labelled;
use crate::client::{Board, Connection, Snapshot, Staleness, View, identity};
use crate::map::DEFAULT_FAMILY;
use crate::protocol::board::REPLAY_OVER;

/// The activated motors to show.
pub struct Motors<'a>(pub &'a Snapshot);

impl Live for Motors<'_> {
    fn update(&self) -> (u64, bool) {
        update(self.0.servo.as_ref())
    }

    fn document(&self) -> Value {
        let motors: Vec<Value> = shown(self.0).iter().map(Motor::document).collect();
        json!({ "servo": stamp(self.0.servo.as_ref(), self.0.stale), "motors": motors })
    }

    fn text(&self, width: Option<usize>, why: &mut dyn FnMut(Staleness) -> String) -> String {
        let Some(servo) = &self.0.servo else {
            let why = why(self.0.stale.unwrap_or(Staleness::Off));
            return format!("STALE: there are no servo data yet: {why}\n");
        };
        let note = servo.stale.map_or_else(String::new, |stale| format!("STALE: {}\n", why(stale)));
        let motors = shown(self.0);
        if motors.is_empty() && !servo.data.motors.is_empty() {
            return note + "no motor of the servo report is activated (Ix00=1)\n";
        }
        if motors.is_empty() {
            return note
                + "no motor is in the servo report: the board is told to report none, or pmacd leaves that as found until it \
                   knows the M-variables (pmacctl status)\n";
        }
        let table = table(&motors);
        let table = match width {
            Some(width) => table.fitting(width, &SPARE),
            None => table.to_string(),
        };
        let notes = motors.iter().filter_map(Motor::why_p_differs).map(|why| why + "\n");
        note + &table + &notes.collect::<String>()
    }

    /// The actual position, the following error and the flags of each motor.
    fn line(&self) -> String {
        let motors = shown(self.0);
        let motors = motors.iter().map(|motor| {
            let (number, position) = (motor.servo.motor, labelled(motor.servo.actual_position));
            let (error, flags) = (labelled(motor.servo.following_error), motor.flags().join(","));
            let user = motor.user_position().map_or_else(String::new, |position| {
                let name = motor.name().unwrap_or("user");
                format!(" {name}={}", position.replace(' ', ""))
            });
            format!(" #{number}={position}{user} following_error={error} flags={flags}")
        });
        state(self.0.servo.as_ref(), self.0.stale) + &motors.collect::<String>()
    }
}

/// The motors of the servo report, with fresh background data.
pub fn motors(snapshot: &Snapshot) -> Vec<Motor<'_>> {
    let Some(servo) = &snapshot.servo else { return Vec::new() };
    let background = snapshot.background.as_ref().filter(|background| background.is_fresh());
    let background = background.map(|background| &background.data);
    let family = identity::family(&snapshot.identity).unwrap_or(DEFAULT_FAMILY);
    Motor::all(&servo.data, background, &snapshot.identity, family)
}

/// The activated motors: commands show no others.
pub fn shown(snapshot: &Snapshot) -> Vec<Motor<'_>> {
    Motor::activated(motors(snapshot))
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

/// Columns that a narrow screen can do without, the least important first.
const SPARE: [&str; 6] = ["target", "commanded", "velocity", "following error", "name", "position"];

/// Why data are not live, as a sentence. Only the daemon knows that a replay is over.
pub fn reason(board: &mut Board, stale: Staleness) -> String {
    // For other reasons the daemon may not answer.
    let may_be_over = matches!(stale, Staleness::BoardSilent | Staleness::NoUpdates { .. } | Staleness::Off);
    let is_over =
        may_be_over && board.connection().and_then(Connection::info).is_ok_and(|info| info.is_over());
    if is_over { REPLAY_OVER.to_owned() } else { stale.to_string() }
}

/// The motors, in counts and counts a second, and in the configuration's unit if a motor has one.
pub fn table(motors: &[Motor<'_>]) -> Table {
    let mut table =
        Table::new(">motor|name|>target|>commanded|>actual|>position|>following error|>velocity|flags");
    for motor in motors {
        table.row([
            format!("#{}", motor.servo.motor),
            motor.name().unwrap_or_default().to_owned(),
            labelled(motor.target()),
            labelled(motor.servo.commanded_position),
            labelled(motor.servo.actual_position),
            motor.user_position().unwrap_or_default(),
            labelled(motor.servo.following_error),
            labelled(motor.servo.velocity),
            motor.flags().join(" "),
        ]);
    }
    // Drop columns that the family reports for no motor. A column that pmacd merely does not read stays.
    if let Some(motor) = motors.first() {
        let columns = [
            ("commanded", "commanded_position"),
            ("velocity", "actual_velocity"),
            ("target", "target_position"),
        ];
        for (column, register) in columns {
            if !motor.is_reported(register) {
                table.drop_column(column);
            }
        }
    }
    if motors.iter().all(|motor| motor.name().is_none()) {
        table.drop_column("name");
    }
    if motors.iter().all(|motor| motor.user_position().is_none()) {
        table.drop_column("position");
    }
    table
}
