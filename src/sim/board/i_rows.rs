//! The I-variable tables of PMAC and PMAC2 (Software Reference, "I-variable specification").
//!
//! One row a variable: number, name, range, factory default, and whether the board lists it in hex when I9 is 2 or 3.
//! Motor rows count from Ix00, and so do coordinate-system rows (here they share the hundreds: Ix87 belongs to
//! coordinate system x). A number without a row keeps any value, as a 48-bit float.

use crate::map;

/// The owner of a row's variable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scope {
    /// The board's.
    Global,
    /// A variable for each motor.
    Motor,
    /// A variable for each coordinate system.
    Coordinate,
}

/// The values a variable can take.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Values {
    /// An integer register from the first to the second number; other values are rounded, then reduced modulo the span.
    Whole(i64, i64),
    /// A 48-bit floating-point register.
    Float,
}

/// The factory default.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Factory {
    /// The same for every motor or coordinate system.
    Is(f64),
    /// That for the first motor, 0 for the others.
    First(f64),
    /// The first number, growing by the second.
    Step(f64, f64),
    /// A default for each number.
    Each(&'static [f64]),
}

impl Factory {
    /// The default of the 0-based motor or coordinate system `index`.
    #[must_use]
    pub fn of(self, index: usize) -> f64 {
        match self {
            Self::Is(value) => value,
            Self::First(value) => {
                if index == 0 {
                    value
                } else {
                    0.0
                }
            }
            Self::Step(first, step) => first + step * index as f64,
            Self::Each(values) => values.get(index).copied().unwrap_or(0.0),
        }
    }
}

/// One row of a table. Where a family has several rows for a number, in several tables, the last row counts.
#[derive(Debug, Clone, Copy)]
pub struct Row {
    /// The variable's owner.
    pub scope: Scope,
    /// Its number, without the hundreds of the motor or coordinate system.
    pub number: usize,
    /// The last number that the row holds for.
    pub last: usize,
    /// The variable's name in the manual.
    pub name: &'static str,
    /// Range.
    pub kind: Values,
    /// Factory default.
    pub default: Factory,
    /// Listed in hex when bit 1 of I9 is set: an address, or a word that holds an address.
    pub hex: bool,
}

impl Row {
    pub(super) const fn to(self, last: usize) -> Self {
        Self { last, ..self }
    }

    pub(super) const fn hex(self) -> Self {
        Self { hex: true, ..self }
    }

    pub(super) const fn starts(self, default: Factory) -> Self {
        Self { default, ..self }
    }
}

const fn row(scope: Scope, number: usize, name: &'static str, kind: Values, default: f64) -> Row {
    Row { scope, number, last: number, name, kind, default: Factory::Is(default), hex: false }
}

pub(super) const fn global(number: usize, name: &'static str, kind: Values, default: f64) -> Row {
    row(Scope::Global, number, name, kind, default)
}

pub(super) const fn motor(number: usize, name: &'static str, kind: Values, default: f64) -> Row {
    row(Scope::Motor, number, name, kind, default)
}

pub(super) const fn coordinate(number: usize, name: &'static str, kind: Values, default: f64) -> Row {
    row(Scope::Coordinate, number, name, kind, default)
}

pub(super) const fn servo_time(default: u32) -> Row {
    global(10, "servo interrupt time", POSITIVE, default as f64)
}

pub(super) const SWITCH: Values = Values::Whole(0, 1);
pub(super) const MODE: Values = Values::Whole(0, 3);
pub(super) const NIBBLE: Values = Values::Whole(0, 15);
pub(super) const BYTE: Values = Values::Whole(0, 255);
pub(super) const POSITIVE: Values = Values::Whole(0, 0x7F_FFFF);
pub(super) const SIGNED: Values = Values::Whole(-0x80_0000, 0x7F_FFFF);
const SIGNED16: Values = Values::Whole(-0x8000, 0x7FFF);
const POSITIVE15: Values = Values::Whole(0, 0x7FFF);
const ADDRESS: Values = Values::Whole(0, 0xFFFF);
pub(super) const WORD: Values = Values::Whole(0, 0xFF_FFFF);
const LONG: Values = Values::Whole(-(1 << 35), (1 << 35) - 1);
pub(super) const FLOAT: Values = Values::Float;

/// I0-I99, except variables that depend on the board.
pub const GLOBAL: &[Row] = &[
    global(0, "serial card number", NIBBLE, 0.0),
    global(1, "serial handshake and addressing", MODE, 0.0),
    global(2, "control panel", MODE, 0.0),
    global(3, "I/O handshake", MODE, 1.0),
    global(4, "communication checksum", MODE, 0.0),
    global(5, "PLC enable", MODE, 0.0),
    global(6, "error reporting", MODE, 3.0),
    global(7, "in-position scans", BYTE, 0.0),
    global(8, "real-time interrupt period", BYTE, 2.0),
    global(9, "listing form", MODE, 2.0),
    global(11, "move calculation time", POSITIVE, 0.0),
    global(12, "jog calculation time", POSITIVE, 10.0),
    global(13, "segmentation time", POSITIVE, 0.0),
    global(14, "automatic position match", SWITCH, 1.0),
    global(15, "degrees or radians", SWITCH, 0.0),
    global(16, "rotary buffer request on", POSITIVE, 5.0),
    global(17, "rotary buffer request off", POSITIVE, 10.0),
    global(18, "fixed buffer full warning", POSITIVE, 10.0),
    global(19, "gather period", POSITIVE, 0.0),
    global(20, "gather mask", WORD, 0.0).hex(),
    global(21, "gather source", WORD, 0.0).to(44).hex(),
    global(45, "gather location and mode", MODE, 0.0),
    global(46, "P and Q storage", MODE, 0.0),
    global(47, "address of the ^W command", ADDRESS, 0.0).hex(),
    global(48, "DPRAM servo data", SWITCH, 0.0),
    global(49, "DPRAM background data", SWITCH, 0.0),
    global(50, "rapid speed select", SWITCH, 1.0),
    global(51, "leadscrew compensation", SWITCH, 0.0),
    global(52, "program hold slew rate", POSITIVE, 37137.0),
    global(53, "step mode", SWITCH, 0.0),
    global(54, "serial baud rate", NIBBLE, 12.0),
    global(55, "DPRAM background variables", SWITCH, 0.0),
    global(56, "DPRAM ASCII interrupt", SWITCH, 0.0),
    global(57, "DPRAM binary rotary buffer", SWITCH, 0.0),
    global(58, "DPRAM ASCII", SWITCH, 0.0),
    global(59, "DPRAM motors and coordinate systems", Values::Whole(0, 8), 0.0),
    global(60, "A/D conversion address", ADDRESS, 0.0).hex(),
    global(61, "A/D conversion count", BYTE, 0.0),
    global(62, "SEND carriage return", SWITCH, 0.0),
    global(63, "^X echo", SWITCH, 0.0),
    global(64, "internal response tag", SWITCH, 0.0),
    global(89, "cutter compensation outside corner break", FLOAT, 0.9998),
    global(90, "minimum arc angle", FLOAT, 0.0),
    global(99, "backlash hysteresis", POSITIVE, 64.0),
];

/// Ix00-Ix86 of each motor.
pub const MOTOR: &[Row] = &[
    motor(0, "activate", SWITCH, 0.0).starts(Factory::First(1.0)),
    motor(1, "commutation enable", SWITCH, 0.0),
    motor(2, "command output address", ADDRESS, 0.0).hex().starts(Factory::Each(&[
        0xC003 as f64,
        0xC002 as f64,
        0xC00B as f64,
        0xC00A as f64,
        0xC013 as f64,
        0xC012 as f64,
        0xC01B as f64,
        0xC01A as f64,
    ])),
    motor(3, "position feedback address", WORD, 0.0).hex().starts(Factory::Step(0x720 as f64, 1.0)),
    motor(4, "velocity feedback address", WORD, 0.0).hex().starts(Factory::Step(0x720 as f64, 1.0)),
    motor(5, "master position address", WORD, 0x73F as f64).hex(),
    motor(6, "master following", SWITCH, 0.0),
    motor(7, "master scale factor", SIGNED, 96.0),
    motor(8, "position scale factor", POSITIVE, 96.0),
    motor(9, "velocity-loop scale factor", POSITIVE, 96.0),
    motor(10, "power-on servo position address", WORD, 0.0).hex(),
    motor(11, "fatal following error", POSITIVE, 32000.0),
    motor(12, "warning following error", POSITIVE, 16000.0),
    motor(13, "positive software limit", LONG, 0.0),
    motor(14, "negative software limit", LONG, 0.0),
    motor(15, "abort deceleration", FLOAT, 0.25),
    motor(16, "maximum velocity", FLOAT, 32.0),
    motor(17, "maximum program acceleration", FLOAT, 0.015_625),
    motor(19, "maximum jog acceleration", FLOAT, 0.015_625),
    motor(20, "jog acceleration time", POSITIVE, 0.0),
    motor(21, "jog S-curve time", POSITIVE, 50.0),
    motor(22, "jog speed", FLOAT, 32.0),
    motor(23, "home speed and direction", FLOAT, 32.0),
    motor(25, "flag address", WORD, 0.0).hex().starts(Factory::Step(0xC000 as f64, 4.0)),
    motor(26, "home offset", SIGNED, 0.0),
    motor(27, "position rollover range", POSITIVE, 0.0),
    motor(28, "in-position band", POSITIVE, 160.0),
    motor(29, "output bias", SIGNED16, 0.0),
    motor(30, "proportional gain", SIGNED, 2000.0),
    motor(31, "derivative gain", SIGNED, 1280.0),
    motor(32, "velocity feedforward gain", SIGNED, 1280.0),
    motor(33, "integral gain", POSITIVE, 0.0),
    motor(34, "integration mode", SWITCH, 1.0),
    motor(35, "acceleration feedforward gain", SIGNED, 0.0),
    motor(36, "notch filter coefficient", FLOAT, 0.0).to(39),
    motor(57, "continuous current limit", POSITIVE15, 0.0),
    motor(58, "integrated current limit", POSITIVE, 0.0),
    motor(60, "servo cycle extension", BYTE, 0.0),
    motor(63, "integration limit", SIGNED, 4_194_304.0),
    motor(64, "deadband gain", SIGNED16, 0.0),
    motor(65, "deadband size", POSITIVE15, 0.0),
    motor(67, "position error limit", POSITIVE, 4_194_304.0),
    motor(68, "friction feedforward", SIGNED16, 0.0),
    motor(69, "output limit", POSITIVE15, 20480.0),
    motor(70, "commutation cycles", BYTE, 0.0),
    motor(71, "commutation counts", POSITIVE, 0.0),
    motor(72, "commutation phase angle", BYTE, 85.0),
    motor(80, "power-up mode", Values::Whole(0, 7), 0.0),
    motor(85, "backlash take-up rate", POSITIVE, 0.0),
    motor(86, "backlash size", SIGNED, 0.0),
];

/// Ix87-Ix98 of each coordinate system.
pub const COORDINATE: &[Row] = &[
    coordinate(87, "default acceleration time", POSITIVE, 0.0),
    coordinate(88, "default S-curve time", POSITIVE, 50.0),
    coordinate(89, "default feedrate or move time", FLOAT, 1000.0),
    coordinate(90, "feedrate time units", FLOAT, 1000.0),
    coordinate(91, "default program number", POSITIVE15, 0.0),
    coordinate(92, "move blend disable", SWITCH, 0.0),
    coordinate(93, "time base address", ADDRESS, 0.0).hex().starts(Factory::Step(0x806 as f64, 0xC0 as f64)),
    coordinate(94, "time base slew rate", POSITIVE, 1644.0),
    coordinate(95, "feed hold slew rate", POSITIVE, 1644.0),
    coordinate(96, "circle error limit", FLOAT, 0.0),
    coordinate(98, "maximum feedrate", FLOAT, 0.0),
];

/// PMAC(1)'s additional rows: the servo clock comes from jumpers.
pub static PMAC: &[Row] = &[servo_time(map::PMAC.default_i10)];

/// PMAC2's additional rows: a programmable servo clock.
pub static PMAC2: &[Row] = &[
    servo_time(map::PMAC2.default_i10),
    global(992, "maximum phase and PWM frequency", POSITIVE15, 6527.0),
    global(997, "phase clock divider", NIBBLE, 0.0),
    global(998, "servo clock divider", NIBBLE, 3.0),
];
