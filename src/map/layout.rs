//! A family's register table for one board: expanded over motors and coordinate systems, with gathering at its
//! firmware's place.

use serde::Serialize;

use super::{Block, Confidence, Family, Firmware, GatherPlace, HostOffset, Register, SourceAt, Space, Width};

/// The register map of one board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layout {
    family: &'static Family,
    gather: GatherPlace,
}

/// A register of one number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Entry {
    /// The table's block that it comes from.
    pub block: &'static Block,
    /// The table's row.
    pub register: &'static Register,
    /// Its number, from 1; `None` for a register of the board.
    pub number: Option<usize>,
    /// Its place.
    pub offset: HostOffset,
}

/// A register as `pmacctl board map --json` prints it.
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
    /// How sure the entry is, `H`, `M` or `L`; without it, the board's own DPRAM manual says it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub confidence: Option<&'static str>,
}

impl Layout {
    /// The layout of `family`; without `firmware`, as printed.
    #[must_use]
    pub fn new(family: &'static Family, firmware: Option<Firmware>) -> Self {
        let moved = family.gather_moved_since.zip(firmware).is_some_and(|(since, version)| version >= since);
        let GatherPlace { size, index, buffer } = family.gather;
        let shift = if moved { family.gather_shift as usize / 2 } else { 0 };
        let [size, index, buffer] = [size, index, buffer].map(|offset| offset.plus_words(shift));
        Self { family, gather: GatherPlace { size, index, buffer } }
    }

    /// The board's family.
    #[must_use]
    pub const fn family(&self) -> &'static Family {
        self.family
    }

    /// The place of gathering on this board.
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

    /// The PMAC registers that it copies.
    #[must_use]
    pub fn source(&self, family: &Family) -> SourceAt {
        family.source(self.register.source, self.number.unwrap_or(1))
    }

    /// The name of the space of the register's PMAC address.
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
    use super::super::{FAMILIES, PMAC};
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
        let at = |version: Option<&str>| {
            let place = Layout::new(&PMAC, version.map(|text| text.parse().unwrap())).gather();
            [place.size, place.index, place.buffer].map(HostOffset::bytes)
        };
        for version in [None, Some("1.15"), Some("1.16"), Some("1.16B")] {
            assert_eq!(at(version), [0x07FC, 0x07FE, 0x0800], "{version:?}");
        }
        for version in ["1.16C", "1.16D", "1.16E", "1.16G", "1.16H", "1.17", "1.17A", "1.17C", "1.18", "2.00"]
        {
            assert_eq!(at(Some(version)), [0x08FC, 0x08FE, 0x0900]);
        }
        let layout = Layout::new(&PMAC, Some("1.16D".parse().unwrap()));
        let buffer = layout.find("gather", "buffer", None).unwrap();
        assert_eq!(buffer.record(&PMAC).pmac_address, "$D240");
        assert_eq!(lies_at(&layout, HostOffset::new(0x07FE)), None);
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
