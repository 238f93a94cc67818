//! Status words: the meaning of each bit, as data, and the names of the set bits.
//!
//! PMAC answers `?`, `??` and `???` with six hexadecimal digits a word, the first digit being bits 23-20 (Software
//! Reference p. 189-198); the fixed buffers of the DPRAM hold the same words. PMAC alone writes them.

mod meaning;
mod pmac;
mod turbo;

pub use pmac::PMAC;
pub use turbo::TURBO;

/// The meaning of the 24 bits of a status word. Every bit is a flag, part of a field, or reserved.
#[derive(Debug, PartialEq, Eq)]
pub struct StatusTable {
    /// The word's name, snake case.
    pub name: &'static str,
    /// Single bits, highest first.
    pub flags: &'static [(u8, &'static str)],
    /// Numbers of several bits.
    pub fields: &'static [Field],
    /// Bits that are internal or without a documented meaning.
    pub reserved: u32,
}

/// A number of several bits in a status word.
#[derive(Debug, PartialEq, Eq)]
pub struct Field {
    /// The highest bit.
    pub high: u8,
    /// The lowest bit.
    pub low: u8,
    /// Its name, snake case.
    pub name: &'static str,
}

impl Field {
    /// The field's bits in place.
    #[must_use]
    pub const fn mask(&self) -> u32 {
        ((1 << (self.high - self.low + 1)) - 1) << self.low
    }

    /// The field's value in `word`.
    #[must_use]
    pub const fn of(&self, word: u32) -> u32 {
        (word & self.mask()) >> self.low
    }
}

/// The status words of a board family, in the order of the replies.
#[derive(Debug, PartialEq, Eq)]
pub struct StatusTables {
    /// The words of `?`, a motor's.
    pub motor: &'static [StatusTable],
    /// The words of `??`, a coordinate system's.
    pub coordinate_system: &'static [StatusTable],
    /// The words of `???`, the board's.
    pub global: &'static [StatusTable],
}

/// The names of the flags set in `word`, highest bit first. Bits above 23, copies of bit 23, do not count.
pub fn flags(word: u32, table: &'static StatusTable) -> impl Iterator<Item = &'static str> {
    table.flags.iter().filter(move |(bit, _)| word >> bit & 1 == 1).map(|(_, name)| *name)
}

/// Whether the flag `name` is set in `word`; `false` also without this flag in the table.
#[must_use]
pub fn is_set(word: u32, table: &'static StatusTable, name: &str) -> bool {
    flags(word, table).any(|flag| flag == name)
}

/// The value of the field `name`, or `None` without this field in the table.
#[must_use]
pub fn field(word: u32, table: &'static StatusTable, name: &str) -> Option<u32> {
    table.fields.iter().find(|field| field.name == name).map(|field| field.of(word))
}

/// The coordinate system, from 1, to which a motor is assigned, from the second word of `?`; `None` when it is
/// assigned to none.
#[must_use]
pub fn coordinate_system(word: u32, tables: &'static StatusTables) -> Option<u32> {
    let table = tables.motor.get(1)?;
    if is_set(word, table, "assigned_to_coordinate_system") {
        field(word, table, "coordinate_system_less_one").map(|number| number + 1)
    } else {
        None
    }
}

/// How a coordinate system moves, from bits 4, 1 and 0 of its program status. Same on PMAC and on Turbo PMAC.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MotionMode {
    /// `LINEAR`
    Linear,
    /// `RAPID`
    Rapid,
    /// `SPLINE`
    Spline,
    /// `CIRCLE1`, clockwise
    Circle1,
    /// `CIRCLE2`, counterclockwise
    Circle2,
    /// `PVT`
    Pvt,
}

impl MotionMode {
    /// The mode, or `None` for the two combinations no text explains.
    #[must_use]
    pub const fn of(program_status: u32) -> Option<Self> {
        match (program_status >> 4 & 1, program_status & 3) {
            (0, 0b00) => Some(Self::Linear),
            (0, 0b10) => Some(Self::Rapid),
            (0, 0b01) => Some(Self::Circle1),
            (0, 0b11) => Some(Self::Circle2),
            (1, 0b01) => Some(Self::Spline),
            (1, 0b10) => Some(Self::Pvt),
            _ => None,
        }
    }

    /// The bits 4, 1 and 0 that say this mode.
    #[must_use]
    pub const fn bits(self) -> u32 {
        match self {
            Self::Linear => 0b0_0000,
            Self::Rapid => 0b0_0010,
            Self::Circle1 => 0b0_0001,
            Self::Circle2 => 0b0_0011,
            Self::Spline => 0b1_0001,
            Self::Pvt => 0b1_0010,
        }
    }
}

/// Which of three registers an axis target in the background buffer is a copy of (Note 1 on p. 21 of the DPRAM
/// manual). Classic boards only; [`super::Source::Choice`] has the addresses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub enum TargetSource {
    /// L:$0876 and following: a segmented move that is not stopping.
    A,
    /// L:$0896 and following: a move held back by cutter compensation.
    B,
    /// L:$0819 and following: any other.
    C,
}

impl TargetSource {
    /// The choice PMAC makes by its program status word: A if bit 7 is set and bit 5 clear, else B if bit 9 is set,
    /// else C.
    #[must_use]
    pub const fn of(program_status: u32) -> Self {
        if program_status & (1 << 7) != 0 && program_status & (1 << 5) == 0 {
            Self::A
        } else if program_status & (1 << 9) != 0 {
            Self::B
        } else {
            Self::C
        }
    }
}

/// Whether `flag` is set in a reply to `?`, `??` or `???` with the words of `tables`. Text that is no such reply has no
/// flags.
#[must_use]
pub fn reply_has(reply: &str, tables: &'static [StatusTable], flag: &str) -> bool {
    let digits = reply.trim().as_bytes().chunks_exact(6);
    let words = digits.filter_map(|digits| u32::from_str_radix(std::str::from_utf8(digits).ok()?, 16).ok());
    tables.iter().zip(words).any(|(table, word)| flags(word, table).any(|name| name == flag))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(word: u32, table: &'static StatusTable) -> Vec<&'static str> {
        flags(word, table).collect()
    }

    #[test]
    fn every_bit_of_every_word_has_exactly_one_meaning() {
        for tables in [&PMAC, &TURBO] {
            for table in [tables.motor, tables.coordinate_system, tables.global].into_iter().flatten() {
                let mut seen = 0u32;
                let singles = table.flags.iter().map(|(bit, _)| 1 << bit);
                let fields = table.fields.iter().map(Field::mask);
                for mask in singles.chain(fields).chain([table.reserved]) {
                    assert_eq!(seen & mask, 0, "{}: bits {mask:06X} twice", table.name);
                    seen |= mask;
                }
                assert_eq!(seen, 0xFF_FFFF, "{}", table.name);
                assert!(table.flags.is_sorted_by(|a, b| a.0 > b.0), "{}", table.name);
                let mut names: Vec<_> = table.flags.iter().map(|(_, name)| *name).collect();
                names.sort_unstable();
                names.dedup();
                assert_eq!(names.len(), table.flags.len(), "{}: a name twice", table.name);
                let plain = |name: &str| {
                    name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
                };
                assert!(names.iter().all(|name| plain(name)), "{}", table.name);
            }
        }
        assert_eq!([PMAC.motor.len(), PMAC.coordinate_system.len(), PMAC.global.len()], [2, 2, 2]);
        assert_eq!([TURBO.motor.len(), TURBO.coordinate_system.len(), TURBO.global.len()], [2, 3, 2]);
    }

    #[test]
    fn the_software_references_motor_example_decodes() {
        let [first, second] = [0x81_2000, 0x80_4401];
        assert_eq!(
            named(first, &PMAC.motor[0]),
            ["motor_activated", "integration_mode", "desired_velocity_zero"]
        );
        assert_eq!(
            named(second, &PMAC.motor[1]),
            ["assigned_to_coordinate_system", "amplifier_enabled", "home_complete", "in_position"]
        );
        assert_eq!(coordinate_system(second, &PMAC), Some(1));
    }

    #[test]
    fn a_reply_is_asked_for_one_flag() {
        let running = |reply| reply_has(reply, PMAC.coordinate_system, "running_program");
        assert!(running("A8002B020010") && !running("A8002A020010"));
        assert!(!running("") && !running("A8002") && !running("no, not this"));
        assert!(reply_has("080000000000", PMAC.global, "data_gathering_on"));
    }

    #[test]
    fn the_software_references_coordinate_system_example_decodes() {
        let [first, second] = [0xA8_002A, 0x02_0010];
        assert_eq!(
            named(first, &PMAC.coordinate_system[0]),
            [
                "z_feedrate",
                "y_feedrate",
                "x_feedrate",
                "radius_vector_incremental",
                "move_by_time",
                "single_step_mode"
            ]
        );
        assert_eq!(named(second, &PMAC.coordinate_system[1]), ["in_position", "pvt_or_spline_mode"]);
        // No list of modes has the example's combination.
        assert_eq!(MotionMode::of(second), None);
    }

    #[test]
    fn a_turbo_reply_decodes() {
        // A Brick Controller at factory defaults answers this to `?`.
        let [first, second] = [0x85_0000, 0];
        assert_eq!(named(first, &TURBO.motor[0]), ["motor_activated", "open_loop", "integration_mode"]);
        assert_eq!(coordinate_system(second, &TURBO), None);
        assert_eq!(coordinate_system(0xF0_8000, &TURBO), Some(16));
        assert_eq!(field(0xF7_8000, &TURBO.motor[1], "axis"), Some(7));
    }

    #[test]
    fn motion_modes_read_back_from_their_bits() {
        use MotionMode::{Circle1, Circle2, Linear, Pvt, Rapid, Spline};
        for mode in [Linear, Rapid, Spline, Circle1, Circle2, Pvt] {
            assert_eq!(MotionMode::of(mode.bits()), Some(mode));
            // Bits around the three do not matter.
            assert_eq!(MotionMode::of(mode.bits() | 0xFF_FFEC), Some(mode));
        }
        assert_eq!(MotionMode::of(0b1_0011), None);
        assert_eq!(serde_json::to_string(&Circle1).unwrap(), "\"circle1\"");
    }

    #[test]
    fn the_target_source_follows_the_program_status() {
        use TargetSource::{A, B, C};
        let cases = [(0, C), (1 << 7, A), (1 << 7 | 1 << 5, C), (1 << 5, C), (1 << 9, B)];
        let more = [(1 << 9 | 1 << 7, A), (1 << 9 | 1 << 7 | 1 << 5, B), (!(1 << 7 | 1 << 9), C)];
        for (word, source) in cases.into_iter().chain(more) {
            assert_eq!(TargetSource::of(word), source, "{word:06X}");
        }
    }

    #[test]
    fn coordinate_systems_count_from_one() {
        for number in 1..=8u32 {
            assert_eq!(coordinate_system(0x80_0000 | (number - 1) << 20, &PMAC), Some(number));
        }
        assert_eq!(coordinate_system(0x70_0000, &PMAC), None);
    }

    #[test]
    fn a_sign_extension_names_no_flag() {
        assert_eq!(named(0xFF80_0000, &PMAC.motor[0]), ["motor_activated"]);
    }
}
