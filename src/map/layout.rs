//! A family's register table as one board has it: expanded over motors and coordinate systems, with gathering where
//! its firmware keeps it.

use serde::Serialize;

use super::readings::{GatherSizeWord, GatherWords, Readings};
use super::{
    Block, Confidence, Family, Firmware, GatherPlace, Generation, HostOffset, Register, SourceAt, Space,
    Width,
};

/// The register map of one board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layout {
    family: &'static Family,
    gather: GatherPlace,
}

/// A register of one number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Entry {
    /// The table's block it comes from.
    pub block: &'static Block,
    /// The table's row.
    pub register: &'static Register,
    /// Its number, from 1; `None` for a register of the board.
    pub number: Option<usize>,
    /// Where it lies.
    pub offset: HostOffset,
}

/// A register as `pmacctl map --json` prints it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct MapRecord {
    /// The automatic function.
    pub function: &'static str,
    /// The register's identifier within the function.
    pub register: &'static str,
    /// Motor or coordinate system, from 1.
    pub number: Option<usize>,
    /// Bytes from the DPRAM's start.
    pub host_offset: u32,
    /// Bytes; 0 for a buffer whose length is set at run time.
    pub length: u32,
    /// The PMAC location, with `$`.
    pub pmac_address: String,
    /// `Y`, `X`, `DP` or, for two locations that hold one 48-bit register, `L(2xDP)`.
    pub space: &'static str,
    /// How its bits are to be read.
    pub format: &'static str,
    /// How sure this is, `H`, `M` or `L`; without it, the board's own DPRAM manual says it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub confidence: Option<&'static str>,
}

impl Layout {
    /// The layout of `family`; without `firmware`, as printed.
    #[must_use]
    pub fn new(family: &'static Family, firmware: Option<Firmware>) -> Self {
        Self::read_by(family, firmware, Readings::default())
    }

    /// As [`Layout::new`], on a board with these readings.
    #[must_use]
    pub fn read_by(family: &'static Family, firmware: Option<Firmware>, readings: Readings) -> Self {
        let moved = family.gather_moved_since.zip(firmware).is_some_and(|(since, version)| version >= since);
        let printed = match (family.generation, readings.gather_words) {
            (Generation::Turbo, GatherWords::IndexFirst) => {
                let GatherPlace { size, index, buffer } = family.gather;
                GatherPlace { size: index, index: size, buffer }
            }
            _ => family.gather,
        };
        let shift = |offset: HostOffset| offset.plus_words(family.gather_shift as usize / 2);
        let gather = if moved {
            GatherPlace {
                size: match readings.gather_size_word {
                    GatherSizeWord::WithIndex => shift(printed.size),
                    GatherSizeWord::AsPrinted | GatherSizeWord::NotWritten => printed.size,
                },
                index: shift(printed.index),
                buffer: shift(printed.buffer),
            }
        } else {
            printed
        };
        Self { family, gather }
    }

    /// The board's family.
    #[must_use]
    pub const fn family(&self) -> &'static Family {
        self.family
    }

    /// Where gathering lies on this board.
    #[must_use]
    pub const fn gather(&self) -> GatherPlace {
        self.gather
    }

    /// Every register of every number, in the table's order.
    pub fn entries(&self) -> impl Iterator<Item = Entry> + use<> {
        let layout = *self;
        layout.family.blocks.iter().flat_map(move |block| {
            (0..block.count.max(1)).flat_map(move |index| {
                block.registers.iter().map(move |register| layout.entry(block, register, index))
            })
        })
    }

    /// The register `register` of `function` for `number` (`None` for a register of the board).
    #[must_use]
    pub fn find(&self, function: &str, register: &str, number: Option<usize>) -> Option<Entry> {
        self.entries().find(|entry| {
            entry.register.function == function && entry.register.name == register && entry.number == number
        })
    }

    /// The map as records, in the table's order.
    #[must_use]
    pub fn records(&self) -> Vec<MapRecord> {
        self.entries().map(|entry| entry.record(self.family)).collect()
    }

    fn entry(&self, block: &'static Block, register: &'static Register, index: usize) -> Entry {
        let number = if block.count == 0 { None } else { Some(index + 1) };
        let offset = self.moved(register.offset).plus_words(index * (block.stride as usize / 2));
        Entry { block, register, number, offset }
    }

    fn moved(&self, printed: HostOffset) -> HostOffset {
        let gather = self.family.gather;
        match printed {
            offset if offset == gather.size => self.gather.size,
            offset if offset == gather.index => self.gather.index,
            offset if offset == gather.buffer => self.gather.buffer,
            offset => offset,
        }
    }
}

/// The map of `family` as records; without `firmware`, as printed. See [`Layout::records`].
#[must_use]
pub fn records(family: &'static Family, firmware: Option<Firmware>) -> Vec<MapRecord> {
    Layout::new(family, firmware).records()
}

impl Entry {
    /// Whether the word at `offset` is part of this register. A buffer of run-time length contains its first word.
    #[must_use]
    pub const fn contains(&self, offset: HostOffset) -> bool {
        let length = if self.register.length == 0 { 2 } else { self.register.length };
        self.offset.bytes() <= offset.bytes() && offset.bytes() < self.offset.bytes() + length
    }

    /// The registers it is a copy of.
    #[must_use]
    pub fn source(&self, family: &Family) -> SourceAt {
        family.source(self.register.source, self.number.unwrap_or(1))
    }

    /// The name of the space in which the register's PMAC address stands.
    #[must_use]
    pub const fn space(&self, family: &Family) -> &'static str {
        match self.register.width {
            Width::Word => family.half(self.offset).name(),
            Width::Long => Space::Dp.name(),
            Width::Pair => "L(2xDP)",
        }
    }

    /// The register as a record.
    #[must_use]
    pub fn record(&self, family: &Family) -> MapRecord {
        MapRecord {
            function: self.register.function,
            register: self.register.name,
            number: self.number,
            host_offset: self.offset.bytes(),
            length: self.register.length,
            pmac_address: family.print_number(family.pmac_number(self.offset)),
            space: self.space(family),
            format: self.register.format.name(),
            confidence: self.register.confidence.map(Confidence::letter),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{FAMILIES, PMAC, TURBO2};
    use super::*;

    #[test]
    fn the_table_tiles_the_fixed_part_without_gap_or_overlap() {
        for family in FAMILIES {
            let mut entries: Vec<_> = Layout::new(family, None).entries().collect();
            entries.sort_by_key(|entry| entry.offset);
            let mut next = HostOffset::new(0);
            for entry in &entries {
                assert_eq!(entry.offset, next, "{:?} {:?}", entry.register.name, entry.number);
                next = entry.offset.plus_words(entry.register.length as usize / 2);
            }
            assert_eq!(next, family.gather.buffer);
        }
    }

    /// The first register of the table with the word at `offset`.
    fn lies_at(layout: &Layout, offset: HostOffset) -> Option<Entry> {
        layout.entries().find(|entry| entry.contains(offset))
    }

    #[test]
    fn every_word_is_found_under_its_own_name() {
        let layout = Layout::new(&PMAC, None);
        for entry in layout.entries() {
            let found = layout.find(entry.register.function, entry.register.name, entry.number);
            assert_eq!(found, Some(entry));
            for word in 0..(entry.register.length as usize / 2).max(1) {
                assert_eq!(lies_at(&layout, entry.offset.plus_words(word)), Some(entry));
            }
        }
        assert_eq!(layout.find("servo", "motor_actual_position", None), None);
        assert_eq!(layout.find("servo", "motor_actual_position", Some(9)), None);
        assert_eq!(lies_at(&layout, HostOffset::new(0x0802)), None);
    }

    #[test]
    fn the_gather_buffer_lies_elsewhere_from_firmware_1_16c_on() {
        let at = |version: Option<&str>, gather_size_word| {
            let firmware = version.map(|text| text.parse().unwrap());
            let readings = Readings { gather_size_word, ..Readings::default() };
            let place = Layout::read_by(&PMAC, firmware, readings).gather();
            [place.size, place.index, place.buffer].map(HostOffset::bytes)
        };
        let printed = [0x07FC, 0x07FE, 0x0800];
        for version in [None, Some("1.15"), Some("1.16"), Some("1.16B")] {
            assert_eq!(at(version, GatherSizeWord::WithIndex), printed, "{version:?}");
        }
        for version in ["1.16C", "1.16D", "1.16E", "1.16G", "1.16H", "1.17", "1.17A", "1.17C", "1.18", "2.00"]
        {
            assert_eq!(at(Some(version), GatherSizeWord::WithIndex), [0x08FC, 0x08FE, 0x0900]);
            assert_eq!(at(Some(version), GatherSizeWord::AsPrinted), [0x07FC, 0x08FE, 0x0900]);
        }
        let layout = Layout::new(&PMAC, Some("1.16D".parse().unwrap()));
        let buffer = layout.find("gather", "buffer", None).unwrap();
        assert_eq!(buffer.record(&PMAC).pmac_address, "$D240");
        assert_eq!(lies_at(&layout, HostOffset::new(0x07FE)), None);
    }

    #[test]
    fn c1_the_disputed_word_of_a_turbo_gather_is_a_reading() {
        for (gather_words, size, index) in
            [(GatherWords::SizeFirst, 0x113C, 0x113E), (GatherWords::IndexFirst, 0x113E, 0x113C)]
        {
            let readings = Readings { gather_words, ..Readings::default() };
            let layout = Layout::read_by(&TURBO2, None, readings);
            let place = layout.gather();
            assert_eq!([place.size, place.index, place.buffer].map(HostOffset::bytes), [size, index, 0x1140]);
            assert_eq!(layout.find("gather", "storage_index", None).unwrap().offset.bytes(), index);
            assert_eq!(Layout::read_by(&PMAC, None, readings).gather(), PMAC.gather);
        }
    }

    #[test]
    fn sources_step_with_the_number() {
        let layout = Layout::new(&PMAC, None);
        let source = |name: &str, number| {
            let entry = layout.find("background", name, Some(number)).unwrap();
            entry.source(&PMAC).to_string()
        };
        assert_eq!(source("motor_background_status", 3), "Y:$0994");
        assert_eq!(source("cs_z_target_position", 8), "A L:$0DBE, B L:$0DDE, C L:$0D61");
        assert_eq!(source("cs_time_left_in_move", 2), "X:$005C");
        assert_eq!(source("cs_program_address_offset", 2), "");
    }

    #[test]
    fn bits_lie_inside_their_register_and_do_not_overlap() {
        for entry in Layout::new(&PMAC, None).entries() {
            let mut seen = 0u32;
            for bits in entry.register.bits {
                assert!(bits.low <= bits.high && bits.high < 16, "{}", bits.name);
                let mask = ((1u32 << (bits.high - bits.low + 1)) - 1) << bits.low;
                assert_eq!(seen & mask, 0, "{}", bits.name);
                seen |= mask;
            }
        }
    }
}
