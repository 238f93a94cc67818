//! The background fixed data buffer, 0x0228-0x062B (DPRAM manual p. 17-21). PMAC writes all of it; the host clears
//! Data-Ready.
//!
//! An axis target is a copy of one of three registers (Note 1 on p. 21); which one the program status word tells, so
//! the word and the targets must come from one update. [`TargetSource`] says which it was.

use serde::ser::{Serialize, SerializeMap, Serializer};

use super::quantity::{Flags, MotorScales, Quantity, Scales};
use super::{TooShort, long, pair, split};
use crate::format::{Float48Layout, fixed48, int24};
use crate::map::classic::{self, background_block as at};
use crate::map::status::{self, CLASSIC};
use crate::map::{AXES, HostOffset, MotionMode, TargetSource};

/// What the background buffer held.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct BackgroundData {
    /// Whether PMAC had marked the data as complete; without it the values are not of one instant.
    pub ready: bool,
    /// The low 16 bits of the servo counter when the data became ready.
    pub servo_timer: u16,
    /// The board's ports.
    pub ports: Ports,
    /// The motors from 1 on.
    pub motors: Vec<BackgroundMotor>,
    /// The coordinate systems from 1 on.
    pub coordinate_systems: Vec<CoordinateSystem>,
}

/// The board's input and output ports, 24 bits each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct Ports {
    /// JPAN, from Y:$FFC0.
    pub control_panel: u32,
    /// JTHW, from Y:$FFC1.
    pub thumbwheel: u32,
    /// JOPTO, from Y:$FFC2.
    pub machine_io: u32,
}

/// What the background buffer held of one motor.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct BackgroundMotor {
    /// The motor's number, from 1.
    pub motor: usize,
    /// Where the present move ends.
    pub target_position: Quantity,
    /// Offset from `PSET` and axis definitions.
    pub position_bias: Quantity,
    /// Actual velocity, averaged.
    pub average_velocity: Quantity,
    /// The motor status word, the second word of `?`.
    pub motor_status: Quantity,
    /// The coordinate system the motor is assigned to, from 1.
    pub coordinate_system: Option<u32>,
    /// The flags of the motor status word.
    pub status: Flags,
}

/// What the background buffer held of one coordinate system.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct CoordinateSystem {
    /// The coordinate system's number, from 1.
    pub coordinate_system: usize,
    /// The motor definition word; its bits are not documented.
    pub motor_definition: u32,
    /// The status word, the first word of `??`.
    pub status_word: u32,
    /// The flags of the status word.
    pub status: Flags,
    /// The axis targets in user units.
    pub axis_targets: AxisTargets,
    /// Which of PMAC's registers the axis targets are copies of.
    pub source: TargetSource,
    /// The program status word (PSTATUS), the second word of `??`.
    pub program_status_word: u32,
    /// The flags of the program status word.
    pub program_status: Flags,
    /// The motion mode; `None` for bits no text explains.
    pub motion_mode: Option<MotionMode>,
    /// Program lines left to be executed, as `PR`.
    pub lines_remaining: i32,
    /// Time left in the move. Sources contradict each other on whether it holds with I13 at 0 or above 0.
    pub time_left_in_move: Quantity,
    /// Time left in acceleration or deceleration; the same doubt.
    pub time_left_in_acceleration: Quantity,
    /// Where in the program buffer execution is, as `PE`.
    pub program_address_offset: u32,
}

/// The targets of the nine axes, in the order of [`AXES`]. Serialises as an object with the axes' letters as keys.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisTargets(pub [f64; AXES.len()]);

impl AxisTargets {
    /// The target of the axis called `letter` (capital), or `None` when there is no such axis.
    #[must_use]
    pub fn axis(&self, letter: &str) -> Option<f64> {
        AXES.iter().position(|axis| *axis == letter).map(|index| self.0[index])
    }
}

impl Serialize for AxisTargets {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut targets = serializer.serialize_map(Some(AXES.len()))?;
        for (axis, target) in AXES.iter().zip(self.0) {
            targets.serialize_entry(axis, &target)?;
        }
        targets.end()
    }
}

/// Decodes the background buffer of `count` motors and coordinate systems (at most 8) from its words, the first of
/// which is that at 0x0228.
///
/// # Errors
/// [`TooShort`] when the words of a number asked for are missing.
pub fn background(
    words: &[u16],
    count: usize,
    scales: &Scales,
    float48: Float48Layout,
) -> Result<BackgroundData, TooShort> {
    const fn word(offset: HostOffset) -> usize {
        offset.words_since(classic::BACKGROUND_DATA_READY)
    }
    const HEAD: usize = word(classic::BACKGROUND_BLOCK);

    let (head, blocks) = split(classic::BACKGROUND, words, HEAD, count.min(classic::MOTORS))?;
    let port = |offset| int24::unsigned(long(head, word(offset)));
    Ok(BackgroundData {
        ready: head[0] & classic::DATA_READY != 0,
        servo_timer: head[word(classic::BACKGROUND_SERVO_TIMER)],
        ports: Ports {
            control_panel: port(classic::BACKGROUND_PANEL_PORT),
            thumbwheel: port(classic::BACKGROUND_THUMBWHEEL_PORT),
            machine_io: port(classic::BACKGROUND_MACHINE_PORT),
        },
        motors: (1..).zip(blocks).map(|(number, block)| motor(number, block, scales.motor(number))).collect(),
        coordinate_systems: (1..).zip(blocks).map(|(number, block)| system(number, block, float48)).collect(),
    })
}

type Block = [u16; classic::BACKGROUND_BLOCK_WORDS];

fn motor(number: usize, block: &Block, scales: MotorScales) -> BackgroundMotor {
    let fixed = |word| {
        let (y, x) = pair(block, word);
        fixed48::decode(y, x)
    };
    let word = int24::unsigned(long(block, at::MOTOR_STATUS));
    BackgroundMotor {
        motor: number,
        target_position: Quantity::position(fixed(at::TARGET_POSITION), scales),
        position_bias: Quantity::position(fixed(at::POSITION_BIAS), scales),
        average_velocity: Quantity::velocity(int24::signed(long(block, at::AVERAGE_VELOCITY)), scales),
        motor_status: Quantity::bits(word),
        coordinate_system: status::coordinate_system(word, &CLASSIC),
        status: Flags { word, table: &CLASSIC.motor[1] },
    }
}

fn system(number: usize, block: &Block, float48: Float48Layout) -> CoordinateSystem {
    let signed = |word| int24::signed(long(block, word));
    let unsigned = |word| int24::unsigned(long(block, word));
    let target = |index: usize| {
        let (y, x) = pair(block, at::AXIS_TARGETS + 4 * index);
        float48.decode(y, x)
    };
    let status_word = unsigned(at::STATUS);
    let program_status_word = unsigned(at::PROGRAM_STATUS);
    CoordinateSystem {
        coordinate_system: number,
        motor_definition: unsigned(at::MOTOR_DEFINITION),
        status_word,
        status: Flags { word: status_word, table: &CLASSIC.coordinate_system[0] },
        axis_targets: AxisTargets(std::array::from_fn(target)),
        source: TargetSource::of(program_status_word),
        program_status_word,
        program_status: Flags { word: program_status_word, table: &CLASSIC.coordinate_system[1] },
        motion_mode: MotionMode::of(program_status_word),
        lines_remaining: signed(at::LINES_REMAINING),
        time_left_in_move: Quantity::time(signed(at::TIME_LEFT_IN_MOVE)),
        time_left_in_acceleration: Quantity::time(signed(at::TIME_LEFT_IN_ACCELERATION)),
        program_address_offset: unsigned(at::ADDRESS_OFFSET),
    }
}
