//! The addresses the simulated board works with, in one place.
//!
//! Host offsets are bytes into the DPRAM; PMAC addresses are word numbers. Motor registers repeat every
//! [`MOTOR_STRIDE`] words, the background registers of motors and coordinate systems every [`BACKGROUND_STRIDE`].
//! Sources: DPRAM manual pp. 12-29, Software Reference p. 399 and the suggested M-variables.

/// Length of the DPRAM in bytes (8K x 16).
pub const LENGTH: usize = 0x4000;
/// First DPRAM address on the PMAC's side.
pub const BASE: u16 = 0xD000;
/// Last DPRAM address on the PMAC's side.
pub const LAST: u16 = 0xDFFF;

/// Control panel: the request enable mask.
pub const PANEL_ENABLE: u16 = 0x0000;

/// Servo report: the host's status (bit 0 Host-Busy).
pub const SERVO_HOST_STATUS: u16 = 0x0024;
/// Servo report: PMAC's status (bit 15 PMAC-Busy, bits 0-14 servo timer).
pub const SERVO_PMAC_STATUS: u16 = 0x0026;
/// Servo report: copy of Y:$0003.
pub const SERVO_GLOBAL_Y: u16 = 0x0028;
/// Servo report: copy of X:$0003.
pub const SERVO_GLOBAL_X: u16 = 0x002C;
/// Servo report: the first motor's block.
pub const SERVO_MOTOR: u16 = 0x0048;
/// Servo report: bytes from one motor's block to the next.
pub const SERVO_MOTOR_LENGTH: u16 = 0x3C;

/// Background report: data ready (bit 0).
pub const BACKGROUND_READY: u16 = 0x0228;
/// Background report: servo timer.
pub const BACKGROUND_TIMER: u16 = 0x022A;
/// Background report: the three ports, four bytes each.
pub const BACKGROUND_PORTS: u16 = 0x022C;
/// Background report: the first motor's block.
pub const BACKGROUND_MOTOR: u16 = 0x024C;
/// Background report: bytes from one block to the next.
pub const BACKGROUND_MOTOR_LENGTH: u16 = 0x7C;

/// ASCII: the host's control word (bit 0: a line is there).
pub const ASCII_OUT_CONTROL: u16 = 0x062C;
/// ASCII: the host's control character.
pub const ASCII_OUT_CHARACTER: u16 = 0x062E;
/// ASCII: the host's text, 160 bytes.
pub const ASCII_OUT_TEXT: u16 = 0x0630;
/// ASCII: length of the host's text buffer in bytes.
pub const ASCII_OUT_LENGTH: usize = 160;
/// ASCII: PMAC's control word.
pub const ASCII_IN_CONTROL: u16 = 0x06D0;
/// ASCII: PMAC's character count (with the NUL).
pub const ASCII_IN_COUNT: u16 = 0x06D2;
/// ASCII: PMAC's text, 256 bytes.
pub const ASCII_IN_TEXT: u16 = 0x06D4;
/// ASCII: the most characters one line of a response can have.
pub const ASCII_IN_CHARACTERS: usize = 255;

/// Variable write: entry count.
pub const VARIABLE_WRITE_COUNT: u16 = 0x07D4;
/// Gather: size in long words (firmware to 1.16B).
pub const GATHER_SIZE: u16 = 0x07FC;
/// Gather: storage index (firmware to 1.16B).
pub const GATHER_INDEX: u16 = 0x07FE;
/// Gather: buffer (firmware to 1.16B), $D200.
pub const GATHER_BUFFER: u16 = 0x0800;
/// How far firmware 1.16C and later moved the gather buffer and its two words ($40 locations).
pub const GATHER_SHIFT: u16 = 0x0100;

/// X: servo counter.
pub const SERVO_COUNTER: u16 = 0x0000;
/// X and Y: global status.
pub const GLOBAL_STATUS: u16 = 0x0003;
/// Y: control panel, thumbwheel and machine I/O ports, three in a row.
pub const PORTS: u16 = 0xFFC0;

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
