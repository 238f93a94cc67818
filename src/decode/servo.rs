//! The servo fixed data buffer, 0x0024-0x0227 (DPRAM manual p. 14-17). PMAC writes all of it but Host-Busy.
//!
//! No following error is worked out from it: which of master and compensation position the desired position holds
//! is not documented for these boards.

use serde::Serialize;

use super::quantity::{Flags, MotorScales, Quantity, Scales};
use super::{TooShort, long, pair, split};
use crate::format::{fixed48, int24};
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
    /// The motors from 1 on.
    pub motors: Vec<ServoMotor>,
}

/// What the servo buffer held of one motor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ServoMotor {
    /// The motor's number, from 1.
    pub motor: usize,
    /// Commanded position.
    pub commanded_position: Quantity,
    /// Actual position. What `P` reports adds bias and compensation.
    pub actual_position: Quantity,
    /// Position of the master that is followed.
    pub master_position: Quantity,
    /// Leadscrew and backlash compensation.
    pub compensation_position: Quantity,
    /// The previous servo cycle's output.
    pub previous_dac: Quantity,
    /// The servo status word, the first word of `?`.
    pub servo_status: Quantity,
    /// Actual velocity of the last servo cycle, not averaged.
    pub actual_velocity: Quantity,
    /// Time left in the move segment at 100 % feed rate override.
    pub time_left: Quantity,
    /// A PMAC address of doubtful meaning; see the register table.
    pub handwheel_pointer: Quantity,
    /// The flags of the servo status word.
    pub status: Flags,
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
    const HEAD: usize = classic::SERVO_MOTOR.words_since(classic::SERVO_HOST_STATUS);
    const PMAC_STATUS: usize = classic::SERVO_PMAC_STATUS.words_since(classic::SERVO_HOST_STATUS);
    const STATUS_Y: usize = classic::SERVO_GLOBAL_STATUS_Y.words_since(classic::SERVO_HOST_STATUS);
    const STATUS_X: usize = classic::SERVO_GLOBAL_STATUS_X.words_since(classic::SERVO_HOST_STATUS);

    let (head, blocks) = split(classic::SERVO, words, HEAD, motors.min(classic::MOTORS))?;
    let pmac_status = head[PMAC_STATUS];
    Ok(ServoData {
        servo_timer: pmac_status & classic::SERVO_TIMER_MASK,
        pmac_busy: pmac_status & classic::PMAC_BUSY != 0,
        host_busy: head[0] & classic::HOST_BUSY != 0,
        global_status: [STATUS_X, STATUS_Y].map(|word| int24::unsigned(long(head, word))),
        motors: (1..).zip(blocks).map(|(number, block)| motor(number, block, scales.motor(number))).collect(),
    })
}

fn motor(number: usize, block: &[u16; classic::SERVO_MOTOR_WORDS], scales: MotorScales) -> ServoMotor {
    let fixed = |word| {
        let (y, x) = pair(block, word);
        fixed48::decode(y, x)
    };
    let signed = |word| int24::signed(long(block, word));
    let unsigned = |word| int24::unsigned(long(block, word));
    let status = unsigned(at::SERVO_STATUS);
    ServoMotor {
        motor: number,
        commanded_position: Quantity::position(fixed(at::COMMANDED_POSITION), scales),
        actual_position: Quantity::position(fixed(at::ACTUAL_POSITION), scales),
        master_position: Quantity::master(fixed(at::MASTER_POSITION), scales),
        compensation_position: Quantity::position(fixed(at::COMPENSATION_POSITION), scales),
        previous_dac: Quantity::dac(signed(at::PREVIOUS_DAC)),
        servo_status: Quantity::bits(status),
        actual_velocity: Quantity::velocity(signed(at::ACTUAL_VELOCITY), scales),
        time_left: Quantity::time(signed(at::TIME_LEFT)),
        handwheel_pointer: Quantity::address(unsigned(at::HANDWHEEL_POINTER)),
        status: Flags { word: status, table: &CLASSIC.motor[0] },
    }
}
