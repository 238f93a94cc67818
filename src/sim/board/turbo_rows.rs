//! Turbo PMAC's I-variables that replace PMAC's or add to them.
//!
//! A tool read these values from a board after `$$$***` (`dls-pmacanalyse`, `factorySettings_pmac.pmc`). The tool marks
//! I3, I4, I6, I9, I58, I63 and I64 in that file; their values come from the Turbo Software Reference (pp. 37-39, 67).

use super::i_rows::{
    BYTE, FLOAT, Factory, MODE, NIBBLE, POSITIVE, Row, SIGNED, SWITCH, Values, WORD, coordinate, global,
    motor, servo_time,
};
use crate::map;

/// The board's, in place of PMAC's.
pub const GLOBAL: &[Row] = &[
    global(0, "serial card number", NIBBLE, 0.0),
    global(1, "serial handshake and addressing", MODE, 0.0),
    global(2, "control panel", MODE, 1.0),
    global(3, "I/O handshake", MODE, 1.0),
    global(4, "communication checksum", MODE, 1.0),
    global(5, "PLC enable", MODE, 0.0),
    global(6, "error reporting", MODE, 3.0),
    global(7, "phase cycle extension", NIBBLE, 0.0),
    global(8, "real-time interrupt period", BYTE, 2.0),
    global(9, "listing form", MODE, 2.0),
    global(11, "move calculation time", POSITIVE, 0.0),
    global(13, "foreground in-position check", SWITCH, 0.0),
    global(14, "automatic position match", SWITCH, 0.0),
    global(15, "degrees or radians", SWITCH, 0.0),
    global(16, "rotary buffer request on", POSITIVE, 5.0),
    global(17, "rotary buffer request off", POSITIVE, 5.0),
    global(18, "fixed buffer full warning", POSITIVE, 10.0),
    global(19, "clock source", POSITIVE, 6807.0),
    global(20, "base of the first MACRO IC", WORD, 0x7_8400 as f64).hex(),
    global(21, "base of another MACRO IC", WORD, 0.0).to(23).hex(),
    global(24, "base of the main DPRAM", WORD, map::TURBO.base as f64).hex(),
    global(45, "transfer of binary rotary buffers", SWITCH, 0.0),
    global(46, "P and Q storage", MODE, 0.0),
    global(47, "DPRAM motor data period", POSITIVE, 0.0),
    global(48, "DPRAM motor data", SWITCH, 0.0),
    global(49, "DPRAM background data", SWITCH, 0.0),
    global(50, "DPRAM background data period", POSITIVE, 0.0),
    global(51, "leadscrew compensation", SWITCH, 0.0),
    global(52, "processor clock", NIBBLE, 7.0),
    global(53, "auxiliary serial baud rate", NIBBLE, 12.0),
    global(54, "serial baud rate", NIBBLE, 12.0),
    global(55, "DPRAM background variables", SWITCH, 0.0),
    global(56, "DPRAM ASCII interrupt", SWITCH, 0.0),
    global(57, "DPRAM motor data in the background", SWITCH, 0.0),
    global(58, "DPRAM ASCII", SWITCH, 1.0),
    global(59, "front panel group", MODE, 0.0),
    global(60, "velocity filter time", NIBBLE, 15.0),
    global(61, "velocity filter shift", BYTE, 8.0),
    global(62, "SEND carriage return", SWITCH, 0.0),
    global(63, "^X echo", SWITCH, 1.0),
    global(64, "internal response tag", SWITCH, 0.0),
    global(68, "coordinate systems", NIBBLE, 15.0),
    // Bus set-up of a board that is not on the VME bus: its DPRAM is switched off there.
    global(90, "VME address modifier", BYTE, 0x39 as f64).hex(),
    global(91, "VME address modifier mask", BYTE, 0x04 as f64).hex(),
    global(92, "VME mailbox address, A31-A24", BYTE, 0xFF as f64).hex(),
    global(93, "mailbox address, A23-A16", BYTE, 0x7F as f64).hex(),
    global(94, "mailbox address, A15-A08", BYTE, 0xA0 as f64).hex(),
    global(95, "VME interrupt level", BYTE, 0x07 as f64).hex(),
    global(96, "VME interrupt vector", BYTE, 0xA1 as f64).hex(),
    global(97, "VME DPRAM address, A23-A20", BYTE, 0.0).hex(),
    global(98, "VME DPRAM enable", BYTE, 0x60 as f64).hex(),
    global(99, "VME address width", BYTE, 0x30 as f64).hex(),
    global(4902, "memory found", WORD, 1.0).to(4903).hex(),
    global(4904, "DPRAM found", WORD, 0x8006 as f64).hex(),
    global(4908, "end of open memory", WORD, 0.0).hex(),
    global(5000, "gather location and mode", MODE, 0.0),
    global(5001, "gather source", WORD, 0.0).to(5048).hex(),
    // The Turbo Software Reference (p. 171) says 1.
    global(5049, "gather period", POSITIVE, 0.0),
    global(5050, "gather mask", WORD, 0.0).to(5051).hex(),
];

/// Each motor's rows beyond PMAC's. The first eight output and flag addresses belong to the board's own channels; no
/// manual seen gives the addresses of further motors.
pub const MOTOR: &[Row] = &[
    motor(3, "position feedback address", WORD, 0.0).hex().starts(Factory::Step(0x3501 as f64, 1.0)),
    motor(4, "velocity feedback address", WORD, 0.0).hex().starts(Factory::Step(0x3501 as f64, 1.0)),
    motor(5, "master position address", WORD, 0x35C0 as f64).hex(),
    motor(24, "flag mode", WORD, 1.0).hex(),
    motor(65, "deadband size", POSITIVE, 16.0),
    motor(70, "commutation cycles", BYTE, 1.0),
    motor(71, "commutation counts", POSITIVE, 1000.0),
    motor(72, "commutation phase angle", Values::Whole(0, 2047), 1365.0),
    motor(87, "backlash hysteresis", POSITIVE, 64.0),
    motor(88, "in-position scans", BYTE, 0.0),
    motor(90, "rapid speed select", SWITCH, 0.0),
    motor(92, "jog calculation time", POSITIVE, 10.0),
    motor(95, "power-on servo position format", WORD, 0.0).hex(),
];

/// Each coordinate system's, on top of PMAC's.
pub const COORDINATE: &[Row] = &[
    coordinate(11, "countdown timers", SIGNED, 0.0).to(12),
    coordinate(13, "segmentation time", BYTE, 0.0),
    coordinate(50, "kinematics", SWITCH, 0.0),
    coordinate(52, "program hold slew rate", POSITIVE, 37137.0),
    coordinate(53, "step mode", SWITCH, 0.0),
    coordinate(86, "alternate feedrate", FLOAT, 0.0),
    coordinate(93, "time base address", WORD, 0.0).hex().starts(Factory::Step(0x2000 as f64, 0x100 as f64)),
    coordinate(97, "minimum arc angle", FLOAT, 0.0),
    coordinate(98, "maximum feedrate", FLOAT, 0.0),
    coordinate(99, "cutter compensation outside corner break", FLOAT, 65526.0 / 65536.0),
];

const fn channels(ic: f64, channel: f64, first: f64) -> [f64; 8] {
    let mut addresses = [0.0; 8];
    let mut index = 0;
    while index < 8 {
        addresses[index] = first + ic * (index / 4) as f64 + channel * (index % 4) as f64;
        index += 1;
    }
    addresses
}

/// The rows that Turbo PMAC (the first generation) adds: the channels of PMAC's gate arrays, two at each array's first
/// and second address.
pub static TURBO: &[Row] = &[
    servo_time(map::TURBO.default_i10),
    motor(2, "command output address", WORD, 0.0).hex().starts(Factory::Each(&[
        0x7_8003 as f64,
        0x7_8002 as f64,
        0x7_800B as f64,
        0x7_800A as f64,
        0x7_8103 as f64,
        0x7_8102 as f64,
        0x7_810B as f64,
        0x7_810A as f64,
    ])),
    motor(25, "flag address", WORD, 0.0).hex().starts(Factory::Each(&channels(
        0x100 as f64,
        4.0,
        0x7_8000 as f64,
    ))),
];

/// The rows that Turbo PMAC2 adds: channels eight addresses apart, and a programmable servo clock.
pub static TURBO2: &[Row] = &[
    servo_time(map::TURBO2.default_i10),
    motor(2, "command output address", WORD, 0.0).hex().starts(Factory::Each(&channels(
        0x100 as f64,
        8.0,
        0x7_8002 as f64,
    ))),
    motor(25, "flag address", WORD, 0.0).hex().starts(Factory::Each(&channels(
        0x100 as f64,
        8.0,
        0x7_8000 as f64,
    ))),
    global(6800, "maximum phase frequency", POSITIVE, 6527.0),
    global(6801, "phase clock divider", NIBBLE, 0.0),
    global(6802, "servo clock divider", NIBBLE, 3.0),
    global(6803, "hardware clocks", POSITIVE, 2258.0),
    global(6840, "ring configuration", WORD, 0x4000 as f64).hex(),
];
