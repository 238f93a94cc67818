//! Layout version 1 of the segment: the ABI, complete on this page. It never changes; additions take words that are
//! reserved here, and raise the minor version.
//!
//! # The object
//! A segment called `/pmac0` is the POSIX shared-memory object of that name, on Linux the file `/dev/shm/pmac0`, mode
//! 0644 unless the daemon is told otherwise. Open it read-only (`O_RDONLY | O_CLOEXEC | O_NOFOLLOW`), trust it only if its owner is root,
//! the user `pmacd` or yourself, compare its size with `total_length` *before* mapping, map it `PROT_READ, MAP_SHARED`.
//!
//! It is an array of 64-bit words in the machine's own byte order, on 64-bit machines only. **Every header
//! field is one whole word** (u64 unless said otherwise); offsets are in bytes from the start. Reserved words are zero; ignore them.
//!
//! # Header
//! | offset | field | changes | meaning |
//! |---|---|---|---|
//! | 0x000 | `magic` | no | [`MAGIC`], the bytes `PMACDPRM` on a little-endian machine. Stored last |
//! | 0x008 | `abi_major` | no | 1. Refuse any other |
//! | 0x010 | `abi_minor` | no | 2. Accept any: it grows with every addition |
//! | 0x018 | `header_length` | no | bytes from the start to the end of the region table |
//! | 0x020 | `layout_hash` | no | checksum of the geometry, see below |
//! | 0x028 | `total_length` | no | size of the object in bytes; it is never resized |
//! | 0x030 | `byte_order` | no | [`BYTE_ORDER`]; reads differently on a machine of the other byte order |
//! | 0x038 | `word_bytes` | no | 8 |
//! | 0x040 | `state` | yes | 0 init: the daemon is starting · 1 live · 2 stale: the daemon runs, the board does not answer · 3 dead: attach again |
//! | 0x048 | `generation` | no | differs for every daemon start: CLOCK_REALTIME in ns at creation, and more than the predecessor's |
//! | 0x050 | `owner_pid` | no | process id of the creator |
//! | 0x058 | `owner_uid` | no | effective user id of the creator |
//! | 0x060 | `clock_kind` | no | the clock of every time: 1 CLOCK_MONOTONIC · 2 the segment's own, see "Clock" below. Refuse any other |
//! | 0x068 | `created_ns` | no | when the segment was made; 0 by the segment's own clock |
//! | 0x070 | `heartbeat_limit_ns` | no | a heartbeat older than this means that the daemon is stopped or hangs; 0: it never grows too old |
//! | 0x078 | reserved | | |
//! | 0x080 | `heartbeat_ns` | yes | when the daemon's bus thread last gave a sign of life (at least 10 a second) |
//! | 0x088 | `beats` | yes | how many signs of life it gave |
//! | 0x090 | `realtime_offset_ns` | yes | i64: CLOCK_REALTIME minus the segment's clock, measured at a heartbeat |
//! | 0x098 | `realtime_taken_ns` | yes | when that was measured |
//! | 0x0A0 | `now_ns` | yes | what the segment's own clock shows (`clock_kind` 2), else 0 |
//! | 0x0A8 | reserved | | 3 words |
//! | 0x0C0 | `region_table` | no | offset of the region table |
//! | 0x0C8 | `region_count` | no | number of its entries, at most [`MAX_REGIONS`] |
//! | 0x0D0 | `region_stride` | no | bytes from entry to entry, at least 128 |
//! | 0x0D8 | `counter_table` | no | offset of the counters |
//! | 0x0E0 | `counter_count` | no | how many of them are in use |
//! | 0x0E8 | reserved | | 3 words |
//! | 0x100 | reserved | | 256 bytes |
//! | 0x200 | counters | yes | room for 32 words, see [`Counter`] for the order; each is a count since the segment was made |
//! | 0x300 | region table | | |
//!
//! # Clock
//! All times in the segment are nanoseconds of one clock, and every age is the difference of two of its times. With `clock_kind` 1, now
//! is CLOCK_MONOTONIC of this machine. With `clock_kind` 2, now is what `now_ns` holds (a relaxed load): the writer stores it at each
//! heartbeat, and raises it to a sample's `time_ns` before it publishes the sample. A simulation or a replay runs by such a clock. It
//! stands while its writer does, so that no heartbeat grows old by itself: only the owner's lock tells then that the writer is gone.
//!
//! `layout_hash` is the FNV-1a hash (64 bit, offset basis 0xCBF29CE484222325, prime 0x100000001B3) over the eight bytes, least significant
//! first, of each of these words in turn: `abi_major`, `header_length`, `total_length`, `region_table`, `region_count`, `region_stride`,
//! `counter_table`, and the first eight words of each region entry.
//!
//! # Region entry
//! | offset | field | changes | meaning |
//! |---|---|---|---|
//! | 0x00 | `id` | no | see [`RegionId`]; skip the ones you do not know |
//! | 0x08 | `head` | no | offset of the region's head word, a multiple of 64; the rest of its cache line is unused |
//! | 0x10 | `slots` | no | offset of the first slot, a multiple of 64 |
//! | 0x18 | `slot_count` | no | a power of two, at least 2 |
//! | 0x20 | `slot_stride` | no | bytes from slot to slot, a multiple of 64 |
//! | 0x28 | `payload_bytes` | no | longest payload of a sample |
//! | 0x30 | `first_host_offset` | no | where in the DPRAM the payload's first word lies (host byte offset); 0 for the board region |
//! | 0x38 | reserved | no | |
//! | 0x40 | `state` | yes | 0 off: not mirrored · 1 live · 2 stale: no update within its time |
//! | 0x48 | `period_ns` | yes | how often to expect a sample; 0 where there is no period |
//! | 0x50 | `stale_after_ns` | yes | a latest sample older than this is stale whatever `state` says; 0: never |
//! | 0x58 | `unread_words` | no | bit `i`: word `i` (16 bits) of every motor's or coordinate system's block is not read from the board |
//! | 0x60 | `unread_numbers` | no | bit `k-1`: nothing of motor or coordinate system `k` is read from the board |
//! | 0x68 | `block_start` | no | bytes from the payload's start to the block of number 1 |
//! | 0x70 | `block_stride` | no | bytes from one block to the next |
//! | 0x78 | `block_count` | no | how many blocks a payload may have; 0: this region has none |
//!
//! The last five are about the servo and background regions, whose payload has a block for each number (motor or coordinate system),
//! one behind the other. What is not read has its place in the payload, **holds 0 there, and must not be shown as a value.**
//! A payload ends with the last block that is read.
//!
//! # Head and slots
//! The head word counts the samples published. Samples are numbered from 1, so the head is also the number of the latest, and
//! 0 means that there is none yet. Sample `n` lies in slot `(n - 1) mod slot_count`.
//!
//! | offset in slot | field | meaning |
//! |---|---|---|
//! | 0x00 | `sequence` | `2n` when sample `n` is complete, `2n - 1` while it is written, 0 before the first |
//! | 0x08 | `time_ns` | when the first device read that went into the sample was made |
//! | 0x10 | `servo_timer` | the board's servo timer, extended to 64 bit |
//! | 0x18 | `flags` (low 32 bit), `length` (high 32 bit) | bit 0 of the flags: valid. Length of the payload in bytes |
//! | 0x20 | payload | 16-bit words in the machine's byte order, ascending by host offset, as the board held them |
//!
//! # Writing (one thread, the owner's)
//! ```text
//! sequence = 2n-1  relaxed
//! fence            release
//! time_ns, servo_timer, flags|length, payload   relaxed stores of 64-bit words
//! sequence = 2n    release
//! head     = n     release
//! FUTEX_WAKE (shared, not private) everyone on the low half of the head
//! ```
//! # Reading sample n
//! ```text
//! head     load relaxed; fence acquire.  n > head: not yet.  head - n >= slot_count: lost
//! time_ns, servo_timer, flags|length, payload   relaxed loads of 64-bit words into private memory
//! fence acquire; sequence load relaxed.  Not 2n: lost, throw the copy away
//! ```
//! The sequence need not be looked at before: that sample `n` is there the head has said. A reader that knows `n` from elsewhere loads
//! it first, with a fence acquire after it, and has lost the sample if it is not 2n.
//!
//! The latest sample is sample `head`; when it is lost meanwhile, start again with the new head, a bounded number of times. Check `length` against
//! `payload_bytes` in the copy. Use plain relaxed loads (in C `atomic_load_explicit(…, memory_order_relaxed)` and
//! `atomic_thread_fence`): stronger loads and read-modify-writes are not promised to work on read-only pages. On x86-64 a
//! reader in an interpreted language that loads whole words in this order is right as well, and so is one that copies with ordinary vector
//! loads: the processor keeps loads in order.
//!
//! A reader that follows every sample keeps the number of the next it wants. When that is lost, it goes on at `head - slot_count/2`
//! and has lost exactly the difference.
//!
//! # Waiting
//! The futex word is the low half of the head (offset +0 on little-endian, +4 on big-endian machines). `FUTEX_WAIT` works on the read-only
//! mapping: load the head, and if it is what you have, wait for its low half to differ from that value, then look again. Use a time-out not longer than
//! `heartbeat_limit_ns`: a killed daemon wakes nobody, and so may, in a narrow race, a stopping one.
//!
//! # Old or fresh
//! Data are fresh only if all of these hold; show nothing else as live:
//! 1. `state` is 1 and `heartbeat_ns` is not older than `heartbeat_limit_ns` (unless that is 0),
//! 2. the region's `state` is 1, and the sample's `time_ns` is not older than `stale_after_ns` (unless that is 0),
//! 3. bit 0 of the sample's flags is set.
//!
//! Attach again when `state` is 3, when the name leads to another file than the one mapped (compare device and
//! inode number), or when the owner is gone: it holds an open-file-description write lock on the whole object while it lives, so
//! `fcntl(fd, F_OFD_GETLK)` with `l_type = F_RDLCK` (all other fields 0) that returns `F_UNLCK` tells of its death.

/// First word of a complete segment.
pub const MAGIC: u64 = u64::from_le_bytes(*b"PMACDPRM");
/// Version of this page.
pub const ABI_MAJOR: u64 = 1;
/// Additions since.
pub const ABI_MINOR: u64 = 2;
/// What `byte_order` holds, as the machine that wrote it reads it.
pub const BYTE_ORDER: u64 = 0x0102_0304_0506_0708;
/// Bytes of a word, the unit of every access.
pub const WORD: usize = 8;
/// What everything that is written by one and read by another is aligned to, in bytes.
pub const LINE: usize = 64;

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
/// Words there are room for in the counter table.
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
/// Offset in a slot of the payload.
pub const SLOT_PAYLOAD: usize = 0x20;
/// Words of a slot between its sequence and its payload.
pub const STAMP_WORDS: usize = 3;
/// Bit of `flags`: the sample is what the board held, read whole.
pub const FLAG_VALID: u64 = 1;

/// Longest payload a region may have, in bytes; more than four times the largest DPRAM.
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
    /// The segment's own: now is what its writer stored last, from 0 on. For simulations and replays.
    Own = 2,
}

impl ClockKind {
    /// The clock of that number; `None` for one that this version cannot read.
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
    /// No update arrived in its time.
    Stale = 2,
}

impl RegionState {
    /// The state of that number; an unknown one counts as stale.
    #[must_use]
    pub fn from_number(number: u64) -> Self {
        match number {
            0 => Self::Off,
            1 => Self::Live,
            _ => Self::Stale,
        }
    }
}

/// What a region mirrors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(u64)]
pub enum RegionId {
    /// Servo fixed data: the board's words as they were.
    Servo = 1,
    /// Background fixed data: the board's words as they were.
    Background = 2,
    /// Who the board is: [`super::Identity`].
    Board = 3,
    /// Control panel: the board's words as they were.
    Panel = 4,
    /// Registers of the user's choice: [`super::payload::variable`].
    Variable = 5,
    /// Gathered samples: [`super::payload::gather`].
    Gather = 6,
}

impl RegionId {
    /// All regions this version knows.
    pub const ALL: [Self; 6] =
        [Self::Servo, Self::Background, Self::Board, Self::Panel, Self::Variable, Self::Gather];

    /// The region of that number, if this version knows it.
    #[must_use]
    pub fn from_number(number: u64) -> Option<Self> {
        Self::ALL.into_iter().find(|region| *region as u64 == number)
    }

    /// The region's name, lower case.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Servo => "servo",
            Self::Background => "background",
            Self::Board => "board",
            Self::Panel => "panel",
            Self::Variable => "variables",
            Self::Gather => "gather",
        }
    }
}

/// The counters, in the order of the counter table. Each is a count since the segment was made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum Counter {
    /// Servo updates published.
    Updates = 0,
    /// Samples read from the board that did not reach the segment. Stays 0: publishing cannot fail.
    Lost = 1,
    /// Copies thrown away because the board wrote meanwhile, and made again.
    Retries = 2,
    /// Servo updates the board made that were not read in time.
    Missed = 3,
    /// Servo updates the board held off because Host-Busy was set.
    Skipped = 4,
    /// Bus cycles made on the board.
    BusAccesses = 5,
    /// Bus cycles that failed.
    BusErrors = 6,
    /// Background updates published.
    BackgroundUpdates = 7,
    /// Control-panel samples published.
    PanelUpdates = 8,
    /// Command lines and control characters sent by the ASCII interface.
    AsciiCommands = 9,
    /// Reply lines received.
    AsciiReplies = 10,
    /// Error replies received.
    AsciiErrors = 11,
    /// Waits for the ASCII interface that ran out.
    AsciiTimeouts = 12,
    /// Lines that no command asked for.
    AsciiUnsolicited = 13,
    /// Interrupts taken.
    Interrupts = 14,
    /// Times the board was found reset.
    Resets = 15,
    /// Sleeping readers woken.
    Wakes = 16,
    /// Of the bus cycles: those for servo data, polls and retries included.
    ServoAccesses = 17,
    /// Of the bus cycles: those for background data.
    BackgroundAccesses = 18,
    /// Of the bus cycles: those for ASCII.
    AsciiAccesses = 19,
}

impl Counter {
    /// All counters, in table order.
    pub const ALL: [Self; 20] = [
        Self::Updates,
        Self::Lost,
        Self::Retries,
        Self::Missed,
        Self::Skipped,
        Self::BusAccesses,
        Self::BusErrors,
        Self::BackgroundUpdates,
        Self::PanelUpdates,
        Self::AsciiCommands,
        Self::AsciiReplies,
        Self::AsciiErrors,
        Self::AsciiTimeouts,
        Self::AsciiUnsolicited,
        Self::Interrupts,
        Self::Resets,
        Self::Wakes,
        Self::ServoAccesses,
        Self::BackgroundAccesses,
        Self::AsciiAccesses,
    ];

    /// The counter's name, as JSON output spells it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Updates => "updates",
            Self::Lost => "lost",
            Self::Retries => "retries",
            Self::Missed => "missed",
            Self::Skipped => "skipped",
            Self::BusAccesses => "bus_accesses",
            Self::BusErrors => "bus_errors",
            Self::BackgroundUpdates => "background_updates",
            Self::PanelUpdates => "panel_updates",
            Self::AsciiCommands => "ascii_commands",
            Self::AsciiReplies => "ascii_replies",
            Self::AsciiErrors => "ascii_errors",
            Self::AsciiTimeouts => "ascii_timeouts",
            Self::AsciiUnsolicited => "ascii_unsolicited",
            Self::Interrupts => "interrupts",
            Self::Resets => "resets",
            Self::Wakes => "wakes",
            Self::ServoAccesses => "servo_accesses",
            Self::BackgroundAccesses => "background_accesses",
            Self::AsciiAccesses => "ascii_accesses",
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
