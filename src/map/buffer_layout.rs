//! The layout of the user area ($D200-$DFFF on PMAC): the place of each buffer of variable size. The site uses the
//! rest.
//!
//! The host alone places the tables of the background variable functions and the binary rotary buffers, and must keep
//! them apart (DPRAM manual p. 25). The firmware places the gather buffer at the bottom, and its length changes from
//! one gathering to the next. So the plan goes from the top downwards: rotary buffers, the first one on top, then
//! variable read, then variable write. The user has the room between them and the gather buffer. A setting can place
//! each buffer elsewhere.

use std::fmt;

use super::functions::{
    VARIABLE_READ_ENTRIES, VARIABLE_READ_ENTRY_WORDS, VARIABLE_WRITE_RECORD_WORDS, VARIABLE_WRITE_RECORDS,
};
use super::{Family, HostOffset, Layout, Region};

/// 16-bit words of the data of one variable-read entry at most: a long register's.
pub const VARIABLE_READ_DATA_WORDS: usize = 4;

/// The names of the rotary buffers: as many as any family has headers for.
const ROTARY: [&str; 16] = [
    "rotary_1",
    "rotary_2",
    "rotary_3",
    "rotary_4",
    "rotary_5",
    "rotary_6",
    "rotary_7",
    "rotary_8",
    "rotary_9",
    "rotary_10",
    "rotary_11",
    "rotary_12",
    "rotary_13",
    "rotary_14",
    "rotary_15",
    "rotary_16",
];

/// Sizes of the buffers in the user area, and places for buffers outside the plan.
#[derive(Debug, Clone, PartialEq, Eq, serde::Deserialize, serde::Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct BufferSettings {
    /// Longs (32 bits) kept for gathering, from the gather buffer's start on.
    pub gather_longs: u32,
    /// Entries the variable-read table has room for, 0-128.
    pub variable_read_entries: u32,
    /// Records the variable-write table has room for, 0-32; 0 where `pmacd` does not use the family's function.
    pub variable_write_records: u32,
    /// Longs of the rotary buffers, the first one's first, each 0 (none) or even and at least 6. Buffers beyond the
    /// list have none. Without a list they have the family's default.
    pub rotary_longs: Option<Vec<u32>>,
    /// PMAC address of the variable-read table; 0 where the plan puts it.
    pub variable_read_start: u32,
    /// PMAC address of the variable-write records; 0 where the plan puts them.
    pub variable_write_start: u32,
    /// PMAC addresses of the rotary buffers; 0, or beyond the list, where the plan puts them.
    pub rotary_start: Vec<u32>,
}

impl Default for BufferSettings {
    /// On PMAC: gathering below $D800, the tables and rotary buffers from $DA20 on, 544 longs from $D800 for the user.
    fn default() -> Self {
        Self {
            gather_longs: 0x5C0,
            variable_read_entries: VARIABLE_READ_ENTRIES as u32,
            variable_write_records: VARIABLE_WRITE_RECORDS as u32,
            rotary_longs: None,
            variable_read_start: 0,
            variable_write_start: 0,
            rotary_start: Vec::new(),
        }
    }
}

impl BufferSettings {
    /// Longs of the rotary buffers on a board of `family`.
    #[must_use]
    pub fn rotary_longs(&self, family: &Family) -> &[u32] {
        self.rotary_longs.as_deref().unwrap_or(family.rotary.kept_longs)
    }

    /// The settings, filled up with the family's defaults.
    #[must_use]
    pub fn of(self, family: &Family) -> Self {
        Self { rotary_longs: Some(self.rotary_longs(family).to_vec()), ..self }
    }
}

/// Why the buffers cannot have the places of the settings.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BufferLayoutError {
    /// Two buffers share words.
    #[error(
        "{first} and {second} overlap; make one of them smaller, or give it another place: {}",
        settings_of(&[first.name, second.name])
    )]
    Overlap {
        /// One buffer, with its addresses.
        first: Extent,
        /// The other.
        second: Extent,
    },
    /// A buffer that leaves the user area.
    #[error(
        "{buffer} does not fit into the area {area}; make it or its neighbours smaller: {}",
        settings_of(&[buffer])
    )]
    Outside {
        /// The buffer's name.
        buffer: &'static str,
        /// The area.
        area: Extent,
    },
    /// A size its function does not allow.
    #[error("{}: {size} is not possible for {buffer}; {allowed}", settings_of(&[buffer]))]
    Size {
        /// The buffer's name.
        buffer: &'static str,
        /// The requested size.
        size: u32,
        /// The possible sizes.
        allowed: &'static str,
    },
    /// A list of rotary buffers that is longer than the board has.
    #[error("{setting} lists {listed} buffers; the board has {there_are}")]
    TooMany {
        /// The list.
        setting: &'static str,
        /// Its length.
        listed: usize,
        /// How many rotary buffers the board has.
        there_are: usize,
    },
}

/// A buffer with the PMAC addresses of its first and last word, as messages show it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Extent {
    /// The buffer's name.
    pub name: &'static str,
    /// Its first PMAC address.
    pub first: u32,
    /// Its last PMAC address.
    pub last: u32,
    digits: usize,
}

impl fmt::Display for Extent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, first, last, digits } = self;
        write!(f, "{name} (${first:0digits$X}-${last:0digits$X})")
    }
}

impl Extent {
    fn of(family: &Family, region: Region) -> Self {
        let last = HostOffset::new(region.end.bytes().saturating_sub(2));
        Self {
            name: region.name,
            first: family.pmac_number(region.start),
            last: family.pmac_number(last),
            digits: family.address_digits,
        }
    }
}

/// The owner of a word of the DPRAM.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Owner {
    /// A function with a fixed place: panel, servo, background, ASCII, or the buffers' headers.
    Fixed(&'static Region),
    /// A buffer in the user area: `gather`, `variable_read`, `variable_write`, or `rotary_1` and so on.
    Buffer(Region),
    /// Below a gather buffer that the firmware moved: the firmware keeps its index there, and no text explains the
    /// other words.
    Firmware(Region),
    /// The user.
    User,
}

impl fmt::Display for Owner {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Fixed(region) => write!(f, "the {} area", region.name),
            Self::Buffer(region) => write!(f, "the {} buffer", region.name),
            Self::Firmware(_) => f.write_str("the firmware, which keeps the gather index there"),
            Self::User => f.write_str("nobody"),
        }
    }
}

/// Words that the user does not own.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NotUserArea {
    /// The words belong to a function.
    #[error("{offset} ({address}) belongs to {owner}; {user}")]
    Owned {
        /// The function's first word.
        offset: HostOffset,
        /// Its PMAC address.
        address: String,
        /// The word's owner.
        owner: String,
        /// The user's part of the DPRAM.
        user: String,
    },
    /// The words lie outside the DPRAM.
    #[error("{offset} lies outside the DPRAM")]
    Outside {
        /// The first word outside.
        offset: HostOffset,
    },
}

/// The places of the buffers in the user area.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BufferLayout {
    family: &'static Family,
    firmware: Region,
    gather: Region,
    variable_read: Region,
    variable_write: Region,
    /// Empty beyond the board's headers.
    rotary: [Region; ROTARY.len()],
}

impl BufferLayout {
    /// Places the buffers of `settings` on a board with `layout`.
    ///
    /// # Errors
    /// A size that cannot be, a buffer that leaves the user area, two that overlap.
    pub fn new(layout: &Layout, settings: &BufferSettings) -> Result<Self, BufferLayoutError> {
        let family = layout.family();
        check_sizes(settings, family)?;
        let area = family.user_area;
        let gather_start = layout.gather().buffer;
        let mut top = area.end.bytes();
        let mut place = |name, longs: u32, start: u32| {
            let outside = || outside(name, family, area);
            let start = match start {
                0 => {
                    top =
                        longs.checked_mul(4).and_then(|bytes| top.checked_sub(bytes)).ok_or_else(outside)?;
                    top
                }
                number => {
                    4 * number.checked_sub(family.base).filter(|&n| n < family.length).ok_or_else(outside)?
                }
            };
            region_at(name, start, longs, area).ok_or_else(outside)
        };
        let listed = |list: &[u32], index: usize| list.get(index).copied().unwrap_or_default();
        let mut rotary = ROTARY.map(|name| Region::new(name, area.end, area.end));
        for (index, (region, name)) in rotary.iter_mut().zip(ROTARY).enumerate() {
            let longs = listed(settings.rotary_longs(family), index);
            *region = place(name, longs, listed(&settings.rotary_start, index))?;
        }
        let read_longs = read_longs(settings.variable_read_entries);
        let variable_read = place("variable_read", read_longs, settings.variable_read_start)?;
        let records = family.variable_write.since.map_or(0, |_| settings.variable_write_records);
        let variable_write = place("variable_write", write_longs(records), settings.variable_write_start)?;
        let gather = region_at("gather", gather_start.bytes(), settings.gather_longs, area)
            .ok_or_else(|| outside("gather", family, area))?;
        let firmware = Region::new("firmware", area.start, gather_start);
        let layout = Self { family, firmware, gather, variable_read, variable_write, rotary };
        layout.check_overlap()?;
        Ok(layout)
    }

    fn check_overlap(&self) -> Result<(), BufferLayoutError> {
        for (index, first) in self.buffers().enumerate() {
            for second in self.buffers().take(index) {
                let both = first.words() > 0 && second.words() > 0;
                if both && first.start < second.end && second.start < first.end {
                    let [first, second] = [second, first].map(|region| Extent::of(self.family, region));
                    return Err(BufferLayoutError::Overlap { first, second });
                }
            }
        }
        Ok(())
    }

    /// Every buffer, including empty ones and the firmware's words below the gather buffer.
    fn buffers(&self) -> impl Iterator<Item = Region> {
        [self.firmware, self.gather, self.variable_read, self.variable_write].into_iter().chain(self.rotary)
    }

    /// The family of the board.
    #[must_use]
    pub const fn family(&self) -> &'static Family {
        self.family
    }

    /// The words kept for gathering.
    #[must_use]
    pub const fn gather(&self) -> Region {
        self.gather
    }

    /// The size for `DEFINE GATHER`, in longs, with samples of `sample_longs`: the most whole samples that fit. PMAC
    /// rounds other sizes up, past the buffer's room. `None` if not one sample fits.
    #[must_use]
    pub fn gather_size(&self, sample_longs: u32) -> Option<u32> {
        if !(1..=self.family.i.longest_gather_sample()).contains(&sample_longs) {
            return None;
        }
        let samples = self.gather.words() as u32 / 2 / sample_longs;
        (samples > 0).then_some(samples * sample_longs)
    }

    /// Whether a gather buffer at `start`, of `longs` rounded up to whole samples, overlaps no other buffer.
    ///
    /// # Errors
    /// [`BufferLayoutError`] with the buffer in the way.
    pub fn check_gather(
        &self,
        start: HostOffset,
        longs: u32,
        sample_longs: u32,
    ) -> Result<(), BufferLayoutError> {
        let longs = longs.div_ceil(sample_longs.max(1)).saturating_mul(sample_longs.max(1));
        let gather = region_at("gather", start.bytes(), longs, self.family.user_area)
            .ok_or_else(|| outside("gather", self.family, self.family.user_area))?;
        for other in self.buffers().filter(|other| other.name != "gather") {
            let apart =
                gather.end.bytes() <= other.start.bytes() || other.end.bytes() <= gather.start.bytes();
            if !apart && other.words() > 0 {
                let (first, second) = (Extent::of(self.family, gather), Extent::of(self.family, other));
                return Err(BufferLayoutError::Overlap { first, second });
            }
        }
        Ok(())
    }

    /// The variable-read table and, behind it, its data.
    #[must_use]
    pub const fn variable_read(&self) -> Region {
        self.variable_read
    }

    /// The variable-write records.
    #[must_use]
    pub const fn variable_write(&self) -> Region {
        self.variable_write
    }

    /// The rotary buffers, as many as the board has headers.
    #[must_use]
    pub fn rotary(&self) -> &[Region] {
        &self.rotary[..self.family.rotary.headers.len().min(ROTARY.len())]
    }

    /// Checks that rotary buffer `index` (from 0) may have `longs` longs at `start`: in its own place, or in unplanned
    /// room. The caller checks the DPRAM's limits.
    ///
    /// # Errors
    /// [`NotUserArea::Owned`], which names the first word with another owner.
    pub fn check_rotary(&self, index: usize, start: HostOffset, longs: u32) -> Result<(), NotUserArea> {
        let own = self.rotary().get(index);
        let words = usize::try_from(longs.min(self.family.length / 4)).unwrap_or_default() * 2;
        let offsets = (0..words).map(|word| start.plus_words(word));
        let mut owners = offsets.filter_map(|offset| Some((offset, self.classify(offset)?)));
        let other = owners
            .find(|(offset, owner)| *owner != Owner::User && own.is_none_or(|own| !own.contains(*offset)));
        match other {
            None => Ok(()),
            Some((offset, owner)) => Err(self.owned(offset, owner)),
        }
    }

    /// The user's regions, ascending.
    #[must_use]
    pub fn user_regions(&self) -> Vec<Region> {
        let mut buffers: Vec<_> = self.buffers().filter(|buffer| buffer.words() > 0).collect();
        buffers.sort_by_key(|region| region.start);
        let mut regions = Vec::new();
        let mut next = self.family.user_area.start;
        for buffer in buffers {
            if next < buffer.start {
                regions.push(Region::new("user", next, buffer.start));
            }
            next = buffer.end;
        }
        if next < self.family.user_area.end {
            regions.push(Region::new("user", next, self.family.user_area.end));
        }
        regions
    }

    /// The owner of the word at `offset`, or `None` outside the DPRAM.
    #[must_use]
    pub fn classify(&self, offset: HostOffset) -> Option<Owner> {
        if !self.family.user_area.contains(offset) {
            return self.family.region(offset).map(Owner::Fixed);
        }
        if self.firmware.contains(offset) {
            return Some(Owner::Firmware(self.firmware));
        }
        let buffer = self.buffers().find(|region| region.contains(offset));
        Some(buffer.map_or(Owner::User, Owner::Buffer))
    }

    /// Checks that all `words` words from `first` on are the user's.
    ///
    /// # Errors
    /// [`NotUserArea`], which names the first word with another owner, that owner, and the user's regions.
    pub fn check_user_area(&self, first: HostOffset, words: usize) -> Result<(), NotUserArea> {
        let end = u64::from(first.bytes()) + 2 * words as u64;
        if end > u64::from(self.family.length) {
            return Err(NotUserArea::Outside { offset: first.max(self.family.user_area.end) });
        }
        for offset in (0..words).map(|word| first.plus_words(word)) {
            match self.classify(offset) {
                Some(Owner::User) => {}
                Some(owner) => return Err(self.owned(offset, owner)),
                None => return Err(NotUserArea::Outside { offset }),
            }
        }
        Ok(())
    }

    fn owned(&self, offset: HostOffset, owner: Owner) -> NotUserArea {
        let (address, owner, user) =
            (self.family.print_half(offset), owner.to_string(), self.describe_user_area());
        NotUserArea::Owned { offset, address, owner, user }
    }

    fn describe_user_area(&self) -> String {
        let print = |number| self.family.print_number(number);
        let extents = self.user_regions().into_iter().map(|region| Extent::of(self.family, region));
        let texts: Vec<_> =
            extents.map(|extent| format!("{}-{}", print(extent.first), print(extent.last))).collect();
        match texts.as_slice() {
            [] => "with the present plan nothing is left to the user".to_owned(),
            texts => format!("the user area is {}", texts.join(", ")),
        }
    }
}

fn check_sizes(settings: &BufferSettings, family: &Family) -> Result<(), BufferLayoutError> {
    let size = |buffer, size, allowed| Err(BufferLayoutError::Size { buffer, size, allowed });
    if settings.variable_read_entries as usize > VARIABLE_READ_ENTRIES {
        return size("variable_read", settings.variable_read_entries, "a table has 0 to 128 entries");
    }
    if settings.variable_write_records as usize > VARIABLE_WRITE_RECORDS {
        return size("variable_write", settings.variable_write_records, "a table has 0 to 32 records");
    }
    let there_are = family.rotary.headers.len();
    let rotary_longs = settings.rotary_longs(family);
    for (setting, list) in [("rotary_longs", rotary_longs), ("rotary_start", &settings.rotary_start)] {
        if list.len() > there_are {
            return Err(BufferLayoutError::TooMany { setting, listed: list.len(), there_are });
        }
    }
    for (buffer, &longs) in ROTARY.into_iter().zip(rotary_longs) {
        if longs != 0 && (longs < 6 || !longs.is_multiple_of(2)) {
            return size(buffer, longs, "a rotary buffer has 0 or an even number of longs, at least 6");
        }
    }
    Ok(())
}

/// The names of the settings for the places and sizes of these buffers.
fn settings_of(buffers: &[&str]) -> String {
    let of_one = |buffer: &&str| match *buffer {
        "gather" => &["gather_longs"][..],
        "variable_read" => &["variable_read_entries", "variable_read_start"],
        "variable_write" => &["variable_write_records", "variable_write_start"],
        "firmware" => &[],
        _ => &["rotary_longs", "rotary_start"],
    };
    let mut names: Vec<&str> = buffers.iter().flat_map(of_one).copied().collect();
    names.dedup();
    names.join(", ")
}

/// Longs that `entries` entries of the variable-read table take with their data.
const fn read_longs(entries: u32) -> u32 {
    entries * (VARIABLE_READ_ENTRY_WORDS + VARIABLE_READ_DATA_WORDS) as u32 / 2
}

const fn write_longs(records: u32) -> u32 {
    records * VARIABLE_WRITE_RECORD_WORDS as u32 / 2
}

/// The region of `longs` longs from byte `start` on, if the user area holds it.
fn region_at(name: &'static str, start: u32, longs: u32, area: Region) -> Option<Region> {
    let end = longs.checked_mul(4)?.checked_add(start)?;
    if start < area.start.bytes() || end > area.end.bytes() {
        return None;
    }
    Some(Region::new(name, HostOffset::checked(start)?, HostOffset::checked(end)?))
}

fn outside(buffer: &'static str, family: &Family, area: Region) -> BufferLayoutError {
    BufferLayoutError::Outside { buffer, area: Extent::of(family, area) }
}

#[cfg(test)]
#[path = "buffer_layout_tests.rs"]
mod tests;
