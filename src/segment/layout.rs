//! Layout version 1 of the segment: the numbers of the page below. The page decides; a test compares these numbers with
//! it.
#![doc = include_str!("../../docs/segment.md")]

use super::counter::Counter;

/// First word of a complete segment.
pub const MAGIC: u64 = u64::from_le_bytes(*b"PMACDPRM");
/// Major version of this page.
pub const ABI_MAJOR: u64 = 1;
/// Minor version: additions since.
pub const ABI_MINOR: u64 = 5;
/// The value of `byte_order`.
pub const BYTE_ORDER: u64 = 0x0102_0304_0506_0708;
/// Bytes of a word, the unit of every access.
pub const WORD: usize = 8;
/// Alignment in bytes of everything that one side writes and the other reads.
pub const LINE: usize = 64;

/// Words of a cache line.
pub(super) const LINE_WORDS: usize = LINE / WORD;

/// Offset of `magic`.
pub const AT_MAGIC: usize = 0x000;
/// Offset of `abi_major`.
pub const AT_ABI_MAJOR: usize = 0x008;
/// Offset of `abi_minor`.
pub const AT_ABI_MINOR: usize = 0x010;
/// Offset of `header_length`.
pub const AT_HEADER_LENGTH: usize = 0x018;
/// Offset of `layout_hash`.
pub const AT_LAYOUT_HASH: usize = 0x020;
/// Offset of `total_length`.
pub const AT_TOTAL_LENGTH: usize = 0x028;
/// Offset of `byte_order`.
pub const AT_BYTE_ORDER: usize = 0x030;
/// Offset of `word_bytes`.
pub const AT_WORD_BYTES: usize = 0x038;
/// Offset of `state`.
pub const AT_STATE: usize = 0x040;
/// Offset of `generation`.
pub const AT_GENERATION: usize = 0x048;
/// Offset of `owner_pid`.
pub const AT_OWNER_PID: usize = 0x050;
/// Offset of `owner_uid`.
pub const AT_OWNER_UID: usize = 0x058;
/// Offset of `clock_kind`.
pub const AT_CLOCK_KIND: usize = 0x060;
/// Offset of `created_ns`.
pub const AT_CREATED: usize = 0x068;
/// Offset of `heartbeat_limit_ns`.
pub const AT_HEARTBEAT_LIMIT: usize = 0x070;
/// Offset of `heartbeat_ns`.
pub const AT_HEARTBEAT: usize = 0x080;
/// Offset of `beats`.
pub const AT_BEATS: usize = 0x088;
/// Offset of `realtime_offset_ns`.
pub const AT_REALTIME_OFFSET: usize = 0x090;
/// Offset of `realtime_taken_ns`.
pub const AT_REALTIME_TAKEN: usize = 0x098;
/// Offset of `now_ns`.
pub const AT_NOW: usize = 0x0A0;
/// Offset of `region_table`.
pub const AT_REGION_TABLE: usize = 0x0C0;
/// Offset of `region_count`.
pub const AT_REGION_COUNT: usize = 0x0C8;
/// Offset of `region_stride`.
pub const AT_REGION_STRIDE: usize = 0x0D0;
/// Offset of `counter_table`.
pub const AT_COUNTER_TABLE: usize = 0x0D8;
/// Offset of `counter_count`.
pub const AT_COUNTER_COUNT: usize = 0x0E0;
/// Offset of the 256 reserved bytes.
pub const AT_RESERVED: usize = 0x100;
/// Where version 1 puts the counters.
pub const AT_COUNTERS: usize = 0x200;
/// Words reserved for the counter table.
pub const COUNTER_ROOM: usize = 32;
/// Where version 1 puts the region table, and so the shortest header.
pub const AT_REGIONS: usize = 0x300;

/// Bytes of a region entry.
pub const REGION_STRIDE: usize = 128;
/// Most entries a region table may have.
pub const MAX_REGIONS: usize = 64;
/// Offset in a region entry of `id`.
pub const REGION_ID: usize = 0x00;
/// Offset in a region entry of `head`.
pub const REGION_HEAD: usize = 0x08;
/// Offset in a region entry of `slots`.
pub const REGION_SLOTS: usize = 0x10;
/// Offset in a region entry of `slot_count`.
pub const REGION_SLOT_COUNT: usize = 0x18;
/// Offset in a region entry of `slot_stride`.
pub const REGION_SLOT_STRIDE: usize = 0x20;
/// Offset in a region entry of `payload_bytes`.
pub const REGION_PAYLOAD: usize = 0x28;
/// Offset in a region entry of `first_host_offset`.
pub const REGION_HOST_OFFSET: usize = 0x30;
/// Words at the start of a region entry that never change.
pub const REGION_FIXED_WORDS: usize = 8;
/// Offset in a region entry of `state`.
pub const REGION_STATE: usize = 0x40;
/// Offset in a region entry of `period_ns`.
pub const REGION_PERIOD: usize = 0x48;
/// Offset in a region entry of `stale_after_ns`.
pub const REGION_STALE_AFTER: usize = 0x50;
/// Offset in a region entry of `unread_words`.
pub const REGION_UNREAD_WORDS: usize = 0x58;
/// Offset in a region entry of `unread_numbers`.
pub const REGION_UNREAD_NUMBERS: usize = 0x60;

/// Offset in a region entry of `block_start`.
pub const REGION_BLOCK_START: usize = 0x68;
/// Offset in a region entry of `block_stride`.
pub const REGION_BLOCK_STRIDE: usize = 0x70;
/// Offset in a region entry of `block_count`.
pub const REGION_BLOCK_COUNT: usize = 0x78;

/// Offset in a slot of `sequence`.
pub const SLOT_SEQUENCE: usize = 0x00;
/// Offset in a slot of `time_ns`.
pub const SLOT_TIME: usize = 0x08;
/// Offset in a slot of `servo_timer`.
pub const SLOT_SERVO_TIMER: usize = 0x10;
/// Offset in a slot of `flags` and `length`.
pub const SLOT_FLAGS_LENGTH: usize = 0x18;
/// Offset in a slot of `payload`.
pub const SLOT_PAYLOAD: usize = 0x20;
/// Words of a slot between its sequence and its payload.
pub const STAMP_WORDS: usize = 3;
/// Bit of `flags`: the sample is a complete copy of the board's words.
pub const FLAG_VALID: u64 = 1;

/// Longest payload of a region, in bytes; more than four times the largest DPRAM.
pub const MAX_PAYLOAD: u64 = 1 << 20;
/// Largest segment, in bytes.
pub const MAX_TOTAL: u64 = 1 << 30;

const _: () = {
    assert!(AT_COUNTERS == AT_RESERVED + 256);
    assert!(AT_REGIONS == AT_COUNTERS + COUNTER_ROOM * WORD);
    assert!(Counter::ALL.len() <= COUNTER_ROOM);
    assert!(REGION_STATE == REGION_FIXED_WORDS * WORD && REGION_STATE.is_multiple_of(LINE));
    assert!(SLOT_PAYLOAD == SLOT_TIME + STAMP_WORDS * WORD);
    assert!(AT_STATE.is_multiple_of(LINE) && AT_HEARTBEAT.is_multiple_of(LINE));
    assert!(AT_COUNTERS.is_multiple_of(LINE) && AT_REGIONS.is_multiple_of(LINE));
    assert!(REGION_STRIDE.is_multiple_of(LINE) && REGION_STRIDE == REGION_BLOCK_COUNT + WORD);
};

/// The clock of every time in a segment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u64)]
pub enum ClockKind {
    /// CLOCK_MONOTONIC of the machine.
    #[default]
    Monotonic = 1,
    /// The segment's own: its writer stores the time, starting at 0. For simulations and replays.
    Own = 2,
}

impl ClockKind {
    /// The clock with this number; `None` for a number of a later version.
    #[must_use]
    pub fn from_number(number: u64) -> Option<Self> {
        match number {
            1 => Some(Self::Monotonic),
            2 => Some(Self::Own),
            _ => None,
        }
    }
}

pub use crate::protocol::State;

/// State of one region.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u64)]
pub enum RegionState {
    /// Not mirrored at present.
    Off = 0,
    /// Updates arrive in time.
    Live = 1,
    /// An update is overdue.
    Stale = 2,
}

impl RegionState {
    /// The state with this number; an unknown one counts as stale.
    #[must_use]
    pub fn from_number(number: u64) -> Self {
        match number {
            0 => Self::Off,
            1 => Self::Live,
            _ => Self::Stale,
        }
    }

    /// Its name: `off`, `live` or `stale`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Live => "live",
            Self::Stale => "stale",
        }
    }
}

/// A region's kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(u64)]
pub enum RegionId {
    /// Servo fixed data: the board's words unchanged.
    Servo = 1,
    /// Background fixed data: the board's words unchanged.
    Background = 2,
    /// The board's identity: [`super::Identity`].
    Board = 3,
    /// Control panel: the board's words unchanged.
    Panel = 4,
    /// Registers of the users' choice: [`super::payload::variable`].
    Variable = 5,
    /// Gathered samples: [`super::payload::gather`].
    Gather = 6,
    /// The site's own words: [`super::payload::user`].
    User = 7,
    /// Their names, formats and units: [`super::payload::user`].
    UserTable = 8,
}

impl RegionId {
    /// All regions this version knows.
    pub const ALL: [Self; 8] = [
        Self::Servo,
        Self::Background,
        Self::Board,
        Self::Panel,
        Self::Variable,
        Self::Gather,
        Self::User,
        Self::UserTable,
    ];

    /// The region with this number; `None` for a number of a later version.
    #[must_use]
    pub fn from_number(number: u64) -> Option<Self> {
        Self::ALL.into_iter().find(|region| *region as u64 == number)
    }

    /// The region's name in lower case.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Servo => "servo",
            Self::Background => "background",
            Self::Board => "board",
            Self::Panel => "panel",
            Self::Variable => "variables",
            Self::Gather => "gather",
            Self::User => "user",
            Self::UserTable => "user table",
        }
    }
}

/// FNV-1a over the bytes of the words, least significant first.
#[must_use]
pub fn layout_hash(words: impl IntoIterator<Item = u64>) -> u64 {
    words
        .into_iter()
        .flat_map(u64::to_le_bytes)
        .fold(0xCBF2_9CE4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01B3))
}
