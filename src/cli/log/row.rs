//! The columns of a row: number and time of the update, missing updates before the next, and the motors' values.

use std::ops::Range;

use super::words::{PREFIX, Words};
use crate::cli::context::Failure;
use crate::client::{Gap, View};
use crate::decode::{Quantity, ServoData};
use crate::gather::SampleClock;
use crate::table::{Field, FieldKind};

/// The fields of a motor that the log takes by default.
pub const DEFAULT_FIELDS: &[&str] =
    &["commanded_position", "actual_position", "following_error", "velocity", "servo_status"];

/// A value of every row.
#[derive(Debug, Clone, PartialEq)]
struct Column {
    /// The motor's number, and the value's place in [`crate::decode::ServoMotor::quantities`].
    motor: usize,
    place: usize,
    /// Whether the value is scaled; else it is the register's integer.
    is_scaled: bool,
    field: Field,
}

/// Turns updates into rows.
pub struct LogRows {
    clock: SampleClock,
    columns: Vec<Column>,
    /// The fields of the site's own words, behind the columns.
    words: Vec<Field>,
    /// The servo timer and the host's time at time 0.
    zero: (u64, u64),
    /// The host's time, and the row's time, at the previous update.
    last: Option<(u64, f64)>,
    /// The servo timer of the previous update.
    last_timer: u64,
    /// Board or daemon paused or restarted since then: the servo timer does not say for how long.
    has_paused: bool,
    row: Vec<f64>,
}

/// The fields before the columns: `update`, the time, `unix_s`, `missed`, `lost`.
const OWN: usize = 5;
/// The places of `missed` and `lost`.
pub const GAP: Range<usize> = 3..OWN;
/// The place of the time in a row.
pub const TIME: usize = 1;
/// The place of `unix_s`.
const UNIX: usize = 2;

impl LogRows {
    /// Rows for the named motors and fields, of updates like `first`. Without `motors`, rows for all activated motors.
    ///
    /// # Errors
    /// [`Failure::Request`] names the motor or field that the report does not have.
    pub fn new(
        first: &View<ServoData>,
        motors: &[usize],
        fields: &[String],
        servo_period_ns: Option<f64>,
    ) -> Result<Self, Failure> {
        let activated = first.data.motors.iter().filter(|motor| motor.is_activated());
        let activated: Vec<usize> = activated.map(|motor| motor.motor).collect();
        let motors = if motors.is_empty() { &activated } else { motors };
        let columns = motors.iter().map(|number| columns(&first.data, *number, fields));
        let columns: Vec<Column> = columns.collect::<Result<Vec<_>, _>>()?.concat();
        let clock = SampleClock { period: 1, servo_period_ns };
        let zero = (first.servo_timer, first.time_ns);
        Ok(Self {
            clock,
            columns,
            words: Vec::new(),
            zero,
            last: None,
            last_timer: first.servo_timer,
            has_paused: false,
            row: Vec::new(),
        })
    }

    /// The same rows with `words` behind the columns.
    pub fn with(mut self, words: &Words) -> Self {
        self.words = words.fields().cloned().collect();
        self
    }

    /// The fields of the table.
    pub fn fields(&self) -> Vec<Field> {
        let time = if self.clock.servo_period_ns.is_some() { FieldKind::Seconds } else { FieldKind::Real };
        let own: [Field; OWN] = [
            Field::new("update", "", FieldKind::Integer),
            Field::new(self.clock.title(), "", time),
            Field::new("unix_s", "", FieldKind::Seconds),
            Field::new("missed", "", FieldKind::Integer),
            Field::new("lost", "", FieldKind::Integer),
        ];
        let columns = self.columns.iter().map(|column| column.field.clone());
        own.into_iter().chain(columns).chain(self.words.iter().cloned()).collect()
    }

    /// The names of the columns for which `update` has no value.
    pub fn without_value(&self, update: &ServoData) -> Vec<&str> {
        let has = |column: &Column| column.quantity(update).is_some();
        self.columns.iter().filter(|column| !has(column)).map(|column| &*column.field.name).collect()
    }

    /// The length of a servo cycle, if the first update knew it.
    pub fn servo_period_ns(&self) -> Option<f64> {
        self.clock.servo_period_ns
    }

    /// The columns whose scale the board has not told, in `update`: the time, and columns with a register's integer.
    pub fn unscaled(&self, update: &ServoData) -> Vec<&str> {
        let time = self.clock.servo_period_ns.is_none().then_some("time_s");
        let is_raw = |column: &&Column| column.quantity(update).is_some_and(|value| value.number().is_none());
        time.into_iter().chain(self.columns.iter().filter(is_raw).map(|column| &*column.field.name)).collect()
    }

    /// Whether `update` has none of the scaled values of the first update: a restarted daemon does not know the scales
    /// at first.
    pub fn lacks_scales(&self, update: &ServoData) -> bool {
        let mut scaled = self.columns.iter().filter(|column| column.is_scaled).peekable();
        scaled.peek().is_some() && scaled.all(|column| column.number(update).is_nan())
    }

    /// The row of an update, with the `words` of its time.
    pub fn update(&mut self, update: &View<ServoData>, words: &mut Words) -> &[f64] {
        let unix_s = update.realtime_ns as f64 / 1e9;
        let time = self.time(update);
        self.row.clear();
        self.row.extend([update.sequence as f64, time, unix_s, 0.0, 0.0]);
        let Self { row, columns, .. } = self;
        row.extend(columns.iter().map(|column| column.number(&update.data)));
        row.extend(words.at(update.time_ns));
        row
    }

    /// The row of an update with unknown scales: the update's number and times, counted as missed, and without values.
    pub fn unscaled_update(&mut self, update: &View<ServoData>, words: &mut Words) -> &[f64] {
        self.update(update, words);
        self.gap(Gap { missed: 1, ..Gap::default() })
    }

    /// Makes the time of the latest update time 0. Returns the update's old time.
    pub fn zero(&mut self) -> f64 {
        let Some((_, time)) = &mut self.last else { return 0.0 };
        self.zero.0 = self.last_timer;
        std::mem::take(time)
    }

    /// The row of the updates missing after the last update: with that update's number and times, and without values.
    pub fn gap(&mut self, gap: Gap) -> &[f64] {
        self.row.resize(OWN + self.columns.len() + self.words.len(), f64::NAN);
        self.row[GAP].copy_from_slice(&[gap.missed as f64, gap.lost as f64]);
        self.row[OWN..].fill(f64::NAN);
        &self.row
    }

    /// How long no update has come, at `now_ns` of the host's clock.
    pub fn silent_ns(&self, now_ns: u64) -> u64 {
        self.last.map_or(0, |(last_ns, _)| now_ns.saturating_sub(last_ns))
    }

    /// The row of a pause that lasts until the end, `silent_ns` after the last update: with that update's number, and
    /// the times of the end.
    pub fn pause_at_end(&mut self, silent_ns: u64) -> &[f64] {
        self.gap(Gap::default());
        let Some((_, last)) = self.last else { return &self.row };
        let cycle_ns = self.clock.servo_period_ns.unwrap_or(1e9);
        self.row[TIME] = last + silent_ns as f64 / cycle_ns * self.clock.at(1);
        self.row[UNIX] += silent_ns as f64 / 1e9;
        &self.row
    }

    /// Notes that board or daemon paused or restarted before the next update.
    pub fn pause(&mut self) {
        self.has_paused = true;
    }

    /// The time by the board's servo timer. After a pause, in which the timer may begin anew, the host's clock gives
    /// the time since the last update.
    fn time(&mut self, update: &View<ServoData>) -> f64 {
        let View { servo_timer, time_ns, .. } = *update;
        if let Some((last_ns, last)) = self.last
            && (std::mem::take(&mut self.has_paused) || servo_timer < self.last_timer)
        {
            let cycle_ns = self.clock.servo_period_ns.unwrap_or(1e9);
            let cycles = last / self.clock.at(1) + time_ns.saturating_sub(last_ns) as f64 / cycle_ns;
            self.zero.0 = servo_timer.wrapping_sub(cycles.round() as u64);
        }
        let time = self.clock.at(servo_timer.wrapping_sub(self.zero.0));
        self.last = Some((time_ns, time));
        self.last_timer = servo_timer;
        time
    }
}

fn columns(first: &ServoData, number: usize, fields: &[String]) -> Result<Vec<Column>, Failure> {
    let Some(motor) = first.motors.iter().find(|motor| motor.motor == number) else {
        let reported: Vec<_> = first.motors.iter().map(|motor| motor.motor.to_string()).collect();
        return Err(Failure::Request(format!(
            "motor {number} is not in the servo report; it has {}",
            reported.join(", ")
        )));
    };
    let quantities = motor.quantities();
    let column = |name: &str| {
        let place = motor.place(name)?;
        let quantity = quantities[place];
        let is_scaled = quantity.is_some_and(|quantity| quantity.value.is_some());
        let unit = quantity.map_or("", |quantity| quantity.unit);
        let field = Field::new(format!("{number}.{name}"), unit, FieldKind::Real);
        Some(Column { motor: number, place, is_scaled, field })
    };
    if fields.is_empty() {
        return Ok(DEFAULT_FIELDS.iter().filter_map(|name| column(name)).collect());
    }
    let unknown = |name: &str| {
        let names: Vec<_> = motor.names().collect();
        let elsewhere = match name {
            "commanded_position" => format!("; pmacctl gather -s {number}.{name} samples it"),
            _ => String::new(),
        };
        Failure::Request(format!("the servo report has no {name:?}; it has {}{elsewhere}", names.join(", ")))
    };
    let fields = fields.iter().filter(|name| !name.starts_with(PREFIX));
    fields.map(|name| column(name).ok_or_else(|| unknown(name))).collect()
}

impl Column {
    fn quantity(&self, update: &ServoData) -> Option<Quantity> {
        // Most boards report motors from 1 on, without gaps.
        let motor = update.motors.get(self.motor - 1).filter(|motor| motor.motor == self.motor);
        let motor = motor.or_else(|| update.motors.iter().find(|motor| motor.motor == self.motor));
        motor?.quantities()[self.place]
    }

    /// NaN while the report lacks the value, or while its scale is unknown.
    fn number(&self, update: &ServoData) -> f64 {
        let number = self.quantity(update).and_then(|quantity| match self.is_scaled {
            true => quantity.value,
            false => Some(quantity.raw as f64),
        });
        number.unwrap_or(f64::NAN)
    }
}
