//! Board families as data. Another family is another file here and an entry in [`FAMILIES`].

mod board_type;
pub mod pmac;
pub(super) mod pmac_table;
pub mod turbo;
pub(super) mod turbo_table;

use std::fmt;
use std::str::FromStr;

pub use self::board_type::{LACKS_DPRAM, OtherFamily, lacks_dpram};

use super::functions::{
    AsciiPort, BackgroundBlock, Controller, IVariables, PanelBlock, RotaryHeaders, ServoBlock, StartRule,
    VariableRead, VariableWrite,
};
use super::status::{self, StatusTables};
use super::{
    Block, Firmware, Function, GatherPlace, HostOffset, PmacAddress, Region, Source, SourceAt, Space,
};

/// Which kind of set-up registers and I-variables a board has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Generation {
    /// PMAC and PMAC2: registers X:$0783 to X:$078C, four-digit addresses, Ix10 alone.
    #[default]
    Pmac,
    /// Turbo PMAC and Turbo PMAC2: I90 to I99, six-digit addresses, Ixx10 with Ixx95.
    Turbo,
}

impl FromStr for Generation {
    type Err = UnknownFamily;

    /// The generation of the family called `name`.
    fn from_str(name: &str) -> Result<Self, UnknownFamily> {
        Family::by_name(name).map(|family| family.generation)
    }
}

/// A family of boards.
#[derive(Debug, PartialEq)]
pub struct Family {
    /// The name in settings, on the command line and on the socket.
    pub name: &'static str,
    /// The name as Delta Tau writes it.
    pub title: &'static str,
    /// Its number in the segment: 1 PMAC, 2 PMAC2, 3 Turbo PMAC, 4 Turbo PMAC2.
    pub number: u32,
    /// Its set-up registers and I-variables.
    pub generation: Generation,
    /// The PMAC address of the first DPRAM location.
    pub base: u32,
    /// The DPRAM's size in bytes.
    pub length: u32,
    /// PMAC addresses below this one are memory; above are memory, hardware and the DPRAM.
    pub memory_end: u32,
    /// How many motors the board has, at most 32.
    pub motors: usize,
    /// How many coordinate systems the board has, at most 32.
    pub coordinate_systems: usize,
    /// Hexadecimal digits with which DPRAM addresses are printed.
    pub address_digits: usize,
    /// Bits of a PMAC address.
    pub address_bits: u32,
    /// PMAC addresses from one motor's registers to the next motor's.
    pub motor_source_stride: u32,
    /// PMAC addresses from one coordinate system's registers to the next one's.
    pub system_source_stride: u32,
    /// Positions of motor 1 in 1/(Ix08*32) count that no report copies, each with its name in a gather.
    pub more_positions: &'static [(&'static str, PmacAddress)],
    /// The default of I10, the servo period in 1/8388608 ms.
    pub default_i10: u32,
    /// The functions that `pmacd` uses on boards of the family.
    pub functions: &'static [Function],
    /// The numbers of the I-variables that govern the functions.
    pub i: IVariables,
    /// The DPRAM's regions, ascending, without a gap.
    pub regions: &'static [Region],
    /// The part of the DPRAM for buffers of variable size and the site's use.
    pub user_area: Region,
    /// The register table, ascending.
    pub blocks: &'static [Block],
    /// The status words of `?`, `??` and `???`.
    pub status: &'static StatusTables,
    /// The servo report.
    pub servo: ServoBlock,
    /// The background report.
    pub background: BackgroundBlock,
    /// ASCII communication.
    pub ascii: AsciiPort,
    /// The control panel; `None` where the firmware has none.
    pub panel: Option<PanelBlock>,
    /// The interrupt controller behind the host port.
    pub host_port: Controller,
    /// How the host tells PMAC the place of a table or rotary buffer.
    pub start: StartRule,
    /// Background variable read.
    pub variable_read: VariableRead,
    /// Background variable write.
    pub variable_write: VariableWrite,
    /// The binary rotary buffers.
    pub rotary: RotaryHeaders,
    /// Data gathering as printed.
    pub gather: GatherPlace,
    /// The first firmware that moves the gather buffer and its index; `None` if no firmware does.
    pub gather_moved_since: Option<Firmware>,
    /// The number of bytes by which that firmware moves them.
    pub gather_shift: u32,
    /// The first firmware whose variable functions know the function blocks of compiled PLCs; `None` without a text
    /// about them.
    pub function_blocks_since: Option<Firmware>,
}

const fn pmac_family(
    name: &'static str,
    title: &'static str,
    number: u32,
    default_i10: u32,
    host_port: Controller,
) -> Family {
    Family {
        name,
        title,
        number,
        generation: Generation::Pmac,
        base: pmac::BASE,
        length: pmac::LENGTH,
        memory_end: pmac::MEMORY_END,
        motors: pmac::MOTORS,
        coordinate_systems: pmac::MOTORS,
        address_digits: 4,
        address_bits: 16,
        motor_source_stride: 0x3C,
        system_source_stride: 0xC0,
        more_positions: &[],
        default_i10,
        functions: &Function::ALL,
        i: pmac::I_VARIABLES,
        regions: pmac::REGIONS,
        user_area: pmac::USER_AREA,
        blocks: pmac_table::BLOCKS,
        status: &status::PMAC,
        servo: pmac::SERVO_BLOCK,
        background: pmac::BACKGROUND_REPORT,
        ascii: pmac::ASCII,
        panel: Some(pmac::PANEL_BLOCK),
        host_port,
        start: pmac::START,
        variable_read: pmac::VARIABLE_READ,
        variable_write: pmac::VARIABLE_WRITE,
        rotary: pmac::ROTARY,
        gather: pmac::GATHER,
        gather_moved_since: Some(pmac::GATHER_MOVED_SINCE),
        gather_shift: pmac::GATHER_SHIFT,
        function_blocks_since: Some(pmac::FUNCTION_BLOCKS_SINCE),
    }
}

const fn turbo_family(
    name: &'static str,
    title: &'static str,
    number: u32,
    default_i10: u32,
    host_port: Controller,
    length: u32,
) -> Family {
    let (regions, user_area, rotary) = match length {
        turbo::LENGTH_8K => (turbo::REGIONS_8K, turbo::USER_AREA_8K, turbo::ROTARY_BUFFERS_8K),
        _ => (turbo::REGIONS_32K, turbo::USER_AREA_32K, turbo::ROTARY_BUFFERS_32K),
    };
    Family {
        name,
        title,
        number,
        generation: Generation::Turbo,
        base: turbo::BASE,
        length,
        memory_end: turbo::MEMORY_END,
        motors: turbo::MOTORS,
        coordinate_systems: turbo::SYSTEMS,
        address_digits: 6,
        address_bits: 19,
        motor_source_stride: turbo::MOTOR_SOURCE_STRIDE,
        system_source_stride: turbo::SYSTEM_SOURCE_STRIDE,
        more_positions: &[("commanded_position", turbo::COMMANDED_POSITION)],
        default_i10,
        functions: turbo::FUNCTIONS,
        i: turbo::I_VARIABLES,
        regions,
        user_area,
        blocks: turbo_table::BLOCKS,
        status: &status::TURBO,
        servo: turbo::SERVO_BLOCK,
        background: turbo::BACKGROUND_REPORT,
        ascii: turbo::ASCII,
        // The words have a place, but no text names a firmware that acts on them, or a variable that switches them on.
        panel: None,
        host_port,
        start: turbo::START,
        variable_read: turbo::VARIABLE_READ,
        variable_write: turbo::VARIABLE_WRITE,
        rotary,
        gather: turbo::GATHER,
        gather_moved_since: None,
        gather_shift: 0,
        function_blocks_since: None,
    }
}

const fn turbo_of(length: u32) -> Family {
    // No known text describes the interrupt controllers; these belong to the same boards with the older processor.
    turbo_family("turbo", "Turbo PMAC", 3, 3_713_707, Controller::Pic8259, length)
}

const fn turbo2_of(length: u32) -> Family {
    turbo_family("turbo2", "Turbo PMAC2", 4, 3_713_991, Controller::Pmac2, length)
}

/// PMAC, the first generation (PMAC(1)), with option 2 or 2V.
pub static PMAC: Family = pmac_family("pmac", "PMAC", 1, 3_713_707, Controller::Pic8259);
/// PMAC2; its DPRAM is laid out as PMAC's.
pub static PMAC2: Family = pmac_family("pmac2", "PMAC2", 2, 3_713_991, Controller::Pmac2);
/// Turbo PMAC, which comes with 8K x 16 bits (Turbo User Manual p. 397).
pub static TURBO: Family = turbo_of(turbo::LENGTH_8K);
/// Turbo PMAC2, UMAC Turbo and QMAC, which come with 32K x 16 bits (Turbo User Manual p. 397).
pub static TURBO2: Family = turbo2_of(turbo::LENGTH_32K);
/// The families that this version knows, each with its usual DPRAM.
pub static FAMILIES: &[&Family] = &[&PMAC, &PMAC2, &TURBO, &TURBO2];
/// Families with a DPRAM of another size: I24 can name one on an accessory board (Turbo User Manual p. 45).
static OTHER_LENGTHS: &[&Family] = &[&TURBO_32K, &TURBO2_8K];
/// Turbo PMAC with 32K x 16 bits.
pub static TURBO_32K: Family = turbo_of(turbo::LENGTH_32K);
/// Turbo PMAC2 with 8K x 16 bits.
pub static TURBO2_8K: Family = turbo2_of(turbo::LENGTH_8K);

/// The names of the sizes of a DPRAM, in thousands of 16-bit words, and the bytes.
pub const DPRAM_SIZES: [(&str, u32); 2] = [("8k", turbo::LENGTH_8K), ("32k", turbo::LENGTH_32K)];

/// The options of a Turbo board that choose its processor (C to F: 80 to 240 MHz) and its memory (0 standard, 3 extended).
pub const CPU_OPTIONS: [&str; 8] = ["5C0", "5C3", "5D0", "5D3", "5E0", "5E3", "5F0", "5F3"];

/// The family of a board without a configured one.
pub static DEFAULT_FAMILY: &Family = &PMAC;

/// An unknown family name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UnknownFamily {
    /// The requested name.
    pub name: String,
}

impl fmt::Display for UnknownFamily {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let known = FAMILIES.iter().map(|family| family.name).collect::<Vec<_>>().join(", ");
        write!(f, "no board family is called {:?}; there are {known}", self.name)
    }
}

impl std::error::Error for UnknownFamily {}

impl Family {
    /// Whether the PMAC address is certainly memory: reading it affects no hardware.
    #[must_use]
    pub const fn is_memory(&self, address: u32) -> bool {
        address < self.memory_end || (self.base <= address && address - self.base < self.length / 4)
    }

    /// Whether the PMAC address holds a command line or a response, in either half.
    #[must_use]
    pub fn holds_text(&self, address: u32) -> bool {
        self.host_offset(Space::Y, address).is_some_and(|offset| self.ascii.has_text_in(offset, 2))
    }

    /// The family called `name` (`pmac`, `pmac2`, `turbo`, `turbo2`; capitals do not matter).
    ///
    /// # Errors
    /// [`UnknownFamily`], which lists the known names.
    pub fn by_name(name: &str) -> Result<&'static Self, UnknownFamily> {
        let family = FAMILIES.iter().copied().find(|family| family.name.eq_ignore_ascii_case(name));
        family.ok_or_else(|| UnknownFamily { name: name.to_owned() })
    }

    /// This family with a DPRAM of `length` bytes; `None` if no board of the family has that size.
    #[must_use]
    pub fn with_length(&self, length: u32) -> Option<&'static Self> {
        let families = FAMILIES.iter().chain(OTHER_LENGTHS).copied();
        families.into_iter().find(|family| family.name == self.name && family.length == length)
    }

    /// The sizes in bytes that the DPRAM of a board of this family may have, the usual one first.
    pub fn lengths(&self) -> impl Iterator<Item = u32> {
        let families = FAMILIES.iter().chain(OTHER_LENGTHS);
        families.filter(|family| family.name == self.name).map(|family| family.length)
    }

    /// This family with the DPRAM size `name` of [`DPRAM_SIZES`].
    ///
    /// # Errors
    /// The names of the sizes that the family has.
    pub fn with_dpram(&self, name: &str) -> Result<&'static Self, String> {
        let size = DPRAM_SIZES.iter().find(|(known, _)| *known == name);
        let family = size.and_then(|(_, bytes)| self.with_length(*bytes));
        let named = DPRAM_SIZES.iter().filter(|(_, bytes)| self.lengths().any(|length| length == *bytes));
        let names = || named.map(|(name, _)| *name).collect::<Vec<_>>().join(" or ");
        family.ok_or_else(|| format!("no {} has a DPRAM of `{name}`; write {}", self.title, names()))
    }

    /// The name of its DPRAM's size.
    #[must_use]
    pub fn dpram(&self) -> &'static str {
        DPRAM_SIZES.iter().find(|(_, bytes)| *bytes == self.length).map_or("", |(name, _)| name)
    }

    /// The family with this number in the segment, or `None` for an unknown number.
    #[must_use]
    pub fn by_number(number: u32) -> Option<&'static Self> {
        FAMILIES.iter().copied().find(|family| family.number == number)
    }

    /// Where PMAC keeps the time base of coordinate system `number` that the panel's override sets, the default of its
    /// Ix93; `None` without a panel.
    #[must_use]
    pub fn override_register(&self, number: usize) -> Option<PmacAddress> {
        let PmacAddress { space, number: first } = self.panel.as_ref()?.time_base;
        let stride = self.system_source_stride * number.saturating_sub(1) as u32;
        Some(PmacAddress::new(space, first + stride))
    }

    /// The PMAC registers whose copy for `number` (from 1) is `source`.
    #[must_use]
    pub fn source(&self, source: Source, number: usize) -> SourceAt {
        let step = |address: PmacAddress, stride: u32| {
            PmacAddress::new(address.space, address.number + stride * number.saturating_sub(1) as u32)
        };
        match source {
            Source::None => SourceAt::None,
            Source::Fixed(address) => SourceAt::One(address),
            Source::Motor(address) => SourceAt::One(step(address, self.motor_source_stride)),
            Source::System(address) => SourceAt::One(step(address, self.system_source_stride)),
            Source::Choice(addresses) => {
                SourceAt::Choice(addresses.map(|address| step(address, self.system_source_stride)))
            }
        }
    }

    /// The setting that makes the board use the DPRAM of its bus, `I24=$60000`, if the board could use another (Turbo
    /// User Manual p. 45).
    #[must_use]
    pub fn dpram_setting(&self) -> Option<String> {
        self.i.dpram_base.map(|variable| format!("I{variable}=${:X}", self.base))
    }

    /// The highest PMAC address.
    #[must_use]
    pub const fn last_address(&self) -> u32 {
        (1 << self.address_bits) - 1
    }

    /// The PMAC address of the location to which the word at `offset` belongs.
    #[must_use]
    pub const fn pmac_number(&self, offset: HostOffset) -> u32 {
        self.base + offset.bytes() / 4
    }

    /// `Y` or `X`: the half of its location that holds the word at `offset`.
    #[must_use]
    pub const fn half(&self, offset: HostOffset) -> Space {
        if offset.bytes().is_multiple_of(4) { Space::Y } else { Space::X }
    }

    /// The host offset of the PMAC location `number` (`X:` begins 2 bytes further on), or `None` outside the DPRAM.
    #[must_use]
    pub fn host_offset(&self, space: Space, number: u32) -> Option<HostOffset> {
        let bytes = number.checked_sub(self.base)?.checked_mul(4)?;
        let half = if space == Space::X { 2 } else { 0 };
        let end = bytes.checked_add(half + 2 * space.words() as u32)?;
        if end <= self.length { HostOffset::checked(bytes + half) } else { None }
    }

    /// The PMAC number after `$`, printed with this family's digits.
    #[must_use]
    pub fn print_number(&self, number: u32) -> String {
        format!("${number:0width$X}", width = self.address_digits)
    }

    /// The PMAC address of the word at `offset`, as `Y:$D012`.
    #[must_use]
    pub fn print_half(&self, offset: HostOffset) -> String {
        format!("{}:{}", self.half(offset), self.print_number(self.pmac_number(offset)))
    }

    /// The region of the word at `offset`, or `None` outside the DPRAM.
    #[must_use]
    pub fn region(&self, offset: HostOffset) -> Option<&'static Region> {
        self.regions.iter().find(|region| region.contains(offset))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_address_rule_holds_both_ways_for_every_word() {
        for bytes in (0..PMAC.length).step_by(2) {
            let offset = HostOffset::new(bytes);
            let number = PMAC.pmac_number(offset);
            let half = PMAC.half(offset);
            assert_eq!(bytes, 4 * (number - 0xD000) + if half == Space::X { 2 } else { 0 });
            assert_eq!(PMAC.host_offset(half, number), Some(offset));
        }
        assert_eq!(PMAC.host_offset(Space::Y, 0xCFFF), None);
        assert_eq!(PMAC.host_offset(Space::X, 0xDFFF), Some(HostOffset::new(0x3FFE)));
        assert_eq!(PMAC.host_offset(Space::Y, 0xE000), None);
        assert_eq!(PMAC.host_offset(Space::Dp, 0xDFFF), Some(HostOffset::new(0x3FFC)));
        assert_eq!(PMAC.host_offset(Space::L, 0xDFFF), None);
        assert_eq!(PMAC.host_offset(Space::Y, u32::MAX), None);
    }

    #[test]
    fn regions_tile_the_memory() {
        for family in FAMILIES.iter().chain(OTHER_LENGTHS) {
            let mut next = HostOffset::new(0);
            for region in family.regions {
                assert_eq!(region.start, next, "{}", region.name);
                next = region.end;
            }
            assert_eq!(next.bytes(), family.length);
        }
    }

    #[test]
    fn the_servo_reports_flags_are_those_of_the_servo_status() {
        use crate::map::{Flag, ServoBlock};
        for family in FAMILIES {
            let registers = family.blocks.iter().flat_map(|block| block.registers);
            let mut status = registers.filter(|register| register.name == "motor_servo_status");
            let status = status.next().unwrap().offset;
            let flag = |name: &str| {
                let known = family.status.motor[0].flags.iter().find(|(_, known)| *known == name);
                let bit = known.unwrap().0 as usize;
                Flag { word: status.plus_words(bit / 16), mask: 1 << (bit % 16) }
            };
            let ServoBlock { open_loop, activated, standing, .. } = family.servo;
            assert_eq!(open_loop, flag("open_loop"), "{}", family.name);
            assert_eq!(activated, flag("motor_activated"), "{}", family.name);
            assert_eq!(standing, flag("desired_velocity_zero"), "{}", family.name);
        }
    }

    #[test]
    fn an_unknown_family_is_answered_with_the_known_ones() {
        assert_eq!(Family::by_name("PMAC2").unwrap(), &PMAC2);
        let error = Family::by_name("pmac9").unwrap_err().to_string();
        assert_eq!(error, "no board family is called \"pmac9\"; there are pmac, pmac2, turbo, turbo2");
        assert_eq!("pmac9".parse::<Generation>().unwrap_err(), Family::by_name("pmac9").unwrap_err());
    }

    #[test]
    fn a_turbo_board_may_have_either_size_of_dpram() {
        for (family, lengths) in [(&TURBO, [0x4000, 0x1_0000]), (&TURBO2, [0x1_0000, 0x4000])] {
            assert!(family.lengths().eq(lengths));
            for length in lengths {
                let other = family.with_length(length).unwrap();
                assert_eq!((other.number, other.length), (family.number, length));
                assert_eq!(
                    (other.user_area.start, other.user_area.end.bytes()),
                    (family.user_area.start, length)
                );
            }
            assert_eq!(family.with_length(0x8000), None);
        }
        assert!(PMAC.lengths().eq([0x4000]));
        assert_eq!(PMAC.with_length(0x1_0000), None);
        // Turbo User Manual p. 402: the last locations are $060FFF and $063FFF.
        assert_eq!(TURBO.host_offset(Space::X, 0x06_0FFF), Some(HostOffset::new(0x3FFE)));
        assert_eq!(TURBO.host_offset(Space::Y, 0x06_1000), None);
        assert_eq!(TURBO2.host_offset(Space::X, 0x06_3FFF), Some(HostOffset::new(0xFFFE)));
        assert_eq!(TURBO2.host_offset(Space::Y, 0x06_4000), None);
    }

    #[test]
    fn generations_go_by_their_families_names() {
        assert_eq!("PMAC2".parse(), Ok(Generation::Pmac));
        assert_eq!("turbo".parse(), Ok(Generation::Turbo));
        for family in FAMILIES {
            assert_eq!(family.name.parse(), Ok(family.generation));
        }
    }
}
