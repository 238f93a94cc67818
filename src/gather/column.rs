//! The meaning of a sample's longs, and its time.

use serde::Serialize;

use super::reading::Reading;
use super::source::Source;
use crate::decode::Scales;
use crate::table::{Field, FieldKind};

/// One column of gathered data.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Column {
    /// The source's name.
    pub name: String,
    /// The register, `D:$002B`, or the registers with blanks between them.
    pub register: String,
    /// How to read their longs.
    pub reading: Reading,
    /// Factor from the read number to `unit`.
    pub factor: f64,
    /// The unit; empty if none is known.
    pub unit: &'static str,
}

impl Column {
    /// The column of `source`, in counts, DAC bits or milliseconds if the scale is known, else in raw units.
    #[must_use]
    pub fn new(source: &Source, scales: &Scales) -> Self {
        let motor = source.motor.map(|motor| scales.motor(motor)).unwrap_or_default();
        let counts = |scale: Option<f64>, unit| {
            scale.filter(|scale| *scale > 0.0).map(|scale| (1.0 / (scale * 32.0), unit))
        };
        // A unit may have a second reading behind a semicolon.
        let units = source.units.split(';').next().unwrap_or_default();
        let scaled = match units {
            "1/(Ix08*32) count" => counts(motor.position_scale, "count"),
            "1/(Ix07*32) count of the master" => counts(motor.master_scale, "count of the master"),
            "1/(Ix09*32) count per servo cycle" => counts(motor.velocity_scale, "count per servo cycle"),
            "1/256 DAC bit" => Some((1.0 / 256.0, "DAC bit")),
            "1/2 msec" => Some((0.5, "msec")),
            _ => None,
        };
        let (factor, unit) = scaled.unwrap_or((1.0, units));
        Self {
            name: source.name.clone(),
            register: source.registers.iter().map(ToString::to_string).collect::<Vec<_>>().join(" "),
            reading: source.reading,
            factor,
            unit,
        }
    }

    fn field(&self) -> Field {
        Field::new(&self.name, self.unit, FieldKind::Real)
    }

    /// Name and unit, for a table's head.
    #[must_use]
    pub fn title(&self) -> String {
        self.field().title()
    }
}

/// The fields of a table of samples: `sample` (rows of lost samples are missing, so the number jumps),
/// [`SampleClock::title`], the columns.
#[must_use]
pub fn fields(columns: &[Column], clock: SampleClock) -> Vec<Field> {
    let time = if clock.servo_period_ns.is_some() { FieldKind::Seconds } else { FieldKind::Real };
    let own = [Field::new("sample", "", FieldKind::Integer), Field::new(clock.title(), "", time)];
    own.into_iter().chain(columns.iter().map(Column::field)).collect()
}

/// Appends the values of one sample to `values`. A value behind the sample's end is not a number.
pub fn decode(columns: &[Column], sample: &[u32], values: &mut Vec<f64>) {
    let mut rest = sample;
    for column in columns {
        values.push(column.reading.read(rest).map_or(f64::NAN, |number| number * column.factor));
        rest = rest.get(column.reading.longs()..).unwrap_or(&[]);
    }
}

/// The times of samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SampleClock {
    /// Servo cycles from one sample to the next (I19).
    pub period: u32,
    /// The servo period in nanoseconds (I10); without it times are in servo cycles.
    pub servo_period_ns: Option<f64>,
}

impl SampleClock {
    /// The name of the time column.
    #[must_use]
    pub const fn title(self) -> &'static str {
        if self.servo_period_ns.is_some() { "time_s" } else { "servo_cycle" }
    }

    /// The time of `sample` since sample 0, in seconds or servo cycles.
    #[must_use]
    pub fn at(self, sample: u64) -> f64 {
        let cycles = sample as f64 * f64::from(self.period);
        self.servo_period_ns.map_or(cycles, |period_ns| cycles * period_ns / 1e9)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::decode::MotorScales;
    use crate::format::{fixed48, float48, int24};
    use crate::map::{Layout, PMAC};

    pub fn columns(names: &[&str], scales: &Scales) -> Vec<Column> {
        let layout = Layout::new(&PMAC, None);
        names.iter().map(|name| Column::new(&Source::parse(name, &layout).unwrap(), scales)).collect()
    }

    pub fn scales() -> Scales {
        let motor = MotorScales {
            position_scale: Some(96.0),
            velocity_scale: Some(48.0),
            master_scale: Some(0.0),
            ..Default::default()
        };
        Scales { motors: vec![motor], i10: Some(3_713_707) }
    }

    #[test]
    fn samples_become_numbers_with_units() {
        let names = [
            "1.actual_position",
            "1.actual_velocity",
            "1.servo_status",
            "1.previous_dac",
            "L:$1005",
            "X:$33",
        ];
        let columns = columns(&names, &scales());
        let [low, high] = fixed48::encode(-3072 * 5);
        let [y, x] = float48::encode(-3.25);
        let sample = [low, high, int24::extend(0xFF_FA00), int24::extend(0x81_2000), 256, y, x, 0xFFFF_FFFF];
        let mut values = Vec::new();
        decode(&columns, &sample, &mut values);
        assert_eq!(values, [-5.0, -1.0, f64::from(0x81_2000), 1.0, -3.25, -1.0]);
        let titles: Vec<_> = columns.iter().map(Column::title).collect();
        assert_eq!(titles[..2], ["1.actual_position [count]", "1.actual_velocity [count per servo cycle]"]);
        assert_eq!(titles[4..], ["L:$1005", "X:$0033"]);
        values.clear();
        decode(&columns, &sample[..3], &mut values);
        assert_eq!(values.iter().filter(|value| value.is_nan()).count(), 4);
    }

    #[test]
    fn a_following_error_is_computed_unless_the_motor_follows_a_master() {
        let columns = columns(&["1.following_error", "X:$33"], &scales());
        let [commanded, actual, compensation] = [3072 * 7, 3072 * 4, 3072].map(fixed48::encode);
        let positions = [commanded, actual, compensation].concat();
        let values = |status: u32| {
            let mut values = Vec::new();
            decode(&columns, &[&positions[..], &[int24::extend(status), 5]].concat(), &mut values);
            values
        };
        assert_eq!((values(0x81_2000), &*columns[0].title()), (vec![2.0, 5.0], "1.following_error [count]"));
        let following = values(0x91_2000);
        assert!(following[0].is_nan() && following[1] == 5.0);
        assert_eq!(columns[0].register, "D:$0028 D:$002B D:$0046 X:$003D");
    }

    #[test]
    fn without_a_scale_the_raw_unit_stands() {
        let unit = |name: &str, scales: &Scales| {
            let column = &columns(&[name], scales)[0];
            (column.factor, column.unit)
        };
        assert_eq!(unit("1.actual_position", &Scales::default()), (1.0, "1/(Ix08*32) count"));
        assert_eq!(unit("2.actual_position", &scales()), (1.0, "1/(Ix08*32) count"));
        // A scale of zero says nothing.
        assert_eq!(unit("1.master_position", &scales()), (1.0, "1/(Ix07*32) count of the master"));
        assert_eq!(unit("1.time_left", &Scales::default()), (0.5, "msec"));
    }

    #[test]
    fn every_scaled_unit_of_the_register_table_is_known() {
        let all = MotorScales {
            position_scale: Some(1.0),
            velocity_scale: Some(1.0),
            master_scale: Some(1.0),
            ..Default::default()
        };
        let scales = Scales { motors: vec![all], i10: None };
        for name in [
            "commanded_position",
            "actual_position",
            "master_position",
            "compensation_position",
            "previous_dac",
            "actual_velocity",
            "time_left",
            "target_position",
            "position_bias",
            "average_velocity",
        ] {
            let column = &columns(&[&format!("1.{name}")], &scales)[0];
            assert_ne!(column.factor, 1.0, "{name}");
        }
    }

    #[test]
    fn time_is_the_samples_own() {
        let clock = SampleClock { period: 4, servo_period_ns: Some(442_708.4) };
        assert_eq!((clock.at(0), clock.title()), (0.0, "time_s"));
        assert!((clock.at(1000) - 1.770_833_6).abs() < 1e-9);
        let clock = SampleClock { servo_period_ns: None, ..clock };
        assert_eq!((clock.at(10), clock.title()), (40.0, "servo_cycle"));
    }
}
