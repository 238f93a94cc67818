//! The sources of a gather, by name or by address.
//!
//! The names are those of the register table: a gather can take a register that the servo or background report copies
//! by the report's name. `3.actual_position` is motor 3's, `cs2.program_status` coordinate system 2's, `servo_timer`
//! the board's servo counter. Besides, Turbo boards have a register for the commanded position, and on other boards the
//! following error is computed from others. Any other register goes by its address: `Y:$C003`, `X:$0033`, `D:$002B`, `L:$1005`; a
//! 24-bit word is signed unless `,u` follows.

use super::reading::Reading;
use crate::map::table::{self, Format, NumberKind, POSITION};
use crate::map::{BadRegister, Entry, Family, Layout, PmacRegister, SourceAt};

/// One source of a gather.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Source {
    /// The source as typed; the column's name.
    pub name: String,
    /// The register, with its code for I21 to I44. A following error that the board does not compute takes several.
    pub registers: Vec<PmacRegister>,
    /// How to read their longs.
    pub reading: Reading,
    /// The unit of the integer or number in the register; empty if none is known.
    pub units: &'static str,
    /// The motor whose I-variables scale the source.
    pub motor: Option<usize>,
}

/// Text that names no source of a gather.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SourceError {
    /// An address that the board cannot gather.
    #[error(transparent)]
    Address(#[from] BadRegister),
    /// The prefix is no motor or coordinate system of the board.
    #[error(
        "{text:?}: there is no such motor or coordinate system; write 1.NAME to {motors}.NAME or cs1.NAME to cs{systems}.NAME"
    )]
    Number {
        /// The text.
        text: String,
        /// The last motor.
        motors: usize,
        /// The last coordinate system.
        systems: usize,
    },
    /// No register has this name.
    #[error("{text:?} is not known; {known}, or an address such as X:$0033")]
    Name {
        /// The text.
        text: String,
        /// The possible names with this prefix, as a sentence.
        known: String,
    },
}

/// The owner of the register behind a name.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Owner {
    Board,
    Motor,
    System,
}

impl Owner {
    const fn prefix(self) -> &'static str {
        match self {
            Self::Board => "",
            Self::Motor => "motor_",
            Self::System => "cs_",
        }
    }

    fn owns(self, entry: &Entry) -> bool {
        match self {
            Self::Board => entry.register.number.is_none(),
            Self::Motor => entry.register.number == Some(NumberKind::Motor),
            Self::System => entry.register.number == Some(NumberKind::CoordinateSystem),
        }
    }

    /// The possible names, as users write them.
    fn known(self, layout: &Layout) -> String {
        let whose = match self {
            Self::Board => {
                let all = [Self::Board.names(layout), Self::Motor.names(layout), Self::System.names(layout)];
                return format!(
                    "of the board there are {}; of motor 1 {}; of coordinate system 1 {}",
                    all[0], all[1], all[2]
                );
            }
            Self::Motor => "of a motor there are",
            Self::System => "of a coordinate system there are",
        };
        format!("{whose} {}", self.names(layout))
    }

    fn names(self, layout: &Layout) -> String {
        let before = match self {
            Self::Board => "",
            Self::Motor => "1.",
            Self::System => "cs1.",
        };
        let mut names: Vec<&str> = Vec::new();
        for named in gatherable(layout, self, (self != Self::Board).then_some(1)) {
            // Reports of both kinds may copy the same register.
            if !names.contains(&named.name) {
                names.push(named.name);
            }
        }
        if self == Self::Motor && !names.contains(&FOLLOWING_ERROR) {
            names.push(FOLLOWING_ERROR);
        }
        names.iter().map(|name| format!("{before}{name}")).collect::<Vec<_>>().join(", ")
    }
}

impl Source {
    /// The possible names on a board with `layout`: of the board, of motor 1 (`1.`), of coordinate system 1 (`cs1.`).
    #[must_use]
    pub fn names(layout: &Layout) -> String {
        [Owner::Board, Owner::Motor, Owner::System].map(|owner| owner.names(layout)).join(", ")
    }

    /// The source that `text` names on a board with `layout`.
    ///
    /// # Errors
    /// [`SourceError`], which lists the possible names.
    pub fn parse(text: &str, layout: &Layout) -> Result<Self, SourceError> {
        let text = text.trim();
        if text.contains([':', '$']) {
            return Self::address(text, layout.family());
        }
        let lower = text.to_ascii_lowercase();
        let (owner, number, name) = owner(&lower, layout)?;
        let find = |name: &str| gatherable(layout, owner, number).find(|named| named.name == name);
        let motor = if owner == Owner::Motor { number } else { None };
        if let Some(Named { register, reading, units, .. }) = find(name) {
            return Ok(Self { name: lower, registers: vec![register], reading, units, motor });
        }
        let parts: Option<Vec<_>> = FOLLOWING_ERROR_PARTS.iter().map(|name| find(name)).collect();
        match parts {
            Some(parts) if name == FOLLOWING_ERROR => Ok(Self {
                name: lower,
                registers: parts.iter().map(|part| part.register).collect(),
                reading: Reading::FollowingError,
                units: parts[0].units,
                motor,
            }),
            _ => Err(SourceError::Name { text: text.to_owned(), known: owner.known(layout) }),
        }
    }

    fn address(text: &str, family: &Family) -> Result<Self, SourceError> {
        let bad = || BadRegister { text: text.to_owned(), last: family.last_address(), in_dpram: false };
        let (address, unsigned) = match text.split_once(',') {
            Some((address, sign)) if sign.trim().eq_ignore_ascii_case("u") => (address, true),
            Some((address, sign)) if sign.trim().eq_ignore_ascii_case("s") => (address, false),
            Some(_) => return Err(bad().into()),
            None => (text, false),
        };
        let register = PmacRegister::parse(address, family)?;
        let reading = match (register.longs(), register.address().space) {
            (1, _) if unsigned => Reading::Unsigned,
            (1, _) => Reading::Signed,
            (_, _) if unsigned => return Err(bad().into()),
            (_, crate::map::Space::L) => Reading::Float,
            _ => Reading::Fixed,
        };
        let sign = if unsigned { ",u" } else { "" };
        let name = format!("{register}{sign}");
        Ok(Self { name, registers: vec![register], reading, units: "", motor: None })
    }

    /// The longs of a sample that it takes.
    #[must_use]
    pub const fn longs(&self) -> u32 {
        self.reading.longs() as u32
    }
}

/// Turbo boards have a register for it.
const FOLLOWING_ERROR: &str = "following_error";
/// The registers from which [`Reading::FollowingError`] computes it, in this order.
const FOLLOWING_ERROR_PARTS: [&str; 4] =
    ["commanded_position", "actual_position", "compensation_position", "servo_status"];

/// Splits a name into its owner, the owner's number, and the rest.
fn owner<'a>(text: &'a str, layout: &Layout) -> Result<(Owner, Option<usize>, &'a str), SourceError> {
    let Some((prefix, name)) = text.split_once('.') else { return Ok((Owner::Board, None, text)) };
    let family = layout.family();
    let (owner, digits, last) = match prefix.strip_prefix("cs") {
        Some(digits) => (Owner::System, digits, family.coordinate_systems),
        None => (Owner::Motor, prefix, family.motors),
    };
    match digits.parse() {
        Ok(number) if (1..=last).contains(&number) => Ok((owner, Some(number), name)),
        _ => {
            let (motors, systems) = (family.motors, family.coordinate_systems);
            Err(SourceError::Number { text: text.to_owned(), motors, systems })
        }
    }
}

/// A register with a name.
struct Named {
    name: &'static str,
    register: PmacRegister,
    reading: Reading,
    units: &'static str,
}

/// The registers of `owner`'s `number` that a gather can take by name: those that a report copies, if the copy is of one
/// known register, and the positions that no report copies.
fn gatherable(layout: &Layout, owner: Owner, number: Option<usize>) -> impl Iterator<Item = Named> + use<> {
    let layout = *layout;
    let family = layout.family();
    let copied = layout.entries().filter_map(move |entry| {
        let SourceAt::One(address) = entry.source(family) else { return None };
        if entry.number != number || !owner.owns(&entry) {
            return None;
        }
        let reading = match entry.register.format {
            Format::Fixed48 => Reading::Fixed,
            Format::Float48 => Reading::Float,
            Format::Signed24 => Reading::Signed,
            Format::Bits24 | Format::Unsigned16 | Format::Unsigned24 => Reading::Unsigned,
            _ => return None,
        };
        let name = entry.register.name.trim_start_matches(owner.prefix());
        Some(Named { name, register: PmacRegister::new(address)?, reading, units: entry.register.units })
    });
    let motor = number.filter(|_| owner == Owner::Motor);
    let more = motor.into_iter().flat_map(move |number| {
        family.more_positions.iter().filter_map(move |(name, first)| {
            let SourceAt::One(address) = family.source(table::Source::Motor(*first), number) else {
                return None;
            };
            let (reading, units) = (Reading::Fixed, POSITION);
            Some(Named { name, register: PmacRegister::new(address)?, reading, units })
        })
    });
    copied.chain(more)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::{PMAC, TURBO2};

    fn parse(text: &str) -> Result<Source, SourceError> {
        Source::parse(text, &Layout::new(&PMAC, None))
    }

    #[test]
    fn names_and_strides() {
        for (text, register, code) in [
            ("1.commanded_position", "D:$0028", 0x80_0028),
            ("1.actual_position", "D:$002B", 0x80_002B),
            ("2.Actual_Position", "D:$0067", 0x80_0067),
            ("1.master_position", "D:$002D", 0x80_002D),
            ("8.compensation_position", "D:$01EA", 0x80_01EA),
            ("1.previous_dac", "X:$003A", 0x40_003A),
            ("1.actual_velocity", "X:$0033", 0x40_0033),
            ("1.servo_status", "X:$003D", 0x40_003D),
            ("2.background_status", "Y:$08D4", 0x00_08D4),
            ("cs2.program_status", "Y:$08D7", 0x00_08D7),
            ("servo_timer", "X:$0000", 0x40_0000),
        ] {
            let source = parse(text).unwrap();
            let [named] = source.registers[..] else { panic!("{text}") };
            assert_eq!((named.to_string().as_str(), named.gather_code()), (register, code), "{text}");
            assert_eq!(source.name, text.to_ascii_lowercase());
        }
    }

    #[test]
    fn a_turbo_board_has_registers_for_following_error_and_commanded_position() {
        let layout = Layout::new(&TURBO2, None);
        // D:$000091 and D:$000088 + $80*(n-1), as drivers in production read them (epics-modules/tpmac, ls-cat-org/pgpmac).
        for (text, code) in [
            ("1.following_error", 0x80_0091),
            ("32.following_error", 0x80_1011),
            ("1.commanded_position", 0x80_0088),
            ("32.commanded_position", 0x80_1008),
        ] {
            let source = Source::parse(text, &layout).unwrap();
            assert_eq!((source.registers[0].gather_code(), source.reading), (code, Reading::Fixed), "{text}");
            assert_eq!((source.registers.len(), source.units), (1, "1/(Ix08*32) count"), "{text}");
        }
        let names = Source::names(&layout);
        assert!(
            names.contains("1.commanded_position") && !names.contains("cs1.commanded_position"),
            "{names}"
        );
        assert_eq!(names.matches("1.following_error").count(), 1, "{names}");
    }

    #[test]
    fn another_board_computes_the_following_error_from_four_registers() {
        let source = parse("2.following_error").unwrap();
        let registers: Vec<String> = source.registers.iter().map(ToString::to_string).collect();
        assert_eq!(registers, ["D:$0064", "D:$0067", "D:$0082", "X:$0079"]);
        assert_eq!((source.reading, source.longs(), source.motor), (Reading::FollowingError, 7, Some(2)));
        assert!(Source::names(&Layout::new(&PMAC, None)).contains("1.following_error"));
    }

    #[test]
    fn addresses_are_taken_as_they_are() {
        let source = parse("x:$33").unwrap();
        assert_eq!((source.name.as_str(), source.reading), ("X:$0033", Reading::Signed));
        assert_eq!(parse("Y:$C003,u").unwrap().reading, Reading::Unsigned);
        assert_eq!(parse("D:$002B").unwrap().reading, Reading::Fixed);
        assert_eq!(parse("L:$1005").unwrap().reading, Reading::Float);
    }

    #[test]
    fn what_cannot_be_gathered_is_refused_with_what_can() {
        let said = |text: &str| parse(text).unwrap_err().to_string();
        assert!(said("cs1.following_error").contains("is not known"));
        assert!(said("9.actual_position").contains("1.NAME to 8.NAME"));
        assert!(said("0.actual_position").contains("1.NAME to 8.NAME"));
        assert!(said("csx.program_status").contains("cs1.NAME"));
        assert!(said("1.position").contains("actual_position"));
        assert!(said("1.program_status").contains("actual_position"));
        let timer = said("timer");
        for name in ["servo_timer", "1.actual_position", "cs1.program_status"] {
            assert_eq!(timer.matches(name).count(), 1, "{timer}");
        }
        // A copy of one of three registers, by the program's state: a gather cannot take it.
        assert!(!said("cs1.x_target_position").contains("x_target_position,"));
        for text in ["", "DP:$D200", "D:$002B,u", "X:$10000", "X:$33,7", "$33"] {
            assert!(parse(text).is_err(), "{text}");
        }
    }
}
