//! One motor as users see it: the servo report's part, the background report's, and the configured name.

use serde_json::{Value, json};

use super::number::{NOT_READ, fixed};
use super::shown_flags;
use crate::decode::{BackgroundData, BackgroundMotor, Flags, Quantity, ServoData, ServoMotor};
use crate::map::{Family, NumberKind, StatusTable, block_fields};
use crate::segment::{Identity, UserUnit};

/// One motor.
pub struct Motor<'a> {
    /// The motor in the servo report.
    pub servo: &'a ServoMotor,
    /// The motor in a fresh background report.
    background: Option<&'a BackgroundMotor>,
    family: &'static Family,
    name: Option<&'a str>,
    unit: Option<UserUnit>,
}

impl<'a> Motor<'a> {
    /// The motors of the servo report of a board of `family`.
    pub fn all(
        servo: &'a ServoData,
        background: Option<&'a BackgroundData>,
        identity: &'a Identity,
        family: &'static Family,
    ) -> Vec<Self> {
        let one = |servo: &'a ServoMotor| {
            let motors = background.map_or(&[][..], |data| &data.motors[..]);
            let index = servo.motor - 1;
            Self {
                servo,
                background: motors.iter().find(|other| other.motor == servo.motor),
                family,
                name: identity.names.get(index).and_then(|name| name.as_deref()),
                unit: identity.units.get(index).copied().flatten(),
            }
        };
        servo.motors.iter().map(one).collect()
    }

    /// The activated motors of `motors`.
    #[must_use]
    pub fn activated(mut motors: Vec<Self>) -> Vec<Self> {
        motors.retain(|motor| motor.servo.is_activated());
        motors
    }

    /// As JSON: the family's keys, null for unknown values.
    pub fn document(&self) -> Value {
        let mut document = json!(self.servo);
        if self.is_in_background() {
            let of = |value: fn(&BackgroundMotor) -> Option<Quantity>| json!(self.background.and_then(value));
            document["position_bias"] = of(|motor| motor.position_bias);
            document["target_position"] = of(|motor| motor.target_position);
        }
        if self.is_reported("compensation_position") {
            document["reported_position"] = json!(self.reported_position());
        }
        let flags = self.background_flags();
        for (key, flag) in
            [("homed", "home_complete"), ("in_position", "in_position"), (FATAL_ERROR, FATAL_ERROR)]
        {
            document[key] = json!(flags.map(|flags| flags.has(flag)));
        }
        if let Some(name) = self.name {
            document["name"] = json!(name);
        }
        if let Some(unit) = self.unit {
            let scaled = |quantity: Option<Quantity>| json!(in_unit(unit, quantity));
            document["user"] = json!({
                "unit": unit.name,
                "counts_per_unit": unit.counts_per_unit,
                "commanded_position": scaled(self.servo.commanded_position),
                "actual_position": scaled(self.servo.actual_position),
                "following_error": scaled(self.servo.following_error),
                "velocity": scaled(self.servo.velocity),
            });
        }
        document
    }

    /// The end of the motor's present move.
    pub fn target(&self) -> Option<Quantity> {
        self.background.and_then(|motor| motor.target_position)
    }

    /// The motor's name in the configuration.
    pub fn name(&self) -> Option<&str> {
        self.name
    }

    /// The actual position in the user's unit: `12.3456 deg`; `None` if the configuration gives the motor no unit.
    pub fn user_position(&self) -> Option<String> {
        let unit = self.unit?;
        let position = in_unit(unit, self.servo.actual_position);
        let position =
            position.map_or_else(|| NOT_READ.to_owned(), |position| fixed(position, unit.places()));
        Some(format!("{position} {}", &unit.name[..]))
    }

    /// Whether the background report has motors, too; otherwise the servo report has everything.
    fn is_in_background(&self) -> bool {
        self.family.background.numbers != NumberKind::CoordinateSystem
    }

    /// The words of `?`, with the meaning of their bits; `None` for an unknown word.
    pub fn status_words(&self) -> [Option<Flags>; 2] {
        [self.servo.status, self.background_flags()]
    }

    /// The flags of the background status word, the second word of `?`.
    fn background_flags(&self) -> Option<Flags> {
        if self.is_in_background() {
            return self.background?.status;
        }
        let word = u32::try_from(self.servo.background_status?.raw).ok()?;
        Some(Flags { word, table: self.family.status.motor.get(1)? })
    }

    /// Whether the flag called `name` of either word of `?` is set; `None` while that word is unknown.
    pub fn has(&self, name: &str) -> Option<bool> {
        let has = |table: Option<&StatusTable>| {
            table.is_some_and(|table| table.flags.iter().any(|(_, flag)| *flag == name))
        };
        let tables = self.family.status.motor;
        let flags = if has(tables.first()) { self.servo.status } else { self.background_flags() };
        flags.map(|flags| flags.has(name))
    }

    /// The answer to `P`: actual position, bias and compensation (Software Reference, `P`). Unknown while the motor
    /// follows a master, which Ix06 can subtract, and without the compensation in the report.
    fn reported_position(&self) -> Option<Quantity> {
        if self.servo.status?.has("handwheel_enabled") {
            return None;
        }
        let (bias, compensation) = (self.background?.position_bias?, self.servo.compensation_position?);
        let actual = self.servo.actual_position?;
        let value = actual.value.zip(bias.value).zip(compensation.value).map(|((a, b), c)| a + b + c);
        Some(Quantity { raw: actual.raw + bias.raw + compensation.raw, value, ..actual })
    }

    /// Whether the family's reports have this register of a motor.
    pub fn is_reported(&self, name: &str) -> bool {
        ["servo", "background"]
            .iter()
            .any(|function| block_fields(self.family, function).any(|field| field.name == name))
    }

    /// Why `P` answers another position than the actual one, if it does.
    pub fn why_p_differs(&self) -> Option<String> {
        let (reported, actual) = (self.reported_position()?.value?, self.servo.actual_position?.value?);
        let number = self.servo.motor;
        // `P` answers in tenths of a count.
        ((reported - actual).abs() >= 0.05).then(|| {
            let (reported, more) = (fixed(reported, 1), fixed(reported - actual, 1));
            format!("#{number}P answers {reported}: {more} more, by the bias (PSET, axis definitions) and compensation")
        })
    }

    /// Words for flags that are not ordinary, worst first.
    pub fn flags(&self) -> Vec<&'static str> {
        shown_flags::of_motor(self.servo.status, self.background_flags())
    }
}

const FATAL_ERROR: &str = "fatal_following_error";

fn in_unit(unit: UserUnit, quantity: Option<Quantity>) -> Option<f64> {
    Some(unit.of_counts(quantity?.value?))
}
