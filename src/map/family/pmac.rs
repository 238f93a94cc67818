//! PMAC and PMAC2: the DPRAM at $D000-$DFFF, every address, bit and length.
//!
//! The addresses stand only here; the descriptors below and the register table (`pmac_table`) are built from them.
//! Manual pages are those of the DPRAM manual of June 2004; where it misprints an address (the variable-write header,
//! the gather index, the ASCII start-up text), the value follows the address rule.

use crate::map::functions::{
    AsciiPort, BackgroundBlock, Blocks, BusyRule, Flag, GlobalStatus, IVariables, PanelBlock, ReportStart,
    RotaryHeaders, Run, ServoBlock, StartRule, Timer, VariableRead, VariableWrite,
};
use crate::map::{Firmware, GatherPlace, HostOffset, NumberKind, PmacAddress, Region, Space};

/// The PMAC address of the first DPRAM location.
pub const BASE: u32 = 0xD000;
/// The DPRAM's size in bytes: 8K x 16 bits.
pub const LENGTH: u32 = 0x4000;
/// Where the gate arrays begin, as `X:$C000`.
pub const MEMORY_END: u32 = 0xC000;
/// Motors, and coordinate systems, that the fixed buffers have room for.
pub const MOTORS: usize = 8;

const fn at(bytes: u32) -> HostOffset {
    HostOffset::new(bytes)
}

// ---- control panel (p. 12-13) ----

/// Which motors and coordinate systems a panel request is for; the host sets, PMAC clears all bits when it acts.
pub const PANEL_REQUEST_ENABLE: HostOffset = at(0x0000);
/// Which coordinate systems take their feed rate override from here; the host sets and clears.
pub const PANEL_OVERRIDE_ENABLE: HostOffset = at(0x0002);
/// Request word of motor or coordinate system 1; the next lie [`PANEL_STRIDE`] bytes on.
pub const PANEL_REQUEST: HostOffset = at(0x0004);
/// Feed rate override of coordinate system 1, 0-32767 in 1/32768 ms; the next lie [`PANEL_STRIDE`] bytes on.
pub const PANEL_OVERRIDE: HostOffset = at(0x0006);
/// Bytes from one panel word to that of the next number.
pub const PANEL_STRIDE: u32 = 4;

// ---- servo fixed data (p. 14-17) ----

/// Bit 0 is [`HOST_BUSY`]; the host's word.
pub const SERVO_HOST_STATUS: HostOffset = at(0x0024);
/// Bits 14-0 are the servo timer, bit 15 is [`PMAC_BUSY`]; PMAC's word.
pub const SERVO_PMAC_STATUS: HostOffset = at(0x0026);
/// Copy of Y:$0003, the second word of `???` (Software Reference; the DPRAM manual calls it the first); a long.
pub const SERVO_GLOBAL_STATUS_Y: HostOffset = at(0x0028);
/// Copy of X:$0003, the first word of `???`; a long.
pub const SERVO_GLOBAL_STATUS_X: HostOffset = at(0x002C);
/// Six longs without a documented use.
pub const SERVO_GLOBAL_SPARE: HostOffset = at(0x0030);
/// The block of motor 1; those of the others follow without a gap.
pub const SERVO_MOTOR: HostOffset = at(0x0048);
/// Bytes from one motor's servo block to the next, which is also a block's length.
pub const SERVO_MOTOR_STRIDE: u32 = 0x3C;
/// 16-bit words in a motor's servo block.
pub const SERVO_MOTOR_WORDS: usize = SERVO_MOTOR_STRIDE as usize / 2;

/// The copies of the global status. The bits are those of the Software Reference, `???`.
const GLOBAL_STATUS: GlobalStatus = GlobalStatus {
    longs: [SERVO_GLOBAL_STATUS_X, SERVO_GLOBAL_STATUS_Y],
    // Y:$0003, bits 19, 18 and 17: a motion, rotary or PLC buffer is open.
    program_buffer_open: 0b111 << 17,
    gathering: 1 << 19,
};
/// Where PMAC keeps the time base of coordinate system `number` (1 to 8) that the panel's override sets; the default of
/// its Ix93.
#[must_use]
pub const fn override_register(number: usize) -> u32 {
    0x0806 + 0xC0 * (number as u32).saturating_sub(1)
}
/// In [`SERVO_HOST_STATUS`]: the host is reading, PMAC leaves the buffer alone.
pub const HOST_BUSY: u16 = 1 << 0;
/// In [`SERVO_PMAC_STATUS`]: PMAC is updating the buffer.
pub const PMAC_BUSY: u16 = 1 << 15;
/// In [`SERVO_PMAC_STATUS`]: the low 15 bits of the servo counter at the update.
pub const SERVO_TIMER_MASK: u16 = 0x7FFF;

/// Where a motor's servo data lie, in 16-bit words from the start of its block.
pub mod servo_motor {
    /// Commanded position, fixed 48, 1/(Ix08*32) count.
    pub const COMMANDED_POSITION: usize = 0;
    /// Actual position, fixed 48, 1/(Ix08*32) count.
    pub const ACTUAL_POSITION: usize = 4;
    /// Master (followed) position, fixed 48, 1/(Ix07*32) count of the master.
    pub const MASTER_POSITION: usize = 8;
    /// Compensation position, fixed 48, 1/(Ix08*32) count.
    pub const COMPENSATION_POSITION: usize = 12;
    /// Previous output, signed 24, 1/256 of a DAC bit.
    pub const PREVIOUS_DAC: usize = 16;
    /// Servo status, the first word of `?`, 24 bits.
    pub const SERVO_STATUS: usize = 18;
    /// In the high word of the servo status (bit 18 there): the loop is open.
    pub const OPEN_LOOP: u16 = 1 << 2;
    /// In the high word (bit 23): the motor is activated.
    pub const ACTIVATED: u16 = 1 << 7;
    /// In the low word (bit 13): the desired velocity is zero.
    pub const DESIRED_VELOCITY_ZERO: u16 = 1 << 13;
    /// Actual velocity, signed 24, 1/(Ix09*32) count per servo cycle.
    pub const ACTUAL_VELOCITY: usize = 20;
    /// Time left in the move segment at 100 %, signed 24, half milliseconds.
    pub const TIME_LEFT: usize = 22;
    /// A PMAC address, 24 bits; see the register table about its doubtful source.
    pub const HANDWHEEL_POINTER: usize = 24;
    /// Two longs without a documented use.
    pub const SPARE: usize = 26;
}

// ---- background fixed data (p. 17-21) ----

/// Bit 0 is [`DATA_READY`].
pub const BACKGROUND_DATA_READY: HostOffset = at(0x0228);
/// The low 16 bits of the servo counter when the data became ready.
pub const BACKGROUND_SERVO_TIMER: HostOffset = at(0x022A);
/// The control panel port (JPAN), a long from Y:$FFC0.
pub const BACKGROUND_PANEL_PORT: HostOffset = at(0x022C);
/// The thumbwheel port (JTHW), a long from Y:$FFC1.
pub const BACKGROUND_THUMBWHEEL_PORT: HostOffset = at(0x0230);
/// The machine input/output port (JOPTO), a long from Y:$FFC2.
pub const BACKGROUND_MACHINE_PORT: HostOffset = at(0x0234);
/// Five longs without a documented use.
pub const BACKGROUND_GLOBAL_SPARE: HostOffset = at(0x0238);
/// The block of motor and coordinate system 1; the others follow without a gap.
pub const BACKGROUND_BLOCK: HostOffset = at(0x024C);
/// Bytes from one background block to the next, which is also a block's length.
pub const BACKGROUND_BLOCK_STRIDE: u32 = 0x7C;
/// 16-bit words in a background block.
pub const BACKGROUND_BLOCK_WORDS: usize = BACKGROUND_BLOCK_STRIDE as usize / 2;

/// In [`BACKGROUND_DATA_READY`] and, in single-user mode, in [`VARIABLE_READ_CONTROL`]: PMAC sets it after an update,
/// the host clears it to ask for another.
pub const DATA_READY: u16 = 1 << 0;

/// Where the background data of a number lie, in 16-bit words from the start of its block.
pub mod background_block {
    /// Motor: target position, fixed 48, 1/(Ix08*32) count.
    pub const TARGET_POSITION: usize = 0;
    /// Motor: position bias, fixed 48, 1/(Ix08*32) count.
    pub const POSITION_BIAS: usize = 4;
    /// Motor: background status, the second word of `?`, 24 bits.
    pub const MOTOR_STATUS: usize = 8;
    /// In the low word of the background status (bit 14 there): the amplifier is enabled. A killed motor's is not.
    pub const AMPLIFIER_ENABLED: u16 = 1 << 14;
    /// Coordinate system: motor definition word, 24 bits.
    pub const MOTOR_DEFINITION: usize = 10;
    /// Coordinate system: status, the first word of `??`, 24 bits.
    pub const STATUS: usize = 12;
    /// In the low word of the coordinate system's status (bit 0 there): a motion program runs.
    pub const PROGRAM_RUNS: u16 = 1 << 0;
    /// Coordinate system: nine axis targets A B C U V W X Y Z, float 48, user units.
    pub const AXIS_TARGETS: usize = 14;
    /// Coordinate system: program status (PSTATUS), the second word of `??`, 24 bits.
    pub const PROGRAM_STATUS: usize = 50;
    /// Coordinate system: program lines remaining, signed 24, as `PR`.
    pub const LINES_REMAINING: usize = 52;
    /// Coordinate system: time left in the move, signed 24, half milliseconds.
    pub const TIME_LEFT_IN_MOVE: usize = 54;
    /// Coordinate system: time left in acceleration or deceleration, signed 24, half milliseconds.
    pub const TIME_LEFT_IN_ACCELERATION: usize = 56;
    /// Coordinate system: program execution address offset, unsigned 24, as `PE`.
    pub const ADDRESS_OFFSET: usize = 58;
    /// Motor: averaged actual velocity, signed 24, 1/(Ix09*32) count per servo cycle.
    pub const AVERAGE_VELOCITY: usize = 60;
}

// ---- ASCII communication (p. 27-29) ----

/// Bit 0 is [`COMMAND_LOADED`].
pub const ASCII_OUTPUT_CONTROL: HostOffset = at(0x062C);
/// Bits 7-0: a control character for PMAC, which clears it (firmware 1.15 and later).
pub const ASCII_CONTROL_CHARACTER: HostOffset = at(0x062E);
/// The command line, [`ASCII_COMMAND_BYTES`] bytes with the NUL.
pub const ASCII_COMMAND: HostOffset = at(0x0630);
/// The buffer's size. A line of one byte less is complete and ends with a NUL in the last byte, 0x06CF.
pub const ASCII_COMMAND_BYTES: usize = 160;
/// Characters of the longest line PMAC takes, sent in two parts.
pub const ASCII_LINE_LIMIT: usize = 200;
/// PMAC's mark in the response buffer: 0, or a value of [`crate::map::functions::response`]. The host writes 0.
pub const ASCII_INPUT_CONTROL: HostOffset = at(0x06D0);
/// Characters in the response buffer, the NUL included.
pub const ASCII_INPUT_COUNT: HostOffset = at(0x06D2);
/// The response line, [`ASCII_RESPONSE_BYTES`] bytes with the NUL. The host clears the first word when it has read it.
pub const ASCII_RESPONSE: HostOffset = at(0x06D4);
/// The response buffer's size.
pub const ASCII_RESPONSE_BYTES: usize = 256;

/// In [`ASCII_OUTPUT_CONTROL`]: a line lies in the buffer. The host sets it, PMAC clears it when it takes the line.
pub const COMMAND_LOADED: u16 = 1 << 0;
// ---- background variable write (p. 24-25) ----

/// Records to write, 1-32. The host sets it; PMAC writes 0 after the writes. Misprinted as 0x07E6.
pub const VARIABLE_WRITE_COUNT: HostOffset = at(0x07D4);
/// PMAC address of the first record, $D200-$DFFD. Misprinted as 0x07E8.
pub const VARIABLE_WRITE_START: HostOffset = at(0x07D6);

/// The long between the buffers' headers that no text describes.
pub const UNKNOWN_D1F6: HostOffset = at(0x07D8);

// ---- binary rotary headers (p. 30; the second is not in the manual) ----

/// Header of the first binary rotary buffer.
pub const ROTARY_1: HostOffset = at(0x07F0);
/// Header of the second binary rotary buffer.
pub const ROTARY_2: HostOffset = at(0x07DC);

// ---- background variable read (p. 21-24) ----

/// Bit 0 is [`DATA_READY`] in single-user mode, bit 8 is [`VARIABLE_READ_MULTI_USER`].
pub const VARIABLE_READ_CONTROL: HostOffset = at(0x07E8);
/// The low 16 bits of the servo counter at the update.
pub const VARIABLE_READ_SERVO_TIMER: HostOffset = at(0x07EA);
/// Entries to read, 1-128; 0 stops the function.
pub const VARIABLE_READ_COUNT: HostOffset = at(0x07EC);
/// PMAC address of the table, $D200-$DFFD.
pub const VARIABLE_READ_START: HostOffset = at(0x07EE);
/// In [`VARIABLE_READ_CONTROL`]: every entry has its own ready bit.
pub const VARIABLE_READ_MULTI_USER: u16 = 1 << 8;

// ---- gathering (p. 25-26) ----

/// Size of the gather buffer in longs, set by `DEFINE GATHER`. Newer firmware moves the three by
/// [`GATHER_SHIFT`]; ask [`crate::map::Layout::gather`].
pub const GATHER_SIZE: HostOffset = at(0x07FC);
/// Where PMAC stores next, in longs from the buffer's start. Misprinted as 0x07FC.
pub const GATHER_INDEX: HostOffset = at(0x07FE);
/// Start of the gather buffer, $D200.
pub const GATHER_BUFFER: HostOffset = at(0x0800);
/// How far the firmware from [`GATHER_MOVED_SINCE`] on moves the gather buffer: to $D240.
pub const GATHER_SHIFT: u32 = 0x0100;
/// The first firmware with the gather buffer at $D240 and its index at 0x08FE. A production driver's table has 1.16C,
/// 1.16D, 1.16G and 1.17C, the versions of its site.
pub const GATHER_MOVED_SINCE: Firmware = Firmware::lettered(1, 16, 'C');
/// The firmware from which on the variable functions know function blocks (DPRAM manual p. 23 and 24).
pub const FUNCTION_BLOCKS_SINCE: Firmware = Firmware::first(1, 16);

// ---- regions ----

/// The control panel, 0x0000-0x0023.
pub const PANEL: Region = Region::new("panel", PANEL_REQUEST_ENABLE, SERVO_HOST_STATUS);
/// The servo fixed data buffer, 0x0024-0x0227.
pub const SERVO: Region = Region::new("servo", SERVO_HOST_STATUS, BACKGROUND_DATA_READY);
/// The background fixed data buffer, 0x0228-0x062B.
pub const BACKGROUND: Region = Region::new("background", BACKGROUND_DATA_READY, ASCII_OUTPUT_CONTROL);
/// The ASCII command half, 0x062C-0x06CF.
pub const ASCII_OUTPUT: Region = Region::new("ascii_output", ASCII_OUTPUT_CONTROL, ASCII_INPUT_CONTROL);
/// The ASCII response half, 0x06D0-0x07D3.
pub const ASCII_INPUT: Region = Region::new("ascii_input", ASCII_INPUT_CONTROL, VARIABLE_WRITE_COUNT);
/// The headers of the buffers of variable size, 0x07D4-0x07FF.
pub const POINTERS: Region = Region::new("pointers", VARIABLE_WRITE_COUNT, USER_START);
/// Room for the buffers of variable size, and free for other use, 0x0800-0x3FFF.
pub const USER_AREA: Region = Region::new("user", USER_START, at(LENGTH));
const USER_START: HostOffset = at(0x0800);
/// The whole DPRAM.
pub const REGIONS: &[Region] = &[PANEL, SERVO, BACKGROUND, ASCII_OUTPUT, ASCII_INPUT, POINTERS, USER_AREA];

// ---- descriptors ----

/// The servo report.
pub const SERVO_BLOCK: ServoBlock = ServoBlock {
    region: SERVO,
    start: ReportStart::Gather,
    host_busy: Flag { word: SERVO_HOST_STATUS, mask: HOST_BUSY },
    pmac_status: Flag { word: SERVO_PMAC_STATUS, mask: PMAC_BUSY },
    busy: BusyRule::SetWhileWriting,
    timer: Timer { low: SERVO_PMAC_STATUS, low_bits: SERVO_TIMER_MASK.count_ones(), high: None },
    mask: None,
    global: Run { first: SERVO_GLOBAL_STATUS_Y, words: 4 },
    global_status: Some(GLOBAL_STATUS),
    open_loop: Flag {
        word: SERVO_MOTOR.plus_words(servo_motor::SERVO_STATUS + 1),
        mask: servo_motor::OPEN_LOOP,
    },
    activated: Flag {
        word: SERVO_MOTOR.plus_words(servo_motor::SERVO_STATUS + 1),
        mask: servo_motor::ACTIVATED,
    },
    standing: Flag {
        word: SERVO_MOTOR.plus_words(servo_motor::SERVO_STATUS),
        mask: servo_motor::DESIRED_VELOCITY_ZERO,
    },
    motors: Blocks { count: MOTORS, first: SERVO_MOTOR, words: SERVO_MOTOR_WORDS },
};

/// The background report.
pub const BACKGROUND_REPORT: BackgroundBlock = BackgroundBlock {
    region: BACKGROUND,
    ready: Flag { word: BACKGROUND_DATA_READY, mask: DATA_READY },
    host_busy: None,
    count: None,
    timer: Timer { low: BACKGROUND_SERVO_TIMER, low_bits: 16, high: None },
    global: Run { first: BACKGROUND_PANEL_PORT, words: 6 },
    ports: [BACKGROUND_PANEL_PORT, BACKGROUND_THUMBWHEEL_PORT, BACKGROUND_MACHINE_PORT],
    global_status: None,
    amplifier_enabled: Some(Flag {
        word: BACKGROUND_BLOCK.plus_words(background_block::MOTOR_STATUS),
        mask: background_block::AMPLIFIER_ENABLED,
    }),
    program_runs: Flag {
        word: BACKGROUND_BLOCK.plus_words(background_block::STATUS),
        mask: background_block::PROGRAM_RUNS,
    },
    numbers: NumberKind::MotorOrCoordinateSystem,
    blocks: Blocks { count: MOTORS, first: BACKGROUND_BLOCK, words: BACKGROUND_BLOCK_WORDS },
};

/// ASCII communication.
pub const ASCII: AsciiPort = AsciiPort {
    command_loaded: Flag { word: ASCII_OUTPUT_CONTROL, mask: COMMAND_LOADED },
    control_character: ASCII_CONTROL_CHARACTER,
    command: ASCII_COMMAND,
    command_bytes: ASCII_COMMAND_BYTES,
    line_limit: ASCII_LINE_LIMIT,
    goes_by_i3: true,
    response_control: ASCII_INPUT_CONTROL,
    response_count: ASCII_INPUT_COUNT,
    response: ASCII_RESPONSE,
};

/// The start words of tables are PMAC addresses.
pub const START: StartRule = StartRule { from: at(0), word: BASE as u16 };

/// Background variable read: the kind in bits 2-0 of the X word, addresses of 16 bits.
pub const VARIABLE_READ: VariableRead = VariableRead {
    ready: Flag { word: VARIABLE_READ_CONTROL, mask: DATA_READY },
    multi_user: Flag { word: VARIABLE_READ_CONTROL, mask: VARIABLE_READ_MULTI_USER },
    timer: VARIABLE_READ_SERVO_TIMER,
    count: VARIABLE_READ_COUNT,
    start: VARIABLE_READ_START,
    kind_bit: 0,
};

/// Background variable write (DPRAM manual p. 24).
pub const VARIABLE_WRITE: VariableWrite =
    VariableWrite { count: VARIABLE_WRITE_COUNT, start: VARIABLE_WRITE_START, since: Some("1.15G") };

/// The binary rotary buffers.
pub const ROTARY: RotaryHeaders = RotaryHeaders {
    headers: &[ROTARY_1, ROTARY_2],
    one_a_system: false,
    // "A new status bit" (Software Reference p. 271).
    binary_open: 1 << 6,
    home_motors: MOTORS as u16,
    kept_longs: &[0x200; 2],
};

/// The control panel.
pub const PANEL_BLOCK: PanelBlock = PanelBlock {
    region: PANEL,
    request_enable: PANEL_REQUEST_ENABLE,
    override_enable: PANEL_OVERRIDE_ENABLE,
    request: PANEL_REQUEST,
    feed_override: PANEL_OVERRIDE,
    stride: PANEL_STRIDE as usize / 2,
    numbers: MOTORS,
    time_base: PmacAddress::new(Space::X, 0x0806),
};

/// Data gathering as printed.
pub const GATHER: GatherPlace = GatherPlace { size: GATHER_SIZE, index: GATHER_INDEX, buffer: GATHER_BUFFER };

/// The I-variables of the functions (DPRAM manual, the "Enabling" section of each).
pub const I_VARIABLES: IVariables = IVariables {
    panel: Some(2),
    segmentation: Some(13),
    servo_period: 19,
    servo_enable: 48,
    background_enable: 49,
    reported: Some(59),
    background_period: None,
    dpram_base: None,
    servo_in_background: None,
    variables_enable: 55,
    interrupt: 56,
    rotary_enable: Some(57),
    ascii_enable: 58,
    gather_period: 19,
    gather_mode: 45,
    gather_masks: &[20],
    gather_sources: 21,
    time_base: 193,
};
