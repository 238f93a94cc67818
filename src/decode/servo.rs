//! The servo fixed data buffer, 0x0024-0x0227 (DPRAM manual p. 14-17). PMAC writes all of it but Host-Busy.
//!
//! No following error is worked out from it: which of master and compensation position the desired position holds
//! is not documented for these boards.

use serde::Serialize;

use super::quantity::{Flags, Quantity, Scales};
use super::{Block, TooShort, long, split};
use crate::format::int24;
use crate::map::Selection;
use crate::map::classic::{self, servo_motor as at};
use crate::map::status::CLASSIC;

/// What the servo buffer held.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ServoData {
    /// The low 15 bits of the servo counter at PMAC's update.
    pub servo_timer: u16,
    /// Whether PMAC was updating the buffer; the motors' values are then not of one instant.
    pub pmac_busy: bool,
    /// Whether the host held PMAC off.
    pub host_busy: bool,
    /// The board's status words in the order of `???`: the copy of X:$0003, then that of Y:$0003.
    pub global_status: [u32; 2],
    /// The motors that were read, ascending.
    pub motors: Vec<ServoMotor>,
}

/// What the servo buffer held of one motor; `None` is what was not read of it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ServoMotor {
    /// The motor's number, from 1.
    pub motor: usize,
    /// Commanded position.
    pub commanded_position: Option<Quantity>,
    /// Actual position. What `P` reports adds bias and compensation.
    pub actual_position: Option<Quantity>,
    /// Position of the master that is followed.
    pub master_position: Option<Quantity>,
    /// Leadscrew and backlash compensation.
    pub compensation_position: Option<Quantity>,
    /// The previous servo cycle's output.
    pub previous_dac: Option<Quantity>,
    /// The servo status word, the first word of `?`.
    pub servo_status: Option<Quantity>,
    /// Actual velocity of the last servo cycle, not averaged.
    pub actual_velocity: Option<Quantity>,
    /// Time left in the move segment at 100 % feed rate override.
    pub time_left: Option<Quantity>,
    /// A PMAC address of doubtful meaning; see the register table.
    pub handwheel_pointer: Option<Quantity>,
    /// The flags of the servo status word.
    pub status: Option<Flags>,
}

impl ServoData {
    /// The flags of the board's status words, in the order of `???`.
    #[must_use]
    pub fn global_flags(&self) -> [Flags; 2] {
        [0, 1].map(|index| Flags { word: self.global_status[index], table: &CLASSIC.global[index] })
    }
}

/// Decodes the servo buffer of `motors` motors (at most 8) from its words, the first of which is that at 0x0024.
///
/// # Errors
/// [`TooShort`] when the words of a motor asked for are missing.
pub fn servo(words: &[u16], motors: usize, scales: &Scales) -> Result<ServoData, TooShort> {
    servo_selected(words, motors, scales, Selection::ALL)
}

/// As [`servo`], of words of which only those in `selection` were read.
///
/// # Errors
/// [`TooShort`] when the words of a motor asked for are missing.
pub fn servo_selected(
    words: &[u16],
    motors: usize,
    scales: &Scales,
    selection: Selection,
) -> Result<ServoData, TooShort> {
    const HEAD: usize = classic::SERVO_MOTOR.words_since(classic::SERVO_HOST_STATUS);
    const PMAC_STATUS: usize = classic::SERVO_PMAC_STATUS.words_since(classic::SERVO_HOST_STATUS);
    const STATUS_Y: usize = classic::SERVO_GLOBAL_STATUS_Y.words_since(classic::SERVO_HOST_STATUS);
    const STATUS_X: usize = classic::SERVO_GLOBAL_STATUS_X.words_since(classic::SERVO_HOST_STATUS);

    let (head, blocks) =
        split(classic::SERVO, words, HEAD, selection.last_number(motors.min(classic::MOTORS)))?;
    let motors = (1..).zip(blocks).filter(|(number, _)| selection.has_number(*number));
    let pmac_status = head[PMAC_STATUS];
    Ok(ServoData {
        servo_timer: pmac_status & classic::SERVO_TIMER_MASK,
        pmac_busy: pmac_status & classic::PMAC_BUSY != 0,
        host_busy: head[0] & classic::HOST_BUSY != 0,
        global_status: [STATUS_X, STATUS_Y].map(|word| int24::unsigned(long(head, word))),
        motors: motors.map(|(number, words)| motor(number, &Block { words, selection }, scales)).collect(),
    })
}

fn motor(number: usize, block: &Block<{ classic::SERVO_MOTOR_WORDS }>, scales: &Scales) -> ServoMotor {
    let scales = scales.motor(number);
    let position = |word| block.fixed(word).map(|raw| Quantity::position(raw, scales));
    let status = block.unsigned(at::SERVO_STATUS);
    ServoMotor {
        motor: number,
        commanded_position: position(at::COMMANDED_POSITION),
        actual_position: position(at::ACTUAL_POSITION),
        master_position: block.fixed(at::MASTER_POSITION).map(|raw| Quantity::master(raw, scales)),
        compensation_position: position(at::COMPENSATION_POSITION),
        previous_dac: block.signed(at::PREVIOUS_DAC).map(Quantity::dac),
        servo_status: status.map(Quantity::bits),
        actual_velocity: block.signed(at::ACTUAL_VELOCITY).map(|raw| Quantity::velocity(raw, scales)),
        time_left: block.signed(at::TIME_LEFT).map(Quantity::time),
        handwheel_pointer: block.unsigned(at::HANDWHEEL_POINTER).map(Quantity::address),
        status: status.map(|word| Flags { word, table: &CLASSIC.motor[0] }),
    }
}
