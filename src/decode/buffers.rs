//! The control panel, gathering, the variable tables and the rotary buffers in an image: their fixed words, and the
//! entries of tables. No word says whether a function is switched on; a field is `None` if its words cannot belong to
//! the function.

use serde::{Serialize, Serializer};

use super::Image;
use crate::format::{Float48Layout, fixed48, int24};
use crate::map::functions::{
    VARIABLE_READ_ENTRIES, VARIABLE_READ_ENTRY_READY, VARIABLE_READ_ENTRY_WORDS, VARIABLE_WRITE_RECORD_WORDS,
    VARIABLE_WRITE_RECORDS, rotary_header,
};
use crate::map::{Family, HostOffset, Layout, PanelBlock, VariableKind};

/// These functions' words.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Buffers {
    /// The control panel; `None` for a family without one.
    pub panel: Option<Panel>,
    /// Data gathering.
    pub gather: Gather,
    /// Background variable read.
    pub variable_read: ReadTable,
    /// Background variable write, if a manual describes its records.
    pub variable_write: Option<WriteTable>,
    /// The rotary buffers, in the order of their headers.
    pub rotary: Vec<Rotary>,
}

/// The control panel's words.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Panel {
    /// The numbers that have a request, bit 0 for number 1.
    pub request_enable: u16,
    /// The coordinate systems that take their feed rate override from here, bit 0 for number 1.
    pub override_enable: u16,
    /// The request words, from number 1.
    pub requests: Vec<u16>,
    /// The feed rate overrides, from number 1.
    pub overrides: Vec<u16>,
}

/// The words of data gathering.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Gather {
    /// The buffer's size in longs.
    pub size_longs: u16,
    /// Where the board stores the next item, in longs from the buffer's start.
    pub next_long: u16,
}

/// The table of the background variable read.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ReadTable {
    /// Whether every entry has its own ready bit.
    pub multi_user: bool,
    /// In single-user mode: whether PMAC has marked the values as new.
    pub ready: bool,
    /// The low 16 bits of the servo counter at the update.
    pub servo_timer: u16,
    /// How many entries the table has.
    pub count: u16,
    /// The entries; `None` if so many do not fit where the table begins, or one has an unknown kind.
    pub entries: Option<Vec<ReadEntry>>,
}

/// An entry of that table.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ReadEntry {
    /// The register's kind.
    pub kind: VariableKind,
    /// Its PMAC address, with `$`.
    pub address: String,
    /// In multi-user mode: whether PMAC has marked the value as new.
    pub ready: bool,
    /// Its value.
    #[serde(flatten)]
    pub value: EntryValue,
}

/// A value of that table. The table does not tell fixed from floating point, so a long has both readings.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(untagged)]
pub enum EntryValue {
    /// A word of 24 bits.
    Word {
        /// Signed.
        value: i32,
    },
    /// A register of 48 bits.
    Long {
        /// As a fixed-point number.
        fixed: i64,
        /// As a floating-point number.
        float: f64,
    },
}

/// The records of the background variable write.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct WriteTable {
    /// How many records PMAC still has to write.
    pub count: u16,
    /// The records; `None` if so many do not fit where the table begins.
    pub records: Option<Vec<WriteRecord>>,
}

/// A record of that table.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct WriteRecord {
    /// The register's PMAC address, with `$`.
    pub address: String,
    /// The word with the register's kind, and the width and place of its bits.
    #[serde(serialize_with = "hexadecimal")]
    pub type_word: u16,
    /// The two data longs.
    pub data: [u32; 2],
}

/// The header of a rotary buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Rotary {
    /// Which one, from 1.
    pub buffer: usize,
    /// The coordinate system's word.
    pub coordinate_system: u16,
    /// PMAC's own buffer is full.
    pub full: bool,
    /// PMAC's error code, if it has found an error.
    pub error: Option<u8>,
    /// Where the host writes next, in longs.
    pub host_index: u16,
    /// Where PMAC reads next, in longs.
    pub pmac_index: u16,
    /// The size in longs; 0 for a buffer that is not in use.
    pub size_longs: u16,
    /// Where the buffer lies; `None` if that place is not wholly in the user area.
    pub host_offset: Option<u32>,
}

fn hexadecimal<S: Serializer>(word: &u16, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(&format_args!("${word:04X}"))
}

impl Buffers {
    /// Reads the words from `image`, of a board with `layout`.
    #[must_use]
    pub fn of(image: &Image, layout: &Layout, float48: Float48Layout) -> Self {
        let family = layout.family();
        let read = Reader { image, family };
        let gather = layout.gather();
        Self {
            panel: family.panel.as_ref().map(|panel| read.panel(panel)),
            gather: Gather { size_longs: read.word(gather.size), next_long: read.word(gather.index) },
            variable_read: read.variable_read(float48),
            variable_write: read.variable_write(),
            rotary: (1..)
                .zip(family.rotary.headers)
                .map(|(number, header)| read.rotary(number, *header))
                .collect(),
        }
    }
}

struct Reader<'a> {
    image: &'a Image,
    family: &'static Family,
}

impl Reader<'_> {
    /// The word at `offset`; the fixed words lie in every image.
    fn word(&self, offset: HostOffset) -> u16 {
        self.image.word(offset).unwrap_or_default()
    }

    fn long(&self, offset: HostOffset) -> u32 {
        crate::format::join32(self.word(offset), self.word(offset.plus_words(1)))
    }

    /// Where the table with this start word begins, if `words` words from there on lie in the user area.
    fn table(&self, start: u16, words: usize) -> Option<HostOffset> {
        let first = self.family.start.offset(start)?;
        let area = self.family.user_area;
        (area.contains(first) && first.plus_words(words) <= area.end).then_some(first)
    }

    fn address(&self, number: u32) -> String {
        self.family.print_number(number)
    }

    fn panel(&self, panel: &PanelBlock) -> Panel {
        let words = |first: HostOffset| {
            (0..panel.numbers).map(|index| self.word(first.plus_words(index * panel.stride))).collect()
        };
        Panel {
            request_enable: self.word(panel.request_enable),
            override_enable: self.word(panel.override_enable),
            requests: words(panel.request),
            overrides: words(panel.feed_override),
        }
    }

    fn variable_read(&self, float48: Float48Layout) -> ReadTable {
        let block = &self.family.variable_read;
        let count = self.word(block.count);
        ReadTable {
            multi_user: block.multi_user.is_set(self.word(block.multi_user.word)),
            ready: block.ready.is_set(self.word(block.ready.word)),
            servo_timer: self.word(block.timer),
            count,
            entries: self.read_entries(count.into(), float48),
        }
    }

    /// Reads the entries, and behind them their values in the same order.
    fn read_entries(&self, count: usize, float48: Float48Layout) -> Option<Vec<ReadEntry>> {
        let block = &self.family.variable_read;
        match count {
            0 => return Some(Vec::new()),
            1..=VARIABLE_READ_ENTRIES => (),
            _ => return None,
        }
        let table_words = count * VARIABLE_READ_ENTRY_WORDS;
        let table = self.table(self.word(block.start), table_words)?;
        let mut value_at = table.plus_words(table_words);
        let mut entries = Vec::with_capacity(count);
        for index in 0..count {
            let at = table.plus_words(index * VARIABLE_READ_ENTRY_WORDS);
            let words = [self.word(at), self.word(at.plus_words(1))];
            let kind = VariableKind::of_code(block.kind_code(words[1]))?;
            let longs = [self.long(value_at), self.long(value_at.plus_words(2))];
            value_at = value_at.plus_words(kind.words());
            let value = match kind {
                VariableKind::Y | VariableKind::X => EntryValue::Word { value: int24::signed(longs[0]) },
                VariableKind::Long | VariableKind::Special => EntryValue::Long {
                    fixed: fixed48::decode(longs[0], longs[1]),
                    float: float48.decode(longs[0], longs[1]),
                },
            };
            let ready = words[1] & VARIABLE_READ_ENTRY_READY != 0;
            entries.push(ReadEntry { kind, address: self.address(words[0].into()), ready, value });
        }
        (value_at <= self.family.user_area.end).then_some(entries)
    }

    fn variable_write(&self) -> Option<WriteTable> {
        let block = &self.family.variable_write;
        block.since?;
        let count = self.word(block.count);
        Some(WriteTable { count, records: self.write_records(self.word(block.start), count.into()) })
    }

    fn write_records(&self, start: u16, count: usize) -> Option<Vec<WriteRecord>> {
        match count {
            0 => return Some(Vec::new()),
            1..=VARIABLE_WRITE_RECORDS => (),
            _ => return None,
        }
        let table = self.table(start, count * VARIABLE_WRITE_RECORD_WORDS)?;
        let record = |index| self.write_record(table.plus_words(index * VARIABLE_WRITE_RECORD_WORDS));
        Some((0..count).map(record).collect())
    }

    fn write_record(&self, at: HostOffset) -> WriteRecord {
        WriteRecord {
            address: self.address(self.word(at).into()),
            type_word: self.word(at.plus_words(1)),
            data: [self.long(at.plus_words(2)), self.long(at.plus_words(4))],
        }
    }

    fn rotary(&self, buffer: usize, header: HostOffset) -> Rotary {
        let word = |index| self.word(header.plus_words(index));
        let status = word(rotary_header::STATUS);
        let size_longs = word(rotary_header::SIZE);
        let place = self.table(word(rotary_header::START), 2 * usize::from(size_longs));
        Rotary {
            buffer,
            coordinate_system: word(rotary_header::COORDINATE_SYSTEM),
            full: status & rotary_header::BUSY != 0,
            error: (status & rotary_header::ERROR != 0).then_some(status as u8),
            host_index: word(rotary_header::HOST_INDEX),
            pmac_index: word(rotary_header::PMAC_INDEX),
            size_longs,
            host_offset: place.map(HostOffset::bytes),
        }
    }
}
