//! The board's identity: the payload of the board region. `docs/segment.md` has its table.
//!
//! The daemon asks the board once by ASCII (`TYPE`, `VERSION`, I-variables); it takes the configuration's values for
//! unanswered questions. A bit marks each known value, because a zero is a value, too.

use crate::format::Text;

/// Length of the payload in bytes.
pub const BYTES: usize = 0x790;
/// Most motors of a board.
pub const MOTORS: usize = 32;

const AT_KNOWN: usize = 0x000;
const AT_FAMILY: usize = 0x004;
const AT_MOTORS: usize = 0x008;
const AT_COORDINATE_SYSTEMS: usize = 0x00C;
const AT_SERVO_PERIOD: usize = 0x010;
const AT_I10: usize = 0x018;
const AT_REPORT_CYCLES: usize = 0x01C;
const AT_SERVO_REPORT: usize = 0x020;
const AT_BACKGROUND_REPORT: usize = 0x024;
const AT_MOTOR_MASK: usize = 0x028;
const AT_SCALES_KNOWN: usize = 0x02C;
const AT_FIRMWARE: usize = 0x040;
/// Room for the board's answer to `VERSION`, in bytes.
pub const FIRMWARE_BYTES: usize = 16;
const AT_BOARD_TYPE: usize = 0x050;
/// Room for the board's answer to `TYPE`, in bytes.
pub const BOARD_TYPE_BYTES: usize = 64;
const AT_SCALES: usize = 0x090;
const AT_COUNTS_PER_UNIT: usize = 0x290;
const AT_NAMES: usize = 0x390;
const AT_UNITS: usize = 0x590;
/// Room for a motor's name, and for its unit's name, in bytes.
pub const NAME_BYTES: usize = 16;
const SERVO_PERIOD_BIT: u32 = 3;
const FIRMWARE_BIT: u32 = 9;
const BOARD_TYPE_BIT: u32 = 10;
/// The place of each copy of the global status: 0 has the second word of `???` at 0x03C. The value is always 0; older
/// clients read it.
const GLOBAL_WORDS_BIT: u32 = 11;
const REPLAY_BIT: u32 = 12;

/// The unit in which the users of a motor think, from the configuration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UserUnit {
    /// The unit's name: `deg`.
    pub name: Text<NAME_BYTES>,
    /// Counts in one unit; not 0. Negative if the unit grows as the counts fall.
    pub counts_per_unit: f64,
}

impl UserUnit {
    /// `counts` in this unit.
    #[must_use]
    pub fn of_counts(&self, counts: f64) -> f64 {
        counts / self.counts_per_unit
    }

    /// Decimal places that show a tenth of a count.
    #[must_use]
    pub fn places(&self) -> usize {
        let places = (self.counts_per_unit.abs() * 10.0).log10().ceil();
        // A float becomes the nearest integer.
        (places as usize).min(12)
    }
}

/// The known facts about the board; `None`: unknown.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Identity {
    /// Board family: 1 PMAC, 2 PMAC2, 3 Turbo PMAC, 4 Turbo PMAC2.
    pub family: Option<u32>,
    /// Number of motors.
    pub motors: Option<u32>,
    /// Number of coordinate systems.
    pub coordinate_systems: Option<u32>,
    /// Servo period in picoseconds.
    pub servo_period_ps: Option<u64>,
    /// I10, servo interrupt time in 1/8,388,608 ms.
    pub i10: Option<u32>,
    /// Servo cycles from one servo report to the next: I19 of PMAC, I47 of Turbo PMAC. 0: no fixed number.
    pub servo_report_cycles: Option<u32>,
    /// I48: the servo report is on unless this is 0.
    pub servo_report: Option<u32>,
    /// I49: the background report is on unless this is 0.
    pub background_report: Option<u32>,
    /// The motors in the reports, bit n-1 for motor n; see [`first_motors`] and [`Identity::reported_motors`].
    pub motor_mask: Option<u32>,
    /// Firmware version, as `1.16D`.
    pub firmware: Option<Text<FIRMWARE_BYTES>>,
    /// The board's answer to `TYPE`.
    pub board_type: Option<Text<BOARD_TYPE_BYTES>>,
    /// Ix07, master scale factor, motor 1 first.
    pub ix07: [Option<i32>; MOTORS],
    /// Ix08, position scale factor: positions are in 1/(Ix08·32) counts.
    pub ix08: [Option<i32>; MOTORS],
    /// Ix09, velocity scale factor.
    pub ix09: [Option<i32>; MOTORS],
    /// Ix60: a motor's loop is closed every Ix60+1 servo cycles.
    pub ix60: [Option<i32>; MOTORS],
    /// Each motor's name in the configuration.
    pub names: [Option<Text<NAME_BYTES>>; MOTORS],
    /// Each motor's unit in the configuration.
    pub units: [Option<UserUnit>; MOTORS],
    /// The daemon replays a recording: there is no board, and nothing moves.
    pub replay: bool,
}

/// The mask of motors 1 to `count`, in the form of [`Identity::motor_mask`].
#[must_use]
pub const fn first_motors(count: u32) -> u32 {
    match 1_u32.checked_shl(count) {
        Some(next) => next - 1,
        None => u32::MAX,
    }
}

impl Identity {
    /// The number of the last reported motor; 0: none. A report has a block for each motor up to this one.
    #[must_use]
    pub fn reported_motors(&self) -> Option<u32> {
        self.motor_mask.map(|mask| u32::BITS - mask.leading_zeros())
    }

    /// Encodes the board region's payload.
    #[must_use]
    pub fn encode(&self) -> [u8; BYTES] {
        let mut bytes = [0; BYTES];
        let mut known: u32 = 1 << GLOBAL_WORDS_BIT | u32::from(self.replay) << REPLAY_BIT;
        let mut put = |at: usize, value: &[u8]| bytes[at..at + value.len()].copy_from_slice(value);
        for (bit, at, value) in [
            (0, AT_FAMILY, self.family),
            (1, AT_MOTORS, self.motors),
            (2, AT_COORDINATE_SYSTEMS, self.coordinate_systems),
            (4, AT_I10, self.i10),
            (5, AT_REPORT_CYCLES, self.servo_report_cycles),
            (6, AT_SERVO_REPORT, self.servo_report),
            (7, AT_BACKGROUND_REPORT, self.background_report),
            (8, AT_MOTOR_MASK, self.motor_mask),
        ] {
            if let Some(value) = value {
                known |= 1 << bit;
                put(at, &value.to_ne_bytes());
            }
        }
        if let Some(period) = self.servo_period_ps {
            known |= 1 << SERVO_PERIOD_BIT;
            put(AT_SERVO_PERIOD, &period.to_ne_bytes());
        }
        for (bit, at, text) in [
            (FIRMWARE_BIT, AT_FIRMWARE, self.firmware.as_deref()),
            (BOARD_TYPE_BIT, AT_BOARD_TYPE, self.board_type.as_deref()),
        ] {
            if let Some(text) = text {
                known |= 1 << bit;
                put(at, text.as_bytes());
            }
        }
        for (motor, name) in self.names.iter().enumerate() {
            put(AT_NAMES + motor * NAME_BYTES, name.as_ref().map_or(&[], Text::as_bytes));
        }
        for (motor, unit) in self.units.iter().enumerate() {
            let Some(UserUnit { name, counts_per_unit }) = unit else { continue };
            put(AT_COUNTS_PER_UNIT + motor * 8, &counts_per_unit.to_ne_bytes());
            put(AT_UNITS + motor * NAME_BYTES, name.as_bytes());
        }
        for (table, scales) in [&self.ix07, &self.ix08, &self.ix09, &self.ix60].into_iter().enumerate() {
            let mut table_known: u32 = 0;
            for (motor, scale) in scales.iter().enumerate() {
                if let Some(scale) = scale {
                    table_known |= 1 << motor;
                    put(AT_SCALES + (table * MOTORS + motor) * 4, &scale.to_ne_bytes());
                }
            }
            put(AT_SCALES_KNOWN + table * 4, &table_known.to_ne_bytes());
        }
        put(AT_KNOWN, &known.to_ne_bytes());
        bytes
    }

    /// Decodes the board region's payload; `None` if it is too short. Ignores additions of a later version.
    #[must_use]
    pub fn decode(bytes: &[u8]) -> Option<Self> {
        let bytes = bytes.first_chunk::<BYTES>()?;
        let u32_at = |at: usize| {
            let mut value = [0; 4];
            value.copy_from_slice(&bytes[at..at + 4]);
            u32::from_ne_bytes(value)
        };
        let known = u32_at(AT_KNOWN);
        let is_known = |bit: u32| known >> bit & 1 != 0;
        let number = |bit: u32, at: usize| is_known(bit).then(|| u32_at(at));
        fn text<const N: usize>(bytes: &[u8]) -> Text<N> {
            let end = bytes.iter().take(N).position(|byte| *byte == 0).unwrap_or(N);
            Text::from_bytes(&bytes[..end])
        }
        let scales = |table: usize| {
            let table_known = u32_at(AT_SCALES_KNOWN + table * 4);
            std::array::from_fn(|motor| {
                (table_known >> motor & 1 != 0)
                    .then(|| u32_at(AT_SCALES + (table * MOTORS + motor) * 4).cast_signed())
            })
        };
        let u64_at = |at: usize| {
            let mut value = [0; 8];
            value.copy_from_slice(&bytes[at..at + 8]);
            u64::from_ne_bytes(value)
        };
        let name = |motor: usize| text(&bytes[AT_NAMES + motor * NAME_BYTES..]);
        let unit = |motor: usize| UserUnit {
            name: text(&bytes[AT_UNITS + motor * NAME_BYTES..]),
            counts_per_unit: f64::from_bits(u64_at(AT_COUNTS_PER_UNIT + motor * 8)),
        };
        let has_scale = |unit: &UserUnit| unit.counts_per_unit.is_finite() && unit.counts_per_unit != 0.0;
        Some(Self {
            family: number(0, AT_FAMILY),
            motors: number(1, AT_MOTORS),
            coordinate_systems: number(2, AT_COORDINATE_SYSTEMS),
            servo_period_ps: is_known(SERVO_PERIOD_BIT).then(|| u64_at(AT_SERVO_PERIOD)),
            i10: number(4, AT_I10),
            servo_report_cycles: number(5, AT_REPORT_CYCLES),
            servo_report: number(6, AT_SERVO_REPORT),
            background_report: number(7, AT_BACKGROUND_REPORT),
            motor_mask: number(8, AT_MOTOR_MASK),
            firmware: is_known(FIRMWARE_BIT).then(|| text(&bytes[AT_FIRMWARE..])),
            board_type: is_known(BOARD_TYPE_BIT).then(|| text(&bytes[AT_BOARD_TYPE..])),
            ix07: scales(0),
            ix08: scales(1),
            ix09: scales(2),
            ix60: scales(3),
            names: std::array::from_fn(|motor| Some(name(motor)).filter(|name| !name.is_empty())),
            units: std::array::from_fn(|motor| Some(unit(motor)).filter(has_scale)),
            replay: is_known(REPLAY_BIT),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn full() -> Identity {
        Identity {
            family: Some(2),
            motors: Some(8),
            coordinate_systems: Some(8),
            servo_period_ps: Some(442_673_000),
            i10: Some(3_713_707),
            servo_report_cycles: Some(0),
            servo_report: Some(1),
            background_report: Some(1),
            motor_mask: Some(0x8000_00FF),
            firmware: Some("1.16D".into()),
            board_type: Some("PMAC1, ISA, CLK X2".into()),
            ix07: std::array::from_fn(|motor| Some(-96 - motor as i32)),
            ix08: std::array::from_fn(|motor| (motor < 8).then_some(96 + motor as i32)),
            ix09: std::array::from_fn(|motor| (motor % 2 == 0).then_some(motor as i32)),
            ix60: std::array::from_fn(|motor| (motor == 31).then_some(3)),
            names: std::array::from_fn(|motor| (motor == 1).then(|| "azimuth".into())),
            units: std::array::from_fn(|motor| {
                (motor == 31).then(|| UserUnit { name: "sixteen-bytes-16".into(), counts_per_unit: -2.5 })
            }),
            replay: true,
        }
    }

    #[test]
    fn what_is_encoded_decodes_to_the_same() {
        for identity in
            [full(), Identity::default(), Identity { servo_report: Some(0), ..Identity::default() }]
        {
            assert_eq!(Identity::decode(&identity.encode()), Some(identity));
        }
    }

    #[test]
    fn every_field_lies_where_the_page_says() {
        let bytes = full().encode();
        let u32_at = |at: usize| u32::from_ne_bytes(bytes[at..at + 4].try_into().unwrap());
        assert_eq!((u32_at(0), u32_at(0x3C)), (0x1FFF, 0));
        assert_eq!((u32_at(4), u32_at(8), u32_at(0xC)), (2, 8, 8));
        assert_eq!(u64::from_ne_bytes(bytes[0x10..0x18].try_into().unwrap()), 442_673_000);
        assert_eq!([0x18, 0x1C, 0x20, 0x24, 0x28].map(u32_at), [3_713_707, 0, 1, 1, 0x8000_00FF]);
        assert_eq!([0x2C, 0x30, 0x34, 0x38].map(u32_at), [0xFFFF_FFFF, 0xFF, 0x5555_5555, 0x8000_0000]);
        assert_eq!(&bytes[0x40..0x46], b"1.16D\0");
        assert_eq!(&bytes[0x50..0x54], b"PMAC");
        assert_eq!(u32_at(0x90), -96i32 as u32);
        assert_eq!((u32_at(0x114), u32_at(0x198), u32_at(0x28C)), (97, 2, 3));
        assert_eq!(f64::from_ne_bytes(bytes[0x388..0x390].try_into().unwrap()), -2.5);
        assert_eq!((&bytes[0x3A0..0x3A8], &bytes[0x780..]), (&b"azimuth\0"[..], &b"sixteen-bytes-16"[..]));
    }

    #[test]
    fn a_unit_shows_a_tenth_of_a_count() {
        let unit = |counts_per_unit| UserUnit { name: "deg".into(), counts_per_unit };
        assert_eq!((unit(-1000.0).of_counts(250.0), unit(-1000.0).places()), (-0.25, 4));
        assert_eq!([1.0, 12_345.6, 0.05, 1e300, 1e-300].map(|scale| unit(scale).places()), [1, 6, 0, 12, 0]);
    }

    #[test]
    fn the_reported_motors_are_a_mask() {
        assert_eq!([0, 1, 8, 31, 32, 400].map(first_motors), [0, 1, 0xFF, 0x7FFF_FFFF, u32::MAX, u32::MAX]);
        let reported = |mask| Identity { motor_mask: Some(mask), ..Identity::default() }.reported_motors();
        assert_eq!([0, 1, 0xFF, 0b1010, u32::MAX].map(reported), [0, 1, 8, 4, 32].map(Some));
        assert_eq!(Identity::default().reported_motors(), None);
    }

    #[test]
    fn a_long_text_is_cut_at_a_character_and_a_short_payload_is_refused() {
        let firmware = format!("{}é", "x".repeat(15));
        let identity = Identity { firmware: Some(firmware.as_str().into()), ..Identity::default() };
        assert_eq!(
            Identity::decode(&identity.encode()).unwrap().firmware.as_deref(),
            Some("xxxxxxxxxxxxxxx")
        );
        assert_eq!(Identity::decode(&identity.encode()[1..]), None);
        let filled = Identity { firmware: Some("1234567890123456".into()), ..Identity::default() };
        assert_eq!(Identity::decode(&filled.encode()), Some(filled));
    }
}
