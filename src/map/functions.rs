//! Descriptors: each automatic function's place in a family's DPRAM, and the handshake between host and PMAC.
//!
//! A function of the driver takes a descriptor and knows no address. A difference between families is a value here; a
//! difference in the handshake itself is a small enum ([`BusyRule`]), matched in one place.

mod variables;

pub use variables::{
    RECORD_OFFSET, RECORD_SPECIAL, RECORD_WIDTH, VARIABLE_READ_ENTRIES, VARIABLE_READ_ENTRY_READY,
    VARIABLE_READ_ENTRY_WORDS, VARIABLE_WRITE_RECORD_WORDS, VARIABLE_WRITE_RECORDS, VariableKind,
    VariableRead, VariableWrite,
};

use super::{HostOffset, NumberKind, PmacAddress, Region};
use crate::format::{int24, join32};

/// Bits of a DPRAM word by which one side signals the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Flag {
    /// The word.
    pub word: HostOffset,
    /// The bits.
    pub mask: u16,
}

impl Flag {
    /// Whether any of the bits is set in `word`.
    #[must_use]
    pub const fn is_set(self, word: u16) -> bool {
        word & self.mask != 0
    }
}

/// A servo timer in the DPRAM: the low bits of PMAC's servo counter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Timer {
    /// The word with the low bits.
    pub low: HostOffset,
    /// The number of the word's bits that count, from bit 0.
    pub low_bits: u32,
    /// The word with the upper bits, and the number of them that count, from bit 0.
    pub high: Option<(HostOffset, u32)>,
}

impl Timer {
    /// How many bits the timer has, at most 24.
    #[must_use]
    pub const fn bits(self) -> u32 {
        match self.high {
            None => self.low_bits,
            Some((_, bits)) => self.low_bits + bits,
        }
    }

    /// The timer from its words. `high` is ignored for a timer without a high word.
    #[must_use]
    pub const fn value(self, low: u16, high: u16) -> u32 {
        let low = low as u32 & ((1 << self.low_bits) - 1);
        match self.high {
            None => low,
            Some((_, bits)) => low | (high as u32 & ((1 << bits) - 1)) << self.low_bits,
        }
    }

    /// The timer in `words`, which begin at `start`.
    #[must_use]
    pub fn read(self, words: &[u16], start: HostOffset) -> u32 {
        let word = |offset: HostOffset| words.get(offset.words_since(start)).copied().unwrap_or_default();
        self.value(word(self.low), self.high.map_or(0, |(offset, _)| word(offset)))
    }
}

/// Words side by side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Run {
    /// The first word.
    pub first: HostOffset,
    /// How many 16-bit words.
    pub words: usize,
}

/// Equal blocks of registers, one a motor or coordinate system, one behind the other without a gap.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Blocks {
    /// How many there are.
    pub count: usize,
    /// The block of number 1.
    pub first: HostOffset,
    /// 16-bit words of a block, and from one block to the next.
    pub words: usize,
}

impl Blocks {
    /// The start of `number`'s block, or `None` if there is none.
    #[must_use]
    pub const fn at(self, number: usize) -> Option<HostOffset> {
        if number >= 1 && number <= self.count {
            Some(self.first.plus_words((number - 1) * self.words))
        } else {
            None
        }
    }

    /// 16-bit words from `start` to the end of the block of number `count`.
    #[must_use]
    pub const fn words_from(self, start: HostOffset, count: usize) -> usize {
        self.first.words_since(start) + count * self.words
    }
}

/// The meaning of PMAC's flag in the servo report.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BusyRule {
    /// Set while PMAC writes (PMAC and PMAC2, DPRAM manual p. 14).
    SetWhileWriting,
    /// Clear while PMAC writes, set when the data are whole (Turbo User Manual p. 403).
    ClearWhileWriting,
}

impl BusyRule {
    /// Whether PMAC is writing, by its flag.
    #[must_use]
    pub const fn is_busy(self, flag: bool) -> bool {
        match self {
            Self::SetWhileWriting => flag,
            Self::ClearWhileWriting => !flag,
        }
    }

    /// PMAC's flag while PMAC writes (`busy`), or while it does not.
    #[must_use]
    pub const fn flag(self, busy: bool) -> bool {
        match self {
            Self::SetWhileWriting => busy,
            Self::ClearWhileWriting => !busy,
        }
    }
}

/// The event that begins the servo report.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReportStart {
    /// The first `GATHER` while it is enabled; one more starts data gathering (DPRAM manual p. 14).
    Gather,
    /// The I-variable that enables it (Turbo User Manual p. 403).
    Enable,
}

/// The copies of the words of `???` in a report: PMAC's servo report, a Turbo board's background report.
#[derive(Debug, PartialEq, Eq)]
pub struct GlobalStatus {
    /// The places of the first and of the second word.
    pub longs: [HostOffset; 2],
    /// In the second word: a motion, rotary or PLC buffer is open for text, so that a command line is a program line.
    pub program_buffer_open: u32,
    /// In the first word: the board gathers data.
    pub gathering: u32,
}

impl GlobalStatus {
    /// The words of `???` in the `image` of a report that begins at `start`.
    #[must_use]
    pub fn words(&self, image: &[u16], start: HostOffset) -> Option<[u32; 2]> {
        let long = |offset: HostOffset| {
            let &[low, high] = image.get(offset.words_since(start)..)?.first_chunk()?;
            Some(int24::unsigned(join32(low, high)))
        };
        let [first, second] = self.longs;
        Some([long(first)?, long(second)?])
    }

    /// The facts about the whole board in these words.
    #[must_use]
    pub const fn whole_board(&self, [first, second]: [u32; 2]) -> WholeBoard {
        WholeBoard {
            program_buffer_open: second & self.program_buffer_open != 0,
            gathering: first & self.gathering != 0,
        }
    }
}

/// A report's facts about the whole board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WholeBoard {
    /// A program buffer is open.
    pub program_buffer_open: bool,
    /// The board gathers data.
    pub gathering: bool,
}

/// The servo report: motor data that PMAC copies every so many servo cycles.
#[derive(Debug, PartialEq, Eq)]
pub struct ServoBlock {
    /// The whole report.
    pub region: Region,
    /// The event that begins it.
    pub start: ReportStart,
    /// Set by the host: PMAC skips its updates.
    pub host_busy: Flag,
    /// Set and cleared by PMAC.
    pub pmac_status: Flag,
    /// The flag's meaning.
    pub busy: BusyRule,
    /// The servo timer at the update.
    pub timer: Timer,
    /// Which motors PMAC copies: 32 bits, Y half first, bit 0 for motor 1. `None`: motors 1 to
    /// [`IVariables::reported`].
    pub mask: Option<HostOffset>,
    /// Words of the board that the host reads with every update.
    pub global: Run,
    /// The copies of the words of `???`; `None` where the report has none.
    pub global_status: Option<GlobalStatus>,
    /// In the first motor's block: the motor's loop is open, as after a kill.
    pub open_loop: Flag,
    /// There: the motor is activated. Clear in an image without that word.
    pub activated: Flag,
    /// There: its desired velocity is zero.
    pub standing: Flag,
    /// The motors' blocks.
    pub motors: Blocks,
}

impl ServoBlock {
    /// 16-bit words from the region's start to the end of the last motor's block.
    #[must_use]
    pub const fn words(&self) -> usize {
        self.motors.words_from(self.region.start, self.motors.count)
    }

    /// The index of the word at `offset` in an image of the region.
    #[must_use]
    pub const fn index(&self, offset: HostOffset) -> usize {
        offset.words_since(self.region.start)
    }
}

/// The background report: PMAC copies it between its PLC scans when the host asks for it.
#[derive(Debug, PartialEq, Eq)]
pub struct BackgroundBlock {
    /// The whole report.
    pub region: Region,
    /// PMAC sets it when a report is whole; the host clears the word to ask for another.
    pub ready: Flag,
    /// Set by the host: PMAC skips its updates.
    pub host_busy: Option<Flag>,
    /// How many blocks PMAC fills; the host writes it. `None`: [`IVariables::reported`] tells.
    pub count: Option<HostOffset>,
    /// The servo timer when the data became ready.
    pub timer: Timer,
    /// Words of the board that the host reads with every report.
    pub global: Run,
    /// The longs with the board's ports: JPAN, JTHW and JOPTO.
    pub ports: [HostOffset; 3],
    /// The copies of the words of `???`; `None` where the report has none.
    pub global_status: Option<GlobalStatus>,
    /// In the block of motor 1: its amplifier is enabled.
    pub amplifier_enabled: Option<Flag>,
    /// In the block of coordinate system 1: it runs a motion program.
    pub program_runs: Flag,
    /// The blocks' numbers count these.
    pub numbers: NumberKind,
    /// The blocks.
    pub blocks: Blocks,
}

impl BackgroundBlock {
    /// The number of blocks in a board's report if its reports go up to motor `motors`.
    #[must_use]
    pub const fn reported(&self, motors: usize) -> usize {
        match self.numbers {
            NumberKind::Motor | NumberKind::MotorOrCoordinateSystem if motors < self.blocks.count => motors,
            _ => self.blocks.count,
        }
    }

    /// 16-bit words from the region's start to the end of the last block.
    #[must_use]
    pub const fn words(&self) -> usize {
        self.blocks.words_from(self.region.start, self.blocks.count)
    }

    /// The index of the word at `offset` in an image of the region.
    #[must_use]
    pub const fn index(&self, offset: HostOffset) -> usize {
        offset.words_since(self.region.start)
    }
}

/// ASCII communication: a command line to PMAC, response lines from it.
#[derive(Debug, PartialEq, Eq)]
pub struct AsciiPort {
    /// A line is in the buffer. The host sets it, PMAC clears it when it has taken the line.
    pub command_loaded: Flag,
    /// Bits 7-0: a control character for PMAC, which clears the word.
    pub control_character: HostOffset,
    /// The command line.
    pub command: HostOffset,
    /// Bytes of its buffer, the NUL included.
    pub command_bytes: usize,
    /// Characters of the longest line that PMAC takes. A line that does not fit the buffer goes in two parts.
    pub line_limit: usize,
    /// Replies go by I3, and the enable forces I3, I4 and I6 (DPRAM manual p. 27); otherwise I3 has no effect here.
    pub goes_by_i3: bool,
    /// PMAC's mark in the response buffer: 0 nothing, else one of [`response`]'s values. The host writes 0.
    pub response_control: HostOffset,
    /// Characters in the response buffer, the NUL included.
    pub response_count: HostOffset,
    /// The response line, [`RESPONSE_BYTES`] bytes with the NUL.
    pub response: HostOffset,
}

impl AsciiPort {
    /// Whether any of `words` words from `first` on holds a command line or a response.
    #[must_use]
    pub const fn has_text_in(&self, first: HostOffset, words: usize) -> bool {
        let (start, end) = (first.bytes() as usize, first.bytes() as usize + 2 * words);
        let (command, response) = (self.command.bytes() as usize, self.response.bytes() as usize);
        (start < command + self.command_bytes && command < end)
            || (start < response + RESPONSE_BYTES && response < end)
    }
}

/// The size of the response buffer in bytes, the NUL included (DPRAM manual p. 29, Turbo User Manual p. 406).
pub const RESPONSE_BYTES: usize = 256;

/// Values of [`AsciiPort::response_control`].
pub mod response {
    /// A line of a reply; more follow.
    pub const LINE: u16 = 0x000D;
    /// The reply to a command a PMAC program issued (`CMD"..."`); no final acknowledge.
    pub const TO_PROGRAM: u16 = 0x010D;
    /// A message a PMAC program sent (`SEND"..."`); no final acknowledge.
    pub const MESSAGE: u16 = 0x020D;
    /// End of the reply.
    pub const ACKNOWLEDGE: u16 = 0x0006;
    /// The bit of an error; bits 11-0 are its number in three BCD digits.
    pub const ERROR: u16 = 1 << 15;
}

/// How the start word of a header gives a table's place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StartRule {
    /// A place.
    pub from: HostOffset,
    /// The start word of a table there; it grows by 1 a long.
    pub word: u16,
}

impl StartRule {
    /// The start word of a table at `offset`, which must not lie below [`StartRule::from`].
    #[must_use]
    pub const fn start_word(self, offset: HostOffset) -> u16 {
        self.word.wrapping_add((offset.words_since(self.from) / 2) as u16)
    }

    /// The place of the table with this start word; `None` for a place before [`StartRule::from`].
    #[must_use]
    pub const fn offset(self, word: u16) -> Option<HostOffset> {
        match word.checked_sub(self.word) {
            Some(longs) => Some(self.from.plus_words(2 * longs as usize)),
            None => None,
        }
    }
}

/// Opens the rotary buffers for binary lines only: the board executes an on-line line at once and answers any other
/// line with an error (Software Reference p. 271). An old board does not know the command; [`OPEN_TEXT`] lets binary
/// lines in there, too.
pub const OPEN_BINARY: &str = "OPEN BINARY ROTARY";
/// Opens the rotary buffers for text, and on a PMAC for binary lines (Software Reference p. 273).
pub const OPEN_TEXT: &str = "OPEN ROT";

/// The headers of the binary rotary buffers, the first buffer's first.
#[derive(Debug, PartialEq, Eq)]
pub struct RotaryHeaders {
    /// Where each header begins.
    pub headers: &'static [HostOffset],
    /// The first header belongs to coordinate system 1, and so on; otherwise each header names its system in a word.
    pub one_a_system: bool,
    /// The bit of the second word of `???` that says that [`OPEN_BINARY`] is in force.
    pub binary_open: u32,
    /// HOME and HOMEZ have a bit for each of the motors 1 to this one.
    pub home_motors: u16,
    /// Longs of the DPRAM for each buffer, unless the settings say otherwise.
    pub kept_longs: &'static [u32],
}

impl RotaryHeaders {
    /// The index of the header that takes a program for coordinate system `number`, from 1: its own, or the first.
    #[must_use]
    pub fn index_for(&self, number: usize) -> usize {
        if self.one_a_system { number.saturating_sub(1) } else { 0 }
    }
}

/// The places of the words of a rotary header, in 16-bit words from its start. The same in every family.
pub mod rotary_header {
    /// Bits 7-0 error code, [`BUSY`], [`ERROR`].
    pub const STATUS: usize = 0;
    /// The coordinate system the commands go to.
    pub const COORDINATE_SYSTEM: usize = 1;
    /// Where the host will write next, in longs from the buffer's start.
    pub const HOST_INDEX: usize = 2;
    /// Where PMAC will read next, in longs from the buffer's start.
    pub const PMAC_INDEX: usize = 3;
    /// The buffer's size in longs, even, at least 6.
    pub const SIZE: usize = 4;
    /// The buffer's place, by the [`super::StartRule`].
    pub const START: usize = 5;
    /// In a status word: the internal rotary buffer is full.
    pub const BUSY: u16 = 1 << 14;
    /// In a status word: error; bits 7-0 are its code.
    pub const ERROR: u16 = 1 << 15;
}

/// The control panel.
#[derive(Debug, PartialEq, Eq)]
pub struct PanelBlock {
    /// The whole function.
    pub region: Region,
    /// Which motors and coordinate systems a request is for; the host sets, PMAC clears all bits when it acts.
    pub request_enable: HostOffset,
    /// Which coordinate systems take their feed rate override from here; the host sets and clears.
    pub override_enable: HostOffset,
    /// Request word of number 1, followed by its override word (0-32767 in 1/32768 ms).
    pub request: HostOffset,
    /// Feed rate override of coordinate system 1.
    pub feed_override: HostOffset,
    /// 16-bit words from one number's words to the next one's.
    pub stride: usize,
    /// How many numbers there are, at most 16: the enable words have a bit each.
    pub numbers: usize,
    /// PMAC's register of coordinate system 1 for the time base that the panel's override sets; the next system's
    /// follows by the family's stride.
    pub time_base: PmacAddress,
}

/// Bits of a panel request word (DPRAM manual p. 12).
pub mod panel_request {
    /// Jog minus (motor). Together with [`JOG_PLUS`]: stop.
    pub const JOG_MINUS: u16 = 1 << 8;
    /// Jog plus (motor).
    pub const JOG_PLUS: u16 = 1 << 9;
    /// Return to the position before the jog, `J=` (motor).
    pub const PRE_JOG: u16 = 1 << 10;
    /// Run (coordinate system).
    pub const START: u16 = 1 << 11;
    /// Step, or quit while running (coordinate system).
    pub const STEP: u16 = 1 << 12;
    /// Abort (coordinate system).
    pub const STOP: u16 = 1 << 13;
    /// Home search (motor).
    pub const HOME: u16 = 1 << 14;
    /// Feed hold (coordinate system).
    pub const FEED_HOLD: u16 = 1 << 15;
}

/// The interrupt controller behind a board's host port.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Controller {
    /// An 8259, on a PMAC(1) for the ISA bus.
    Pic8259,
    /// A PMAC2's own circuit.
    Pmac2,
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

/// The numbers of the I-variables that govern the DPRAM's functions; `None` where a family has none.
#[derive(Debug, PartialEq, Eq)]
pub struct IVariables {
    /// Control panel enable.
    pub panel: Option<u16>,
    /// The one segmentation time; `None` where each coordinate system has its own: [`IVariables::segmentation`].
    pub segmentation: Option<u16>,
    /// Servo cycles between two servo reports.
    pub servo_period: u16,
    /// Servo report enable.
    pub servo_enable: u16,
    /// Background report enable.
    pub background_enable: u16,
    /// The highest motor and coordinate system in the servo and background reports.
    pub reported: Option<u16>,
    /// Servo cycles between two background reports; 0 is on request. `None`: always on request.
    pub background_period: Option<u16>,
    /// The base of the one DPRAM that serves all functions, on a board with several. `None`: the board has one.
    pub dpram_base: Option<u16>,
    /// If 1, PMAC makes the servo report in the background, and [`IVariables::servo_enable`] has no effect.
    pub servo_in_background: Option<u16>,
    /// Enable of both variable tables.
    pub variables_enable: u16,
    /// Interrupt for a response in the DPRAM.
    pub interrupt: u16,
    /// Binary rotary transfer enable.
    pub rotary_enable: Option<u16>,
    /// ASCII communication enable.
    pub ascii_enable: u16,
    /// Servo cycles between two gathered samples.
    pub gather_period: u16,
    /// Where gathering stores: 2 in the DPRAM until it is full, 3 in the DPRAM round and round.
    pub gather_mode: u16,
    /// Which sources are gathered, 24 bits each.
    pub gather_masks: &'static [u16],
    /// The first source's address; the others follow.
    pub gather_sources: u16,
    /// Ix93 of coordinate system 1: the address of its time base. The next one's number is 100 higher.
    pub time_base: u16,
}

/// Bits of a mask of gather sources, a word of PMAC's.
const GATHER_MASK_BITS: usize = 24;

impl IVariables {
    /// Ix07, Ix08, Ix09 and Ix60: the scales of a motor's master position, positions and velocities, and by how many
    /// servo cycles the motor's own cycle is longer.
    pub const SCALES: [usize; 4] = [7, 8, 9, 60];

    /// Variable `which` (0-99) of `motor` (from 1): Ix08 of motor 3 is 308.
    #[must_use]
    pub const fn motor(motor: usize, which: usize) -> usize {
        100 * motor + which
    }

    /// Sources that one gather takes at most: a bit of a mask each.
    #[must_use]
    pub const fn most_gather_sources(&self) -> usize {
        GATHER_MASK_BITS * self.gather_masks.len()
    }

    /// Longs of the longest sample: every source may have two.
    #[must_use]
    pub const fn longest_gather_sample(&self) -> u32 {
        2 * self.most_gather_sources() as u32
    }

    /// The I-variables and values that select the gather sources of these codes, the masks first.
    pub fn gather_settings(&self, codes: &[u32]) -> impl Iterator<Item = (u16, u32)> {
        let selected = |mask: usize| {
            let count = codes.len().saturating_sub(GATHER_MASK_BITS * mask).min(GATHER_MASK_BITS);
            (1_u32 << count) - 1
        };
        let masks = self.gather_masks.iter().enumerate().map(move |(mask, number)| (*number, selected(mask)));
        masks.chain((self.gather_sources..).zip(codes.iter().copied()))
    }

    /// Ix93 of coordinate system `number`, from 1.
    #[must_use]
    pub const fn time_base(&self, number: usize) -> usize {
        self.time_base as usize + 100 * number.saturating_sub(1)
    }

    /// The segmentation time of coordinate system `number`, from 1: I13, on Turbo boards Isx13.
    #[must_use]
    pub fn segmentation(&self, number: usize) -> usize {
        self.segmentation.map_or_else(|| self.time_base(number) - 93 + 13, usize::from)
    }

    /// Whether I-variable `number` is a countdown timer, Isx11 or Isx12, which a board changes each servo cycle (Turbo Software
    /// Reference p. 176). PMAC has no variables of these numbers.
    #[must_use]
    pub const fn is_timer(number: u16) -> bool {
        5100 <= number && number < 6700 && matches!(number % 100, 11 | 12)
    }
}
