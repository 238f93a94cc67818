//! The board's numbers for Prometheus, in its text format. Every name begins with `pmac_`, positions are in counts.

use prometheus::{Encoder, GaugeVec, Opts, Registry, TEXT_FORMAT, TextEncoder};
use prometheus::{IntCounter, IntGauge};

use pmac_dpram::client::{Board, ClientError, Motor, Snapshot, UserValues, identity};
use pmac_dpram::decode::Quantity;
use pmac_dpram::format::Visible;
use pmac_dpram::map::DEFAULT_FAMILY;

use crate::board::Place;

/// The content type.
pub const KIND: &str = TEXT_FORMAT;

/// The counts since the daemon's start, by the counter's name in the segment.
const COUNTERS: [(&str, &str, &str); 8] = [
    ("updates", "pmac_servo_updates_total", "Servo updates of the board that pmacd has read."),
    (
        "missed",
        "pmac_servo_updates_missed_total",
        "Servo updates of the board that pmacd did not read in time.",
    ),
    (
        "skipped",
        "pmac_servo_updates_skipped_total",
        "Servo updates that the board held off because Host-Busy was set.",
    ),
    ("bus_accesses", "pmac_bus_accesses_total", "Bus cycles on the board."),
    ("bus_errors", "pmac_bus_errors_total", "Bus cycles that failed."),
    ("background_updates", "pmac_background_updates_total", "Background updates that pmacd has read."),
    (
        "ascii_commands",
        "pmac_ascii_commands_total",
        "Command lines and control characters sent to the board.",
    ),
    ("ascii_errors", "pmac_ascii_errors_total", "Error replies of the board."),
];

/// A value of a motor: the metric, its help text, and its source.
type MotorValue = (&'static str, &'static str, fn(&Motor<'_>) -> Option<f64>);

const MOTOR_VALUES: [MotorValue; 4] = [
    ("pmac_motor_position_counts", "Actual position in counts.", |motor| value(motor.servo.actual_position)),
    ("pmac_motor_commanded_position_counts", "Commanded position in counts.", |motor| {
        value(motor.servo.commanded_position)
    }),
    ("pmac_motor_following_error_counts", "Following error in counts.", |motor| {
        value(motor.servo.following_error)
    }),
    ("pmac_motor_velocity_counts_per_second", "Actual velocity in counts per second.", |motor| {
        motor.servo.velocity.filter(|velocity| velocity.unit == "count/s").and_then(|velocity| velocity.value)
    }),
];

/// Flags of a motor that are worth an alarm or a line in a picture.
const MOTOR_FLAGS: [(&str, &str); 8] = [
    ("motor_activated", "pmac_motor_activated"),
    ("open_loop", "pmac_motor_open_loop"),
    ("in_position", "pmac_motor_in_position"),
    ("home_complete", "pmac_motor_home_complete"),
    ("fatal_following_error", "pmac_motor_fatal_following_error"),
    ("amplifier_fault", "pmac_motor_amplifier_fault"),
    ("positive_limit_set", "pmac_motor_positive_limit_set"),
    ("negative_limit_set", "pmac_motor_negative_limit_set"),
];

/// The metrics of the board now. The text leaves out values that are not live; it always has `pmac_up` and
/// `pmac_live`.
///
/// # Errors
/// This program can't write the numbers as text, or can't read the board's data.
pub fn text(place: &Place) -> Result<String, String> {
    let registry = Registry::new();
    add(&registry, place).map_err(|error| error.to_string())?;
    let mut text = Vec::new();
    TextEncoder::new().encode(&registry.gather(), &mut text).map_err(|error| error.to_string())?;
    String::from_utf8(text).map_err(|error| error.to_string())
}

fn add(registry: &Registry, place: &Place) -> Result<(), Box<dyn std::error::Error>> {
    let mut board = match place.attach() {
        Ok(board) => Some(board),
        Err(ClientError::Segment(_) | ClientError::Socket(_)) => None,
        Err(error) => return Err(error.into()),
    };
    let snapshot = board.as_mut().map(Board::snapshot).transpose()?;
    let is_up = snapshot.as_ref().is_some_and(|snapshot| snapshot.stale.is_none());
    let is_live = is_up && snapshot.as_ref().is_some_and(|snapshot| snapshot.old().is_none());
    gauge(registry, "pmac_up", "Whether pmacd runs and the board answers.", is_up.into())?;
    gauge(registry, "pmac_live", "Whether all data that the board reports are live.", is_live.into())?;
    let (Some(board), Some(snapshot)) = (board, snapshot) else { return Ok(()) };
    for (counter, count) in board.subscriber().counters() {
        if let Some((_, name, help)) = COUNTERS.iter().find(|(own, ..)| *own == counter.name()) {
            let counter = IntCounter::with_opts(Opts::new(*name, *help))?;
            counter.inc_by(count);
            registry.register(Box::new(counter))?;
        }
    }
    info(registry, board.name().as_str(), &snapshot)?;
    motors(registry, &snapshot)?;
    systems(registry, &snapshot)?;
    words(registry, &snapshot)
}

fn gauge(registry: &Registry, name: &str, help: &str, value: i64) -> prometheus::Result<()> {
    let gauge = IntGauge::with_opts(Opts::new(name, help))?;
    gauge.set(value);
    registry.register(Box::new(gauge))
}

/// A gauge with labels.
fn gauges(registry: &Registry, name: &str, help: &str, labels: &[&str]) -> prometheus::Result<GaugeVec> {
    let gauges = GaugeVec::new(Opts::new(name, help), labels)?;
    registry.register(Box::new(gauges.clone()))?;
    Ok(gauges)
}

fn info(registry: &Registry, name: &str, snapshot: &Snapshot) -> Result<(), Box<dyn std::error::Error>> {
    let identity = &snapshot.identity;
    let labels = ["board", "family", "type", "firmware"];
    let family = identity.family.and_then(|_| identity::family(identity)).map_or("", |family| family.name);
    let text = |text: Option<String>| text.unwrap_or_default();
    let (kind, firmware) = (
        text(identity.board_type.as_ref().map(|text| Visible(text).to_string())),
        text(identity.firmware.as_ref().map(|text| Visible(text).to_string())),
    );
    let info = gauges(registry, "pmac_board_info", "The board, in labels; always 1.", &labels)?;
    info.with_label_values(&[name, family, &kind, &firmware]).set(1.0);
    if let Some(period_ns) = identity::scales(identity).servo_period_ns() {
        let help = "The length of a servo cycle in seconds.";
        let period = gauges(registry, "pmac_servo_period_seconds", help, &[])?;
        period.with_label_values::<&str>(&[]).set(period_ns / 1e9);
    }
    Ok(())
}

fn value(quantity: Option<Quantity>) -> Option<f64> {
    quantity?.value
}

fn motors(registry: &Registry, snapshot: &Snapshot) -> Result<(), Box<dyn std::error::Error>> {
    let Some(servo) = snapshot.servo.as_ref().filter(|view| view.is_fresh()) else { return Ok(()) };
    let background = snapshot.background.as_ref().filter(|view| view.is_fresh()).map(|view| &view.data);
    let family = identity::family(&snapshot.identity).unwrap_or(DEFAULT_FAMILY);
    let motors = Motor::all(&servo.data, background, &snapshot.identity, family);
    let labels = ["motor", "name"];
    let label =
        |motor: &Motor<'_>| [motor.servo.motor.to_string(), motor.name().unwrap_or_default().to_owned()];
    for (name, help, of) in MOTOR_VALUES {
        let gauges = gauges(registry, name, help, &labels)?;
        for motor in &motors {
            if let Some(value) = of(motor) {
                gauges.with_label_values(&label(motor)).set(value);
            }
        }
    }
    for (flag, name) in MOTOR_FLAGS {
        let gauges = gauges(registry, name, &format!("Whether the board's flag {flag} is set."), &labels)?;
        for motor in &motors {
            if let Some(is_set) = motor.has(flag) {
                gauges.with_label_values(&label(motor)).set(f64::from(is_set));
            }
        }
    }
    Ok(())
}

fn systems(registry: &Registry, snapshot: &Snapshot) -> Result<(), Box<dyn std::error::Error>> {
    let Some(background) = snapshot.background.as_ref().filter(|view| view.is_fresh()) else { return Ok(()) };
    let systems = &background.data.coordinate_systems;
    let labels = ["coordinate_system"];
    let help = "Whether a motion program runs.";
    let running = gauges(registry, "pmac_coordinate_system_running", help, &labels)?;
    let lines =
        gauges(registry, "pmac_coordinate_system_lines", "Program lines that remain, as PR.", &labels)?;
    for system in systems {
        let label = [system.coordinate_system.to_string()];
        if let Some(status) = system.status {
            running.with_label_values(&label).set(status.has("running_program").into());
        }
        if let Some(remaining) = system.lines_remaining {
            lines.with_label_values(&label).set(remaining.into());
        }
    }
    Ok(())
}

/// The site's own words; of a name with several values each with its number, from 1.
fn words(registry: &Registry, snapshot: &Snapshot) -> Result<(), Box<dyn std::error::Error>> {
    let Some(view) = snapshot.user.as_ref().filter(|view| view.is_fresh()) else { return Ok(()) };
    let help = "A word of the site's own programs, in its unit.";
    let gauges = gauges(registry, "pmac_user", help, &["name", "index", "unit"])?;
    for UserValues { word, values } in &view.data.words {
        for (index, value) in values.iter().flatten().enumerate() {
            let index = if word.count == 1 { String::new() } else { (index + 1).to_string() };
            gauges.with_label_values(&[&word.name[..], &index, &word.unit[..]]).set(value.number());
        }
    }
    Ok(())
}
