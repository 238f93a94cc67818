//! Axis definitions and axis modes: the motors that move the axes of the coordinate systems, and the reading of
//! positions.
//!
//! `#1->8660X-5000Y+100` makes motor 1 follow that combination of axes in the addressed coordinate system (Software
//! Reference p. 179). `ABS`, `INC` and `FRAX` set modes of a coordinate system's axes. A board keeps the modes as bits
//! of the coordinate system's first `??` word.

use std::fmt::Write as _;

use super::error::CommandError;
use super::number::decimal;

/// The axis letters in the order of the first `??` word, from bit 22 downwards by two.
pub const AXES: [char; 9] = ['Z', 'Y', 'X', 'W', 'V', 'U', 'C', 'B', 'A'];

/// The bit of "radius vector incremental" in the first `??` word.
const RADIUS_INCREMENTAL: u32 = 1 << 5;

/// Whether `character` (upper case) is an axis letter.
#[must_use]
pub fn is_axis(character: u8) -> bool {
    AXES.contains(&char::from(character))
}

/// The "incremental" bit of `axis` in the first `??` word; the "used in feedrate" bit is the next higher bit.
fn incremental_bit(axis: char) -> Option<u32> {
    AXES.iter().position(|&letter| letter == axis).map(|index| 1 << (22 - 2 * index))
}

/// The definition of one motor.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisDefinition {
    /// 0-based coordinate system that the motor belongs to.
    pub coordinate_system: usize,
    /// Counts per axis unit, and the axis; one term to three.
    pub terms: Vec<(f64, char)>,
    /// Motor position in counts at axis zero.
    pub offset: f64,
}

/// The letter of Turbo for a motor whose position comes from the inverse kinematic program (Turbo Software
/// Reference p. 284: code 5 in the second word of `?`).
pub const INVERSE_KINEMATIC: char = 'I';

impl AxisDefinition {
    /// Whether the inverse kinematic program says where the motor goes.
    #[must_use]
    pub fn is_kinematic(&self) -> bool {
        self.terms.iter().any(|&(_, axis)| axis == INVERSE_KINEMATIC)
    }

    /// The kind of axis in Turbo's second word of `?` (Turbo Software Reference p. 284).
    #[must_use]
    pub fn code(&self) -> u32 {
        match self.terms.first() {
            Some((_, 'A')) => 1,
            Some((_, 'B')) => 2,
            Some((_, 'C')) => 3,
            Some((_, 'U' | 'V' | 'W')) => 4,
            Some((_, 'X' | 'Y' | 'Z')) => 7,
            Some(&(_, INVERSE_KINEMATIC)) => 5,
            _ => 0,
        }
    }

    /// The definition as `#n->` lists it.
    #[must_use]
    pub fn text(&self, decimals: usize) -> String {
        let mut text = String::new();
        for &(scale, axis) in &self.terms {
            let plus = if text.is_empty() || scale < 0.0 { "" } else { "+" };
            let scale = match scale {
                1.0 => String::new(),
                -1.0 => "-".to_owned(),
                scale => decimal(scale, decimals),
            };
            let _ = write!(text, "{plus}{scale}{axis}");
        }
        if self.offset != 0.0 {
            let plus = if self.offset < 0.0 { "" } else { "+" };
            let _ = write!(text, "{plus}{}", decimal(self.offset, decimals));
        }
        text
    }
}

/// A mode command that takes a list of axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AxisMode {
    /// `ABS`.
    Absolute,
    /// `INC`.
    Incremental,
    /// `FRAX`.
    Feedrate,
}

/// The first `??` word after `ABS`, `INC` or `FRAX` with this list; `status` is the word before.
///
/// Without a list the command is for all nine axes, but not for the circle vectors (`R` in a list). `FRAX` with a list
/// takes out all axes that the list does not name.
///
/// # Errors
/// ERR003 for a letter that names no axis.
pub fn with_mode(status: u32, mode: AxisMode, list: Option<&[char]>) -> Result<u32, CommandError> {
    let mut mask = 0;
    for &axis in list.unwrap_or(&AXES) {
        mask |= match axis {
            'R' if mode != AxisMode::Feedrate => RADIUS_INCREMENTAL,
            axis => incremental_bit(axis).ok_or(CommandError::SYNTAX)?,
        };
    }
    let every = AXES.into_iter().filter_map(incremental_bit).fold(0, |bits, bit| bits | bit);
    Ok(match mode {
        AxisMode::Absolute => status & !mask,
        AxisMode::Incremental => status | mask,
        AxisMode::Feedrate => status & !(every << 1) | mask << 1,
    })
}

/// The axis definitions of all motors; after power-up no motor has one.
#[derive(Debug, Clone, Default)]
pub struct AxisDefinitions {
    motors: Vec<Option<AxisDefinition>>,
}

impl AxisDefinitions {
    /// The definition of the 0-based `motor`, if it has one.
    #[must_use]
    pub fn definition(&self, motor: usize) -> Option<&AxisDefinition> {
        self.motors.get(motor)?.as_ref()
    }

    /// The 0-based coordinate system that the 0-based `motor` is assigned to.
    #[must_use]
    pub fn coordinate_system(&self, motor: usize) -> Option<usize> {
        Some(self.definition(motor)?.coordinate_system)
    }

    /// The 0-based motors assigned to the 0-based coordinate system `cs`.
    pub fn motors_in(&self, cs: usize) -> impl Iterator<Item = usize> + '_ {
        (0..self.motors.len()).filter(move |&motor| self.coordinate_system(motor) == Some(cs))
    }

    /// Defines the 0-based `motor`, or clears its definition.
    pub fn set(&mut self, motor: usize, definition: Option<AxisDefinition>) {
        if motor >= self.motors.len() {
            self.motors.resize(motor + 1, None);
        }
        self.motors[motor] = definition;
    }

    /// Clears the definitions of all motors of the 0-based coordinate system `cs`.
    pub fn undefine(&mut self, cs: usize) {
        for slot in &mut self.motors {
            if slot.as_ref().is_some_and(|definition| definition.coordinate_system == cs) {
                *slot = None;
            }
        }
    }
}
