//! Turbo PMAC and Turbo PMAC2: the DPRAM at $060000, every address, bit and length.
//!
//! The addresses stand only here; the descriptors below and the register table (`turbo_table`) are built from them. TUM
//! is the Turbo PMAC User Manual, TSRM the Turbo Software Reference. A line says so if its only source is a public
//! driver or header, or if the value is PMAC's for want of a text.

use crate::map::functions::{
    AsciiPort, BackgroundBlock, Blocks, BusyRule, Flag, GlobalStatus, IVariables, ReportStart, RotaryHeaders,
    Run, ServoBlock, StartRule, Timer, VariableRead, VariableWrite,
};
use crate::map::{Function, GatherPlace, HostOffset, NumberKind, PmacAddress, Region, Space};

/// The PMAC address of the first DPRAM location (TUM p. 402).
pub const BASE: u32 = 0x06_0000;
/// 8K x 16 bits, the option of Turbo PMAC boards (TUM p. 397), in bytes.
pub const LENGTH_8K: u32 = 0x4000;
/// 32K x 16 bits, the option of Turbo PMAC2, UMAC and QMAC boards (TUM p. 397), in bytes.
pub const LENGTH_32K: u32 = 0x1_0000;
/// No text says where the gate arrays begin. Everything below this is memory: the motors' and coordinate systems'
/// registers (TSRM p. 284-290) and more.
pub const MEMORY_END: u32 = 0x1_0000;
/// Motors (TUM p. 403: a mask of 32 bits).
pub const MOTORS: usize = 32;
/// Coordinate systems (TUM p. 405).
pub const SYSTEMS: usize = 16;
/// PMAC addresses from one motor's registers to the next one's (the vendor's suggested M-variables).
pub const MOTOR_SOURCE_STRIDE: u32 = 0x80;
/// PMAC addresses from one coordinate system's registers to the next one's (the same; TSRM p. 287 misprints $80).
pub const SYSTEM_SOURCE_STRIDE: u32 = 0x100;
/// Motor 1's commanded position (the vendor's suggested M-variable M161).
pub const COMMANDED_POSITION: PmacAddress = PmacAddress::new(Space::D, 0x88);

const fn at(bytes: u32) -> HostOffset {
    HostOffset::new(bytes)
}

// ---- control panel (the vendor's header; TUM calls the function pending, and no text says how to switch it on) ----

/// Which motors and coordinate systems a panel request is for.
pub const PANEL_REQUEST_ENABLE: HostOffset = at(0x0000);
/// Which coordinate systems take their feed rate override from here.
pub const PANEL_OVERRIDE_ENABLE: HostOffset = at(0x0002);
/// Request word of motor or coordinate system 1; the next lie [`PANEL_STRIDE`] bytes on.
pub const PANEL_REQUEST: HostOffset = at(0x0004);
/// Feed rate override of coordinate system 1; the next lie [`PANEL_STRIDE`] bytes on.
pub const PANEL_OVERRIDE: HostOffset = at(0x0006);
/// Bytes from one panel word to that of the next number.
pub const PANEL_STRIDE: u32 = 4;
/// How many numbers have panel words.
pub const PANEL_NUMBERS: usize = 8;
/// $060009-$060019, without a documented use.
pub const PANEL_RESERVED: HostOffset = at(0x0024);
/// The reserved words' bytes.
pub const PANEL_RESERVED_LENGTH: u32 = 68;

// ---- motor report (TUM p. 402-403) ----

/// A word without a documented use.
pub const SERVO_SPARE: HostOffset = at(0x0068);
/// Bit 15 is [`HOST_BUSY`]; the host's word.
pub const SERVO_HOST_STATUS: HostOffset = at(0x006A);
/// The low 16 bits of the servo timer.
pub const SERVO_TIMER: HostOffset = at(0x006C);
/// Bits 7-0 are bits 23-16 of the servo timer, bit 15 is [`DATA_READY`].
pub const SERVO_PMAC_STATUS: HostOffset = at(0x006E);
/// Which motors PMAC copies: a long, bit 0 for motor 1; the host writes it.
pub const SERVO_MASK: HostOffset = at(0x0070);
/// The block of motor 1; those of the others follow without a gap.
pub const SERVO_MOTOR: HostOffset = at(0x0074);
/// Bytes from one motor's block to the next, which is also a block's length.
pub const SERVO_MOTOR_STRIDE: u32 = 0x30;

/// In a report's host word: the host is reading, PMAC leaves the report alone.
pub const HOST_BUSY: u16 = 1 << 15;
/// In a report's PMAC word: clear while PMAC writes, set when the data are whole.
pub const DATA_READY: u16 = 1 << 15;
/// How many bits of a report's PMAC word belong to the timer.
pub const TIMER_HIGH_BITS: u32 = 8;

/// Where a motor's data lie, in 16-bit words from the start of its block.
pub mod servo_motor {
    /// Following error, fixed 48, 1/(Ix08*32) count.
    pub const FOLLOWING_ERROR: usize = 0;
    /// Previous output, signed 24, 1/256 of a DAC bit.
    pub const PREVIOUS_DAC: usize = 4;
    /// The first word of `?`, 24 bits.
    pub const SERVO_STATUS: usize = 6;
    /// In the high word of the servo status (bit 18 there): the loop is open.
    pub const OPEN_LOOP: u16 = 1 << 2;
    /// In the high word (bit 23): the motor is activated.
    pub const ACTIVATED: u16 = 1 << 7;
    /// In the low word (bit 13): the desired velocity is zero.
    pub const DESIRED_VELOCITY_ZERO: u16 = 1 << 13;
    /// The second word of `?`, 24 bits.
    pub const BACKGROUND_STATUS: usize = 8;
    /// Position bias, fixed 48, 1/(Ix08*32) count.
    pub const POSITION_BIAS: usize = 10;
    /// Actual velocity, averaged, signed 24.
    pub const FILTERED_VELOCITY: usize = 14;
    /// Two longs without a documented use.
    pub const SPARE: usize = 16;
    /// Actual position, fixed 48, 1/(Ix08*32) count.
    pub const ACTUAL_POSITION: usize = 20;
}

// ---- background report (TUM p. 405) ----

/// Bits 7-0: how many coordinate systems PMAC reports, from 1; the host writes it.
pub const BACKGROUND_COUNT: HostOffset = at(0x0674);
/// Bit 15 is [`HOST_BUSY`]; the host's word.
pub const BACKGROUND_HOST_STATUS: HostOffset = at(0x0676);
/// The low 16 bits of the servo timer.
pub const BACKGROUND_TIMER: HostOffset = at(0x0678);
/// Bits 7-0 are bits 23-16 of the servo timer, bit 15 is [`DATA_READY`].
pub const BACKGROUND_PMAC_STATUS: HostOffset = at(0x067A);
/// The control panel port (JPAN), a long.
pub const BACKGROUND_PANEL_PORT: HostOffset = at(0x067C);
/// The machine input/output port (JOPTO), a long; on PMAC it follows the thumbwheel port.
pub const BACKGROUND_MACHINE_PORT: HostOffset = at(0x0680);
/// The thumbwheel port (JTHW), a long.
pub const BACKGROUND_THUMBWHEEL_PORT: HostOffset = at(0x0684);
/// Copy of Y:$000006, the second word of `???`; a long.
pub const BACKGROUND_GLOBAL_STATUS_Y: HostOffset = at(0x0688);
/// Copy of X:$000006, the first word of `???`; a long.
pub const BACKGROUND_GLOBAL_STATUS_X: HostOffset = at(0x068C);
/// The copies of the global status.
const GLOBAL_STATUS: GlobalStatus = GlobalStatus {
    longs: [BACKGROUND_GLOBAL_STATUS_X, BACKGROUND_GLOBAL_STATUS_Y],
    // Y:$000006, bits 19 to 17 (TSRM p. 290): a motion, rotary or PLC buffer is open. Bit 20 lets no text in.
    program_buffer_open: 0b111 << 17,
    gathering: 1 << 19,
};
/// Three longs without a documented use.
pub const BACKGROUND_GLOBAL_SPARE: HostOffset = at(0x0690);
/// The block of coordinate system 1; the others follow without a gap.
pub const BACKGROUND_SYSTEM: HostOffset = at(0x069C);
/// Bytes from one coordinate system's block to the next, which is also a block's length.
pub const BACKGROUND_SYSTEM_STRIDE: u32 = 0x80;

/// Where a coordinate system's data lie, in 16-bit words from the start of its block.
pub mod system {
    /// Feed rate or move time, float 48.
    pub const FEEDRATE_OR_TIME: usize = 0;
    /// Present time base, signed 24.
    pub const FEEDPOT: usize = 4;
    /// Address of the time base's register, with feed hold in bit 22.
    pub const FEEDPOT_POINTER: usize = 6;
    /// The third word of `??`, 24 bits.
    pub const STATUS_3: usize = 8;
    /// The first word of `??`, 24 bits.
    pub const STATUS_1: usize = 10;
    /// In the low word of the first word of `??` (bit 0 there): a motion program runs.
    pub const PROGRAM_RUNS: u16 = 1 << 0;
    /// Nine axis targets A B C U V W X Y Z, float 48, user units.
    pub const AXIS_TARGETS: usize = 12;
    /// The second word of `??` (PSTATUS), 24 bits.
    pub const PROGRAM_STATUS: usize = 48;
    /// Program lines remaining, signed 24, as `PR`.
    pub const LINES_REMAINING: usize = 50;
    /// Time left in the move segment, signed 24.
    pub const TIME_LEFT_IN_MOVE: usize = 52;
    /// Time left in acceleration or deceleration, signed 24.
    pub const TIME_LEFT_IN_ACCELERATION: usize = 54;
    /// Program execution address offset, unsigned 24, as `PE`.
    pub const ADDRESS_OFFSET: usize = 56;
    /// Three longs without a documented use.
    pub const SPARE: usize = 58;
}

// ---- ASCII communication (TUM p. 405-407) ----

/// Bit 0 is [`COMMAND_LOADED`].
pub const ASCII_OUTPUT_CONTROL: HostOffset = at(0x0E9C);
/// Bits 7-0: a control character for PMAC, which clears it.
pub const ASCII_CONTROL_CHARACTER: HostOffset = at(0x0E9E);
/// The command line, [`ASCII_COMMAND_BYTES`] bytes with the NUL.
pub const ASCII_COMMAND: HostOffset = at(0x0EA0);
/// The buffer's size.
pub const ASCII_COMMAND_BYTES: usize = 160;
/// Characters of the longest line PMAC takes, sent in two parts. PMAC's value: no Turbo text gives it.
pub const ASCII_LINE_LIMIT: usize = 200;
/// PMAC's mark in the response buffer: 0, or a value of [`crate::map::functions::response`]. The host writes 0.
pub const ASCII_INPUT_CONTROL: HostOffset = at(0x0F40);
/// Characters in the response buffer, the NUL included.
pub const ASCII_INPUT_COUNT: HostOffset = at(0x0F42);
/// The response line, [`ASCII_RESPONSE_BYTES`] bytes with the NUL.
pub const ASCII_RESPONSE: HostOffset = at(0x0F44);
/// The response buffer's size.
pub const ASCII_RESPONSE_BYTES: u32 = 256;
/// In [`ASCII_OUTPUT_CONTROL`]: a line lies in the buffer. The host sets it, PMAC clears it when it takes the line.
pub const COMMAND_LOADED: u16 = 1 << 0;

// ---- background variables (TUM p. 407-410) ----

/// Bit 0 says ready in single-user mode, bit 8 is [`VARIABLE_READ_MULTI_USER`].
pub const VARIABLE_READ_CONTROL: HostOffset = at(0x1044);
/// The low 16 bits of the servo counter at the update.
pub const VARIABLE_READ_TIMER: HostOffset = at(0x1046);
/// Entries to read, 1-128; 0 stops the function.
pub const VARIABLE_READ_COUNT: HostOffset = at(0x1048);
/// The table's place, from [`USER_START`], in longs.
pub const VARIABLE_READ_START: HostOffset = at(0x104A);
/// In [`VARIABLE_READ_CONTROL`]: the data are ready (single-user mode).
pub const VARIABLE_READ_READY: u16 = 1 << 0;
/// In [`VARIABLE_READ_CONTROL`]: every entry has its own ready bit.
pub const VARIABLE_READ_MULTI_USER: u16 = 1 << 8;
/// Records to write, 1-32. The host sets it; PMAC writes 0 after the writes.
pub const VARIABLE_WRITE_COUNT: HostOffset = at(0x104C);
/// Where the records lie, from [`USER_START`], in longs.
pub const VARIABLE_WRITE_START: HostOffset = at(0x104E);

// ---- binary rotary headers (the vendor's header; that they follow each other without a gap is worked out) ----

/// Header of coordinate system 1's buffer; those of the others follow without a gap.
pub const ROTARY: HostOffset = at(0x1050);
/// Bytes from one header to the next.
pub const ROTARY_STRIDE: u32 = 12;
/// $060444-$06044E, without a documented use.
pub const UNASSIGNED: HostOffset = at(0x1110);
/// The unassigned words' bytes.
pub const UNASSIGNED_LENGTH: u32 = 44;

// ---- gathering (the vendor's accessory pages) ----

/// Size of the gather buffer in longs, set by `DEFINE GATHER`.
pub const GATHER_SIZE: HostOffset = at(0x113C);
/// Where PMAC stores next, in longs from the buffer's start.
pub const GATHER_INDEX: HostOffset = at(0x113E);
/// Room for the buffers of variable size, the gather buffer at its start.
pub const USER_START: HostOffset = at(0x1140);

// ---- regions ----

const PANEL: Region = Region::new("panel", PANEL_REQUEST_ENABLE, SERVO_SPARE);
const SERVO: Region = Region::new("servo", SERVO_SPARE, BACKGROUND_COUNT);
const BACKGROUND: Region = Region::new("background", BACKGROUND_COUNT, ASCII_OUTPUT_CONTROL);
const ASCII_OUTPUT: Region = Region::new("ascii_output", ASCII_OUTPUT_CONTROL, ASCII_INPUT_CONTROL);
const ASCII_INPUT: Region = Region::new("ascii_input", ASCII_INPUT_CONTROL, VARIABLE_READ_CONTROL);
const POINTERS: Region = Region::new("pointers", VARIABLE_READ_CONTROL, USER_START);
/// Room for buffers and free use where the DPRAM has 8K x 16 bits.
pub const USER_AREA_8K: Region = Region::new("user", USER_START, at(LENGTH_8K));
/// The same with 32K x 16 bits.
pub const USER_AREA_32K: Region = Region::new("user", USER_START, at(LENGTH_32K));
/// The whole DPRAM of 8K x 16 bits.
pub const REGIONS_8K: &[Region] =
    &[PANEL, SERVO, BACKGROUND, ASCII_OUTPUT, ASCII_INPUT, POINTERS, USER_AREA_8K];
/// The whole DPRAM of 32K x 16 bits.
pub const REGIONS_32K: &[Region] =
    &[PANEL, SERVO, BACKGROUND, ASCII_OUTPUT, ASCII_INPUT, POINTERS, USER_AREA_32K];

// ---- descriptors ----

const fn status_flag(word: usize, mask: u16) -> Flag {
    Flag { word: SERVO_MOTOR.plus_words(servo_motor::SERVO_STATUS + word), mask }
}

/// The motor report. The words of `???` are in the background report.
pub const SERVO_BLOCK: ServoBlock = ServoBlock {
    region: SERVO,
    start: ReportStart::Enable,
    host_busy: Flag { word: SERVO_HOST_STATUS, mask: HOST_BUSY },
    pmac_status: Flag { word: SERVO_PMAC_STATUS, mask: DATA_READY },
    busy: BusyRule::ClearWhileWriting,
    timer: Timer { low: SERVO_TIMER, low_bits: 16, high: Some((SERVO_PMAC_STATUS, TIMER_HIGH_BITS)) },
    mask: Some(SERVO_MASK),
    global: Run { first: SERVO_MOTOR, words: 0 },
    global_status: None,
    open_loop: status_flag(1, servo_motor::OPEN_LOOP),
    activated: status_flag(1, servo_motor::ACTIVATED),
    standing: status_flag(0, servo_motor::DESIRED_VELOCITY_ZERO),
    motors: Blocks { count: MOTORS, first: SERVO_MOTOR, words: SERVO_MOTOR_STRIDE as usize / 2 },
};

/// The background report.
pub const BACKGROUND_REPORT: BackgroundBlock = BackgroundBlock {
    region: BACKGROUND,
    ready: Flag { word: BACKGROUND_PMAC_STATUS, mask: DATA_READY },
    host_busy: Some(Flag { word: BACKGROUND_HOST_STATUS, mask: HOST_BUSY }),
    count: Some(BACKGROUND_COUNT),
    timer: Timer {
        low: BACKGROUND_TIMER,
        low_bits: 16,
        high: Some((BACKGROUND_PMAC_STATUS, TIMER_HIGH_BITS)),
    },
    global: Run { first: BACKGROUND_PANEL_PORT, words: 10 },
    ports: [BACKGROUND_PANEL_PORT, BACKGROUND_THUMBWHEEL_PORT, BACKGROUND_MACHINE_PORT],
    global_status: Some(GLOBAL_STATUS),
    amplifier_enabled: None,
    program_runs: Flag { word: BACKGROUND_SYSTEM.plus_words(system::STATUS_1), mask: system::PROGRAM_RUNS },
    numbers: NumberKind::CoordinateSystem,
    blocks: Blocks { count: SYSTEMS, first: BACKGROUND_SYSTEM, words: BACKGROUND_SYSTEM_STRIDE as usize / 2 },
};

/// ASCII communication.
pub const ASCII: AsciiPort = AsciiPort {
    command_loaded: Flag { word: ASCII_OUTPUT_CONTROL, mask: COMMAND_LOADED },
    control_character: ASCII_CONTROL_CHARACTER,
    command: ASCII_COMMAND,
    command_bytes: ASCII_COMMAND_BYTES,
    line_limit: ASCII_LINE_LIMIT,
    // TSRM p. 37.
    goes_by_i3: false,
    response_control: ASCII_INPUT_CONTROL,
    response_count: ASCII_INPUT_COUNT,
    response: ASCII_RESPONSE,
};

/// The start words of tables count from $060450 (TUM p. 410; a driver in production writes $F0 for $060540).
pub const START: StartRule = StartRule { from: USER_START, word: 0 };

/// Background variable read: the kind in bits 5-4 of the X word (a driver in production). TUM p. 410 also puts address
/// bits 18-16 into this word, without bit numbers.
pub const VARIABLE_READ: VariableRead = VariableRead {
    ready: Flag { word: VARIABLE_READ_CONTROL, mask: VARIABLE_READ_READY },
    multi_user: Flag { word: VARIABLE_READ_CONTROL, mask: VARIABLE_READ_MULTI_USER },
    timer: VARIABLE_READ_TIMER,
    count: VARIABLE_READ_COUNT,
    start: VARIABLE_READ_START,
    kind_bit: 4,
};

/// Background variable write. TUM p. 410 says that the type word holds kind, width, offset and the high address bits,
/// but gives no bit numbers.
pub const VARIABLE_WRITE: VariableWrite =
    VariableWrite { count: VARIABLE_WRITE_COUNT, start: VARIABLE_WRITE_START, since: None };

const HEADERS: [HostOffset; SYSTEMS] = {
    let mut headers = [ROTARY; SYSTEMS];
    let mut index = 0;
    while index < SYSTEMS {
        headers[index] = ROTARY.plus_words(index * ROTARY_STRIDE as usize / 2);
        index += 1;
    }
    headers
};

/// The binary rotary buffers, one a coordinate system, each with `kept_longs` unless the settings say otherwise. `???`
/// has a bit for binary and one for text entry (TSRM p. 290). No text describes command words that differ from PMAC's;
/// a word has a bit for 24 motors, so HOME can name no other.
const fn rotary_buffers(kept_longs: &'static [u32]) -> RotaryHeaders {
    RotaryHeaders { headers: &HEADERS, one_a_system: true, binary_open: 1 << 20, home_motors: 24, kept_longs }
}

/// The binary rotary buffers where the DPRAM has 8K x 16 bits.
pub const ROTARY_BUFFERS_8K: RotaryHeaders = rotary_buffers(&[0x40; SYSTEMS]);
/// The same with 32K x 16 bits.
pub const ROTARY_BUFFERS_32K: RotaryHeaders = rotary_buffers(&[0x200; SYSTEMS]);

/// Data gathering.
pub const GATHER: GatherPlace = GatherPlace { size: GATHER_SIZE, index: GATHER_INDEX, buffer: USER_START };

/// The functions that `pmacd` uses on these boards.
pub const FUNCTIONS: &[Function] = &[
    Function::Ascii,
    Function::Servo,
    Function::Background,
    Function::Variables,
    Function::Rotary,
    Function::Gather,
];

/// The I-variables of the functions (TUM p. 400-410; gathering TSRM p. 170-171). No known variable enables the control
/// panel or the transfer of rotary buffers.
pub const I_VARIABLES: IVariables = IVariables {
    panel: None,
    segmentation: None,
    servo_period: 47,
    servo_enable: 48,
    background_enable: 49,
    reported: None,
    background_period: Some(50),
    dpram_base: Some(24),
    servo_in_background: Some(57),
    variables_enable: 55,
    interrupt: 56,
    rotary_enable: None,
    ascii_enable: 58,
    gather_period: 5049,
    gather_mode: 5000,
    gather_masks: &[5050, 5051],
    gather_sources: 5001,
    time_base: 5193,
};
