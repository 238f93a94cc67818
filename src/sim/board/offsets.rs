//! The addresses the simulated board works with, in one place.
//!
//! What lies in the DPRAM comes from the register map, as byte offsets. PMAC's own registers are word numbers: those of
//! motors repeat every [`MOTOR_STRIDE`] words, the background registers of motors and coordinate systems every
//! [`BACKGROUND_STRIDE`] (DPRAM manual pp. 14-21, Software Reference p. 399, suggested M-variables).

use crate::map::{HostOffset, classic};

const fn bytes(offset: HostOffset) -> u16 {
    offset.bytes() as u16
}

/// Length of the DPRAM in bytes (8K x 16).
pub const LENGTH: usize = classic::LENGTH as usize;
/// First DPRAM address on the PMAC's side.
pub const BASE: u16 = classic::BASE as u16;
/// Last DPRAM address on the PMAC's side.
pub const LAST: u16 = BASE + (LENGTH / 4) as u16 - 1;

/// Control panel: the request enable mask.
pub const PANEL_ENABLE: u16 = bytes(classic::PANEL_REQUEST_ENABLE);

/// Control panel: the override enable mask.
pub const PANEL_OVERRIDE_ENABLE: u16 = bytes(classic::PANEL_OVERRIDE_ENABLE);
/// Control panel: the request word of number 1.
pub const PANEL_REQUEST: u16 = bytes(classic::PANEL_REQUEST);
/// Control panel: the override of coordinate system 1.
pub const PANEL_OVERRIDE: u16 = bytes(classic::PANEL_OVERRIDE);
/// Control panel: bytes from one number's words to the next one's.
pub const PANEL_LENGTH: u16 = classic::PANEL_STRIDE as u16;

/// Servo report: the host's status.
pub const SERVO_HOST_STATUS: u16 = bytes(classic::SERVO_HOST_STATUS);
/// Servo report: PMAC's status.
pub const SERVO_PMAC_STATUS: u16 = bytes(classic::SERVO_PMAC_STATUS);
/// Servo report: copy of Y:$0003.
pub const SERVO_GLOBAL_Y: u16 = bytes(classic::SERVO_GLOBAL_STATUS_Y);
/// Servo report: copy of X:$0003.
pub const SERVO_GLOBAL_X: u16 = bytes(classic::SERVO_GLOBAL_STATUS_X);
/// Servo report: the first motor's block.
pub const SERVO_MOTOR: u16 = bytes(classic::SERVO_MOTOR);
/// Servo report: bytes from one motor's block to the next.
pub const SERVO_MOTOR_LENGTH: u16 = classic::SERVO_MOTOR_STRIDE as u16;

/// Background report: data ready.
pub const BACKGROUND_READY: u16 = bytes(classic::BACKGROUND_DATA_READY);
/// Background report: servo timer.
pub const BACKGROUND_TIMER: u16 = bytes(classic::BACKGROUND_SERVO_TIMER);
/// Background report: the three ports, four bytes each.
pub const BACKGROUND_PORTS: u16 = bytes(classic::BACKGROUND_PANEL_PORT);
/// Background report: the first motor's block.
pub const BACKGROUND_MOTOR: u16 = bytes(classic::BACKGROUND_BLOCK);
/// Background report: bytes from one block to the next.
pub const BACKGROUND_MOTOR_LENGTH: u16 = classic::BACKGROUND_BLOCK_STRIDE as u16;

/// ASCII: the host's control word.
pub const ASCII_OUT_CONTROL: u16 = bytes(classic::ASCII_OUTPUT_CONTROL);
/// ASCII: the host's control character.
pub const ASCII_OUT_CHARACTER: u16 = bytes(classic::ASCII_CONTROL_CHARACTER);
/// ASCII: the host's text.
pub const ASCII_OUT_TEXT: u16 = bytes(classic::ASCII_COMMAND);
/// ASCII: length of the host's text buffer in bytes.
pub const ASCII_OUT_LENGTH: usize = classic::ASCII_COMMAND_BYTES;
/// ASCII: PMAC's control word.
pub const ASCII_IN_CONTROL: u16 = bytes(classic::ASCII_INPUT_CONTROL);
/// ASCII: PMAC's character count (with the NUL).
pub const ASCII_IN_COUNT: u16 = bytes(classic::ASCII_INPUT_COUNT);
/// ASCII: PMAC's text.
pub const ASCII_IN_TEXT: u16 = bytes(classic::ASCII_RESPONSE);
/// ASCII: the most characters one line of a response can have, without its NUL.
pub const ASCII_IN_CHARACTERS: usize = classic::ASCII_RESPONSE_BYTES - 1;

/// Variable write: entry count.
pub const VARIABLE_WRITE_COUNT: u16 = bytes(classic::VARIABLE_WRITE_COUNT);
/// Variable write: PMAC address of the records.
pub const VARIABLE_WRITE_START: u16 = bytes(classic::VARIABLE_WRITE_START);
/// Variable read: control word.
pub const VARIABLE_READ_CONTROL: u16 = bytes(classic::VARIABLE_READ_CONTROL);
/// Variable read: servo timer.
pub const VARIABLE_READ_TIMER: u16 = bytes(classic::VARIABLE_READ_SERVO_TIMER);
/// Variable read: entry count.
pub const VARIABLE_READ_COUNT: u16 = bytes(classic::VARIABLE_READ_COUNT);
/// Variable read: PMAC address of the table.
pub const VARIABLE_READ_START: u16 = bytes(classic::VARIABLE_READ_START);
/// Binary rotary buffers: the headers of the first and the second.
pub const ROTARY: [u16; 2] = [bytes(classic::ROTARY_1), bytes(classic::ROTARY_2)];
/// First address of the part of the DPRAM that buffers of the host's choice lie in.
pub const OPEN_FIRST: u16 = BASE + (classic::OPEN.start.bytes() / 4) as u16;
/// Y: address of the PLCC function blocks.
pub const FUNCTION_BLOCKS: u16 = 0x9FFF;

/// X: servo counter.
pub const SERVO_COUNTER: u16 = 0x0000;
/// X and Y: global status.
pub const GLOBAL_STATUS: u16 = 0x0003;
/// Y: control panel, thumbwheel and machine I/O ports, three in a row.
pub const PORTS: u16 = 0xFFC0;
/// Y: the machine inputs, bit n-1 for input n.
pub const MACHINE_INPUTS: u16 = PORTS + 2;

/// Y: the encoder conversion table, 32 words.
pub const CONVERSION_TABLE: u16 = 0x0720;
/// X: the bus set-up registers, ten words.
pub const BUS_SET_UP: u16 = 0x0783;
/// X: their copies in force.
pub const BUS_ACTIVE: u16 = 0xE006;

/// Words from one motor's servo registers to the next motor's.
pub const MOTOR_STRIDE: u16 = 0x3C;
/// X: time left in the move, 1/2 ms.
pub const TIME_LEFT: u16 = 0x0020;
/// X: desired velocity, 3/(Ix08*32) counts/ms.
pub const DESIRED_VELOCITY: u16 = 0x0026;
/// D: commanded position.
pub const COMMANDED: u16 = 0x0028;
/// X: the Ix03 address, the servo report's "handwheel pointer".
pub const FEEDBACK_ADDRESS: u16 = 0x0029;
/// X: the Ix05 address.
pub const MASTER_ADDRESS: u16 = 0x002A;
/// D: actual position.
pub const ACTUAL: u16 = 0x002B;
/// D: master position.
pub const MASTER: u16 = 0x002D;
/// X: actual velocity, 1/(Ix09*32) counts per servo cycle.
pub const VELOCITY: u16 = 0x0033;
/// X: previous DAC, 1/256 DAC bit.
pub const DAC: u16 = 0x003A;
/// X: first word of `?`.
pub const SERVO_STATUS: u16 = 0x003D;
/// D: compensation.
pub const COMPENSATION: u16 = 0x0046;

/// Words from one motor's or coordinate system's background registers to the next's.
pub const BACKGROUND_STRIDE: u16 = 0xC0;
/// X: commanded time base (`%`), units of I10.
pub const TIME_BASE_COMMANDED: u16 = 0x0806;
/// X: present time base, units of I10 (suggested M198).
pub const TIME_BASE_PRESENT: u16 = 0x0808;
/// D: target position.
pub const TARGET: u16 = 0x080B;
/// D: position bias.
pub const BIAS: u16 = 0x0813;
/// Y: second word of `?`.
pub const BACKGROUND_STATUS: u16 = 0x0814;
/// Y: encoder count captured by the last homing (suggested M173).
pub const HOME_CAPTURE: u16 = 0x0815;
/// Y: second word of `??`, PSTATUS.
pub const PROGRAM_STATUS: u16 = 0x0817;
/// X: first word of `??`; Y: the motors of the coordinate system.
pub const COORDINATE_STATUS: u16 = 0x0818;
/// L: axis target positions A B C U V W X Y Z, neither segmented nor compensated.
pub const AXIS_TARGET_C: u16 = 0x0819;
/// L: axis target positions of segmented moves.
pub const AXIS_TARGET_A: u16 = 0x0876;
/// L: axis target positions with cutter compensation.
pub const AXIS_TARGET_B: u16 = 0x0896;
/// Y: averaged velocity.
pub const AVERAGE_VELOCITY: u16 = 0x082A;
/// L: variable jog position or distance, counts (suggested M172).
pub const JOG_VARIABLE: u16 = 0x082B;
/// Y: program lines remaining.
pub const LINES_REMAINING: u16 = 0x08AE;

/// The byte offset of a DPRAM address, `None` for an address that is not in the DPRAM's part for buffers of the host's
/// choice ($D200-$DFFF).
#[must_use]
pub const fn open_offset(address: u16) -> Option<u16> {
    if address >= OPEN_FIRST && address <= LAST { Some(4 * (address - BASE)) } else { None }
}

/// The address of `register` for 0-based `motor`, among the servo registers.
#[must_use]
pub const fn motor(register: u16, motor: usize) -> u16 {
    register + MOTOR_STRIDE * motor as u16
}

/// The address of `register` for the 0-based motor or coordinate system `index`, among the background registers.
#[must_use]
pub const fn background(register: u16, index: usize) -> u16 {
    register + BACKGROUND_STRIDE * index as u16
}
