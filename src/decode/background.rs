//! The background fixed data buffer, 0x0228-0x062B (DPRAM manual p. 17-21). PMAC writes all of it; the host clears
//! Data-Ready.
//!
//! An axis target is a copy of one of three registers (Note 1 on p. 21); which one the program status word tells, so
//! the word and the targets must come from one update. [`TargetSource`] says which it was.

use serde::ser::{Serialize, SerializeMap, Serializer};

use super::quantity::{Flags, Quantity, Scales};
use super::{Block, TooShort, long, split};
use crate::format::{Float48Layout, int24};
use crate::map::classic::{self, background_block as at};
use crate::map::status::{self, CLASSIC};
use crate::map::{AXES, HostOffset, MotionMode, Selection, TargetSource};

/// What the background buffer held.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct BackgroundData {
    /// Whether PMAC had marked the data as complete; without it the values are not of one instant.
    pub ready: bool,
    /// The low 16 bits of the servo counter when the data became ready.
    pub servo_timer: u16,
    /// The board's ports.
    pub ports: Ports,
    /// The motors that were read, ascending.
    pub motors: Vec<BackgroundMotor>,
    /// The coordinate systems that were read, ascending.
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

/// What the background buffer held of one motor; `None` is what was not read of it.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct BackgroundMotor {
    /// The motor's number, from 1.
    pub motor: usize,
    /// Where the present move ends.
    pub target_position: Option<Quantity>,
    /// Offset from `PSET` and axis definitions.
    pub position_bias: Option<Quantity>,
    /// Actual velocity, averaged.
    pub average_velocity: Option<Quantity>,
    /// The motor status word, the second word of `?`.
    pub motor_status: Option<Quantity>,
    /// The coordinate system the motor is assigned to, from 1.
    pub coordinate_system: Option<u32>,
    /// The flags of the motor status word.
    pub status: Option<Flags>,
}

/// What the background buffer held of one coordinate system; `None` is what was not read of it.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct CoordinateSystem {
    /// The coordinate system's number, from 1.
    pub coordinate_system: usize,
    /// The motor definition word; its bits are not documented.
    pub motor_definition: Option<u32>,
    /// The status word, the first word of `??`.
    pub status_word: Option<u32>,
    /// The flags of the status word.
    pub status: Option<Flags>,
    /// The axis targets in user units.
    pub axis_targets: AxisTargets,
    /// Which of PMAC's registers the axis targets are copies of.
    pub source: Option<TargetSource>,
    /// The program status word (PSTATUS), the second word of `??`.
    pub program_status_word: Option<u32>,
    /// The flags of the program status word.
    pub program_status: Option<Flags>,
    /// The motion mode; `None` for bits no text explains, too.
    pub motion_mode: Option<MotionMode>,
    /// Program lines left to be executed, as `PR`.
    pub lines_remaining: Option<i32>,
    /// Time left in the move. Sources contradict each other on whether it holds with I13 at 0 or above 0.
    pub time_left_in_move: Option<Quantity>,
    /// Time left in acceleration or deceleration; the same doubt.
    pub time_left_in_acceleration: Option<Quantity>,
    /// Where in the program buffer execution is, as `PE`.
    pub program_address_offset: Option<u32>,
}

/// The targets of the nine axes, in the order of [`AXES`]; `None` is one that was not read. Serialises as an object with
/// the axes' letters as keys.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisTargets(pub [Option<f64>; AXES.len()]);

impl AxisTargets {
    /// The target of the axis called `letter` (capital), or `None` when there is no such axis or it was not read.
    #[must_use]
    pub fn axis(&self, letter: &str) -> Option<f64> {
        AXES.iter().position(|axis| *axis == letter).and_then(|index| self.0[index])
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
    background_selected(words, count, scales, float48, Selection::ALL)
}

/// As [`background`], of words of which only those in `selection` were read.
///
/// # Errors
/// [`TooShort`] when the words of a number asked for are missing.
pub fn background_selected(
    words: &[u16],
    count: usize,
    scales: &Scales,
    float48: Float48Layout,
    selection: Selection,
) -> Result<BackgroundData, TooShort> {
    const fn word(offset: HostOffset) -> usize {
        offset.words_since(classic::BACKGROUND_DATA_READY)
    }
    const HEAD: usize = word(classic::BACKGROUND_BLOCK);

    let count = selection.last_number(count.min(classic::MOTORS));
    let (head, blocks) = split(classic::BACKGROUND, words, HEAD, count)?;
    let blocks = (1..).zip(blocks).filter(|(number, _)| selection.has_number(*number));
    let blocks = blocks.map(|(number, words)| (number, Words { words, selection }));
    let port = |offset| int24::unsigned(long(head, word(offset)));
    Ok(BackgroundData {
        ready: head[0] & classic::DATA_READY != 0,
        servo_timer: head[word(classic::BACKGROUND_SERVO_TIMER)],
        ports: Ports {
            control_panel: port(classic::BACKGROUND_PANEL_PORT),
            thumbwheel: port(classic::BACKGROUND_THUMBWHEEL_PORT),
            machine_io: port(classic::BACKGROUND_MACHINE_PORT),
        },
        motors: blocks.clone().map(|(number, block)| motor(number, &block, scales)).collect(),
        coordinate_systems: blocks.map(|(number, block)| system(number, &block, float48)).collect(),
    })
}

type Words<'a> = Block<'a, { classic::BACKGROUND_BLOCK_WORDS }>;

fn motor(number: usize, block: &Words, scales: &Scales) -> BackgroundMotor {
    let scales = scales.motor(number);
    let position = |word| block.fixed(word).map(|raw| Quantity::position(raw, scales));
    let velocity = block.signed(at::AVERAGE_VELOCITY);
    let word = block.unsigned(at::MOTOR_STATUS);
    BackgroundMotor {
        motor: number,
        target_position: position(at::TARGET_POSITION),
        position_bias: position(at::POSITION_BIAS),
        average_velocity: velocity.map(|raw| Quantity::velocity(raw, scales)),
        motor_status: word.map(Quantity::bits),
        coordinate_system: word.and_then(|word| status::coordinate_system(word, &CLASSIC)),
        status: word.map(|word| Flags { word, table: &CLASSIC.motor[1] }),
    }
}

fn system(number: usize, block: &Words, float48: Float48Layout) -> CoordinateSystem {
    let target = |index: usize| block.float(at::AXIS_TARGETS + 4 * index, float48);
    let time = |word| block.signed(word).map(Quantity::time);
    let flags = |word: Option<u32>, index: usize| {
        word.map(|word| Flags { word, table: &CLASSIC.coordinate_system[index] })
    };
    let status_word = block.unsigned(at::STATUS);
    let program_status_word = block.unsigned(at::PROGRAM_STATUS);
    CoordinateSystem {
        coordinate_system: number,
        motor_definition: block.unsigned(at::MOTOR_DEFINITION),
        status_word,
        status: flags(status_word, 0),
        axis_targets: AxisTargets(std::array::from_fn(target)),
        source: program_status_word.map(TargetSource::of),
        program_status_word,
        program_status: flags(program_status_word, 1),
        motion_mode: program_status_word.and_then(MotionMode::of),
        lines_remaining: block.signed(at::LINES_REMAINING),
        time_left_in_move: time(at::TIME_LEFT_IN_MOVE),
        time_left_in_acceleration: time(at::TIME_LEFT_IN_ACCELERATION),
        program_address_offset: block.unsigned(at::ADDRESS_OFFSET),
    }
}
