//! Board families as data: base address, size, register table, strides.

use super::classic;
use super::classic_table;
use super::status::{self, StatusTables};
use super::{Block, HostOffset, Region, Space};

/// What distinguishes one family of boards from another, as far as its DPRAM goes.
#[derive(Debug, PartialEq)]
pub struct Family {
    /// The name in settings and on the command line.
    pub name: &'static str,
    /// The name as Delta Tau writes it.
    pub title: &'static str,
    /// The PMAC address of the first DPRAM location.
    pub base: u32,
    /// The DPRAM's size in bytes.
    pub length: u32,
    /// How many motors the board has.
    pub motors: usize,
    /// How many coordinate systems the board has.
    pub coordinate_systems: usize,
    /// Hexadecimal digits with which DPRAM addresses are printed.
    pub address_digits: usize,
    /// PMAC addresses from one motor's registers to the next motor's.
    pub motor_source_stride: u32,
    /// PMAC addresses from one coordinate system's registers to the next one's.
    pub system_source_stride: u32,
    /// The default of I10, the servo period in 1/8388608 ms.
    pub default_i10: u32,
    /// What the DPRAM is divided into, ascending, without a gap.
    pub regions: &'static [Region],
    /// The register table, ascending.
    pub blocks: &'static [Block],
    /// The status words of `?`, `??` and `???`.
    pub status: &'static StatusTables,
    /// Where gathering lies as printed.
    pub gather: GatherPlace,
    /// The firmware versions, as `VERSION` answers, that move the gather buffer and its index.
    pub gather_moved_in: &'static [&'static str],
    /// By how many bytes they move it.
    pub gather_shift: u32,
}

/// Where the three registers of data gathering lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GatherPlace {
    /// The buffer's size in longs.
    pub size: HostOffset,
    /// Where PMAC stores next, in longs from the buffer's start.
    pub index: HostOffset,
    /// The buffer's start.
    pub buffer: HostOffset,
}

const fn classic_family(name: &'static str, title: &'static str, default_i10: u32) -> Family {
    Family {
        name,
        title,
        base: classic::BASE,
        length: classic::LENGTH,
        motors: classic::MOTORS,
        coordinate_systems: classic::MOTORS,
        address_digits: 4,
        motor_source_stride: 0x3C,
        system_source_stride: 0xC0,
        default_i10,
        regions: classic::REGIONS,
        blocks: classic_table::BLOCKS,
        status: &status::CLASSIC,
        gather: GatherPlace {
            size: classic::GATHER_SIZE,
            index: classic::GATHER_INDEX,
            buffer: classic::GATHER_BUFFER,
        },
        gather_moved_in: classic::GATHER_MOVED_IN,
        gather_shift: classic::GATHER_SHIFT,
    }
}

/// PMAC, the first generation (PMAC(1)), with option 2 or 2V.
pub static PMAC: Family = classic_family("pmac", "PMAC", 3_713_707);
/// PMAC2; its DPRAM is laid out as PMAC's.
pub static PMAC2: Family = classic_family("pmac2", "PMAC2", 3_713_991);
/// The families this version knows.
pub static FAMILIES: &[&Family] = &[&PMAC, &PMAC2];

/// A family name that is not known.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("no board family is called {name:?}; known are {}", known())]
pub struct UnknownFamily {
    /// What was asked for.
    pub name: String,
}

fn known() -> String {
    FAMILIES.iter().map(|family| family.name).collect::<Vec<_>>().join(", ")
}

impl Family {
    /// The family called `name` (`pmac`, `pmac2`; capitals do not matter).
    ///
    /// # Errors
    /// [`UnknownFamily`], which lists the names there are.
    pub fn by_name(name: &str) -> Result<&'static Self, UnknownFamily> {
        FAMILIES
            .iter()
            .copied()
            .find(|family| family.name.eq_ignore_ascii_case(name))
            .ok_or_else(|| UnknownFamily { name: name.to_owned() })
    }

    /// The PMAC address of the location to which the word at `offset` belongs.
    #[must_use]
    pub const fn pmac_number(&self, offset: HostOffset) -> u32 {
        self.base + offset.bytes() / 4
    }

    /// `Y` or `X`: the half of its location that the word at `offset` is.
    #[must_use]
    pub const fn half(&self, offset: HostOffset) -> Space {
        if offset.bytes().is_multiple_of(4) { Space::Y } else { Space::X }
    }

    /// Where the PMAC location `number` begins (`X:` begins 2 bytes further on), or `None` when it lies outside the
    /// DPRAM.
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

    /// The region to which the word at `offset` belongs, or `None` when it lies outside the DPRAM.
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
        for family in FAMILIES {
            let mut next = HostOffset::new(0);
            for region in family.regions {
                assert_eq!(region.start, next, "{}", region.name);
                next = region.end;
            }
            assert_eq!(next.bytes(), family.length);
        }
    }

    #[test]
    fn an_unknown_family_is_answered_with_the_known_ones() {
        assert_eq!(Family::by_name("PMAC2").unwrap(), &PMAC2);
        let error = Family::by_name("pmac9").unwrap_err().to_string();
        assert_eq!(error, "no board family is called \"pmac9\"; known are pmac, pmac2");
    }
}
