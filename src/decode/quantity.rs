//! A number with its raw form and unit, and the I-variables that scale it.

use serde::ser::{Serialize, SerializeSeq, Serializer};

use crate::map::StatusTable;
use crate::map::status::flags;

/// A register's value: the integer as the manual defines it, and the quantity that it stands for.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Quantity {
    /// The integer as the manual defines it.
    pub raw: i64,
    /// The value in `unit`; `None` if the scale is not known or the register is not a number.
    pub value: Option<f64>,
    /// The unit of `value`; without a value that of `raw`.
    pub unit: &'static str,
}

/// The units of registers without a scale: their integer is the value.
const WITHOUT_SCALE: [&str; 3] = [BITS, ADDRESS, AVERAGED];
const BITS: &str = "bits";
const ADDRESS: &str = "PMAC address";
const AVERAGED: &str = "1/(Ix09*32) count per servo cycle at the default I60 and I61";

impl Quantity {
    /// The value, or the integer of a register without a scale. `None` if the register's scale is not known: its
    /// integer would pass for a value that is off by thousands.
    #[must_use]
    pub fn number(&self) -> Option<f64> {
        self.value.or_else(|| WITHOUT_SCALE.contains(&self.unit).then_some(self.raw as f64))
    }

    /// `raw` counted in 1/(`scale`*32) of `unit`, for which `raw_unit` stands while the scale is not known.
    fn scaled(raw: i64, scale: Option<f64>, unit: &'static str, raw_unit: &'static str) -> Self {
        // A scale of zero switches the loop off; the register has no counts then.
        match scale.filter(|scale| *scale > 0.0) {
            Some(scale) => Self { raw, value: Some(raw as f64 / (scale * 32.0)), unit },
            None => Self { raw, value: None, unit: raw_unit },
        }
    }

    pub(super) fn position(raw: i64, scales: MotorScales) -> Self {
        Self::scaled(raw, scales.position_scale, "count", "1/(Ix08*32) count")
    }

    pub(super) fn master(raw: i64, scales: MotorScales) -> Self {
        Self::scaled(raw, scales.master_scale, "count of the master", "1/(Ix07*32) count of the master")
    }

    pub(super) fn velocity(raw: i32, scales: MotorScales) -> Self {
        let raw_unit = "1/(Ix09*32) count per servo cycle";
        Self::scaled(raw.into(), scales.velocity_scale, "count per servo cycle", raw_unit)
    }

    /// The same velocity in counts a second, if the length of a cycle of the motor's loop is known: counts/ms are
    /// raw/(Ix09*32) * 8388608/(I10*(Ix60+1)) (Software Reference, `V`).
    pub(super) fn velocity_per_second(raw: i32, scales: MotorScales, servo_period_ns: Option<f64>) -> Self {
        let per_cycle = Self::velocity(raw, scales);
        let cycle_ns = servo_period_ns.zip(scales.loop_cycles).map(|(period, cycles)| period * cycles);
        match per_cycle.value.zip(cycle_ns) {
            Some((value, cycle_ns)) => {
                Self { value: Some(value * 1e9 / cycle_ns), unit: "count/s", ..per_cycle }
            }
            None => Self { value: None, unit: "1/(Ix09*32) count per servo cycle", ..per_cycle },
        }
    }

    /// The board averages this velocity over servo cycles and shifts it by I60 and I61, which this module does not
    /// know (Turbo Software Reference p. 65), so the velocity has no value.
    pub(super) fn averaged_velocity(raw: i32) -> Self {
        Self { raw: raw.into(), value: None, unit: AVERAGED }
    }

    pub(super) fn dac(raw: i32) -> Self {
        Self { raw: raw.into(), value: Some(f64::from(raw) / 256.0), unit: "DAC bit" }
    }

    /// Half milliseconds at 100 % feed rate override.
    pub(super) fn time(raw: i32) -> Self {
        Self { raw: raw.into(), value: Some(f64::from(raw) / 2.0), unit: "msec" }
    }

    /// A time base in the unit of I10: I10 itself is 100 %.
    pub(super) fn time_base(raw: i32, i10: Option<u32>) -> Self {
        match i10.filter(|i10| *i10 > 0) {
            Some(i10) => {
                let percent = f64::from(raw) / f64::from(i10) * 100.0;
                Self { raw: raw.into(), value: Some(percent), unit: "%" }
            }
            None => Self { raw: raw.into(), value: None, unit: "1/8388608 msec" },
        }
    }

    pub(super) fn bits(raw: u32) -> Self {
        Self { raw: raw.into(), value: None, unit: BITS }
    }

    pub(super) fn address(raw: u32) -> Self {
        Self { raw: raw.into(), value: None, unit: ADDRESS }
    }
}

/// The scales of a motor, as far as known.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct MotorScales {
    /// Ix08: a position's raw unit is 1/(Ix08*32) count.
    pub position_scale: Option<f64>,
    /// Ix09: a velocity's raw unit is 1/(Ix09*32) count per servo cycle.
    pub velocity_scale: Option<f64>,
    /// Ix07: a master position's raw unit is 1/(Ix07*32) count of the master.
    pub master_scale: Option<f64>,
    /// Ix60+1: the servo cycles in a cycle of the motor's loop.
    pub loop_cycles: Option<f64>,
}

/// The scales of a board, as far as known.
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct Scales {
    /// The scales of motor 1 and following.
    pub motors: Vec<MotorScales>,
    /// I10: the servo period in 1/8388608 ms.
    pub i10: Option<u32>,
}

impl Scales {
    /// The scales of `motor`, from 1; all unknown for a motor beyond the list.
    #[must_use]
    pub fn motor(&self, motor: usize) -> MotorScales {
        motor.checked_sub(1).and_then(|index| self.motors.get(index)).copied().unwrap_or_default()
    }

    /// The servo period in nanoseconds; `None` while I10 is not known or zero.
    #[must_use]
    pub fn servo_period_ns(&self) -> Option<f64> {
        self.i10.filter(|i10| *i10 > 0).map(|i10| f64::from(i10) * 1e6 / 8_388_608.0)
    }
}

/// A status word and the names of its bits. Prints and serialises as the names of the flags that are set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Flags {
    /// The 24-bit word.
    pub word: u32,
    /// The meaning of its bits.
    pub table: &'static StatusTable,
}

impl Flags {
    /// The names of the flags that are set, highest bit first.
    pub fn names(&self) -> impl Iterator<Item = &'static str> + use<> {
        flags(self.word, self.table)
    }

    /// Whether the flag called `name` is set.
    #[must_use]
    pub fn has(&self, name: &str) -> bool {
        self.names().any(|flag| flag == name)
    }
}

impl Serialize for Flags {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut names = serializer.serialize_seq(None)?;
        for name in self.names() {
            names.serialize_element(name)?;
        }
        names.end()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::status;

    #[test]
    fn a_position_is_scaled_only_where_the_scale_is_known() {
        let known = MotorScales { position_scale: Some(96.0), ..MotorScales::default() };
        let position = Quantity::position(-3072, known);
        assert_eq!((position.raw, position.value, position.unit), (-3072, Some(-1.0), "count"));
        for unknown in [None, Some(0.0), Some(f64::NAN)] {
            let scales = MotorScales { position_scale: unknown, ..known };
            let position = Quantity::position(3072, scales);
            assert_eq!((position.value, position.unit), (None, "1/(Ix08*32) count"));
        }
    }

    #[test]
    fn an_integer_whose_scale_is_not_known_is_no_number() {
        let unknown = MotorScales::default();
        let known = MotorScales { position_scale: Some(96.0), ..unknown };
        assert_eq!(Quantity::position(6144, unknown).number(), None);
        assert_eq!(Quantity::position(6144, known).number(), Some(2.0));
        assert_eq!(Quantity::velocity_per_second(6144, unknown, Some(5e5)).number(), None);
        assert_eq!(Quantity::bits(6144).number(), Some(6144.0));
        assert_eq!(Quantity::averaged_velocity(-3).number(), Some(-3.0));
        assert_eq!(Quantity::address(5).number(), Some(5.0));
    }

    #[test]
    fn a_velocity_has_seconds_only_where_the_cycle_is_known() {
        let known =
            MotorScales { velocity_scale: Some(96.0), loop_cycles: Some(2.0), ..MotorScales::default() };
        // A count a cycle of two servo cycles of half a millisecond.
        let velocity = |scales, period| Quantity::velocity_per_second(3072, scales, period);
        let found = velocity(known, Some(5e5));
        assert_eq!((found.raw, found.value, found.unit), (3072, Some(1000.0), "count/s"));
        assert_eq!(velocity(known, None).value, None);
        for unknown in
            [MotorScales { loop_cycles: None, ..known }, MotorScales { velocity_scale: None, ..known }]
        {
            assert_eq!(velocity(unknown, Some(5e5)).value, None);
        }
    }

    #[test]
    fn scales_of_unknown_motors_are_unknown() {
        let scales = Scales {
            motors: vec![MotorScales { master_scale: Some(96.0), ..Default::default() }],
            i10: None,
        };
        assert_eq!(scales.motor(1).master_scale, Some(96.0));
        assert_eq!(scales.motor(2), MotorScales::default());
        assert_eq!(scales.motor(0), MotorScales::default());
    }

    #[test]
    fn the_servo_period_follows_from_i10() {
        let period = |i10| Scales { motors: Vec::new(), i10 }.servo_period_ns();
        assert_eq!(period(Some(3_713_707)).map(f64::round), Some(442_708.0));
        assert_eq!(period(Some(8_388_608)), Some(1e6));
        assert_eq!(period(Some(0)), None);
        assert_eq!(period(None), None);
    }

    #[test]
    fn flags_serialise_as_their_names() {
        let flags = Flags { word: 0x81_2000, table: &status::PMAC.motor[0] };
        let text = serde_json::to_string(&flags).unwrap();
        assert_eq!(text, r#"["motor_activated","integration_mode","desired_velocity_zero"]"#);
        assert!(flags.has("motor_activated") && !flags.has("open_loop"));
    }
}
