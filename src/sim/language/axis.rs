//! Axis definitions and axis modes: which motor moves which axis of which coordinate system, and how axes are read.
//!
//! `#1->8660X-5000Y+100` makes motor 1 follow that combination of axes in the addressed coordinate system (Software
//! Reference p. 179). `ABS`, `INC` and `FRAX` set modes of a coordinate system's axes: bits of its first `??` word, which
//! is where a board keeps them.

use std::fmt::Write as _;

use super::CommandError;
use super::number::decimal;
use super::scanner::Scanner;

/// The axis letters in the order of the first `??` word, from bit 22 downwards by two.
pub const AXES: [char; 9] = ['Z', 'Y', 'X', 'W', 'V', 'U', 'C', 'B', 'A'];

/// The bit of "radius vector incremental" in the first `??` word.
const RADIUS_INCREMENTAL: u32 = 1 << 5;

/// Whether `character` (upper case) is an axis letter.
#[must_use]
pub fn is_axis(character: u8) -> bool {
    AXES.contains(&char::from(character))
}

/// The "incremental" bit of `axis` in the first `??` word; the "used in feedrate" bit is the next higher one.
fn incremental_bit(axis: char) -> Option<u32> {
    AXES.iter().position(|&letter| letter == axis).map(|index| 1 << (22 - 2 * index))
}

/// The definition of one motor.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisDefinition {
    /// 0-based coordinate system that the motor belongs to.
    pub coordinate_system: usize,
    /// Counts per axis unit, and the axis; one to three.
    pub terms: Vec<(f64, char)>,
    /// Motor position in counts at axis zero.
    pub offset: f64,
}

impl AxisDefinition {
    /// Reads what follows `->`. `Ok(None)` is `0`: no axis.
    ///
    /// # Errors
    /// ERR003 for more than three terms, an axis named twice, axes of two groups, or anything not understood.
    pub fn parse(scanner: &mut Scanner, coordinate_system: usize) -> Result<Option<Self>, CommandError> {
        let mut terms: Vec<(f64, char)> = Vec::new();
        let mut offset = None;
        loop {
            let negative = match scanner.peek() {
                Some(sign @ (b'+' | b'-')) => {
                    scanner.next_character();
                    sign == b'-'
                }
                _ if terms.is_empty() && offset.is_none() => false,
                _ => break,
            };
            let number = if scanner.at_unsigned() { Some(scanner.unsigned()?) } else { None };
            if terms.is_empty() && number == Some(0.0) {
                return Ok(None);
            }
            let sign = if negative { -1.0 } else { 1.0 };
            let axis = scanner.peek().filter(|&c| is_axis(c) && offset.is_none());
            match (number, axis) {
                (number, Some(axis)) => {
                    scanner.next_character();
                    terms.push((sign * number.unwrap_or(1.0), char::from(axis)));
                }
                (Some(number), None) if !terms.is_empty() && offset.is_none() => offset = Some(sign * number),
                _ => return Err(CommandError::SYNTAX),
            }
        }
        check_axes(&terms)?;
        Ok(Some(Self { coordinate_system, terms, offset: offset.unwrap_or(0.0) }))
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

/// One axis; or two or three different ones, all of XYZ or all of UVW.
fn check_axes(terms: &[(f64, char)]) -> Result<(), CommandError> {
    let together = |group: &str| terms.iter().all(|&(_, axis)| group.contains(axis));
    let repeated = terms.iter().enumerate().any(|(i, &(_, axis))| terms[..i].iter().any(|&(_, a)| a == axis));
    let several = terms.len() <= 3 && !repeated && (together("XYZ") || together("UVW"));
    if terms.len() == 1 || several { Ok(()) } else { Err(CommandError::SYNTAX) }
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

/// Longest list in parentheses: nine axes and the vector.
const LONGEST_LIST: usize = 10;

/// `(X,Y)` after `ABS`, `INC` or `FRAX`; `None` when there is no list.
///
/// # Errors
/// ERR003 for a list that is too long or not closed, or a letter that is neither an axis nor R.
pub fn parse_list(scanner: &mut Scanner) -> Result<Option<Vec<char>>, CommandError> {
    if !scanner.take(b'(') {
        return Ok(None);
    }
    let mut axes = Vec::new();
    loop {
        let letter = scanner.next_character().filter(|&c| is_axis(c) || c == b'R');
        axes.push(char::from(letter.ok_or(CommandError::SYNTAX)?));
        if scanner.take(b')') {
            return Ok(Some(axes));
        }
        if axes.len() == LONGEST_LIST {
            return Err(CommandError::SYNTAX);
        }
        scanner.expect(b',')?;
    }
}

/// The first `??` word after `ABS`, `INC` or `FRAX` with this list, when it was `status` before.
///
/// Without a list all nine axes are meant, but not the circle vectors (`R` in a list). `FRAX` with a list takes all
/// axes out that are not in it.
///
/// # Errors
/// ERR003 for a letter that is no axis.
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

/// The axis definitions of all motors; none has one at first.
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

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Option<AxisDefinition>, CommandError> {
        AxisDefinition::parse(&mut Scanner::new(text.as_bytes()), 0)
    }

    #[test]
    fn definitions_come_back_as_stored() {
        for (typed, listed) in [
            ("X", "X"),
            ("-X", "-X"),
            ("2000 A", "2000A"),
            ("5000a", "5000A"),
            ("3333.333Z-666.667", "3333.333Z-666.667"),
            ("8660X-5000Y", "8660X-5000Y"),
            ("5000X + 8660Y+1Z+10", "5000X+8660Y+Z+10"),
            ("-29.1X+100000Y", "-29.1X+100000Y"),
            ("2000Z-6000", "2000Z-6000"),
        ] {
            assert_eq!(parse(typed).unwrap().unwrap().text(9), listed, "{typed}");
        }
        assert_eq!(parse("0"), Ok(None));
    }

    #[test]
    fn definitions_that_are_refused() {
        for text in ["", "100", "Q", "A+B", "X+U", "X+X", "X+", "X+1+2", "X+1Y+2Z+3X", "+"] {
            assert_eq!(parse(text), Err(CommandError::SYNTAX), "{text}");
        }
    }

    #[test]
    fn modes_are_the_bits_of_the_status_word() {
        for (before, mode, list, after) in [
            (0xA8_0021, AxisMode::Feedrate, Some(&['X', 'Y'][..]), 0x28_0021),
            (0xA8_0000, AxisMode::Feedrate, None, 0xAA_AA80),
            (0x28_0020, AxisMode::Incremental, None, 0x7D_5560),
            (0x7D_5560, AxisMode::Absolute, Some(&['R', 'A', 'Z']), 0x3D_5500),
            (0x7D_5560, AxisMode::Absolute, None, 0x28_0020),
        ] {
            assert_eq!(with_mode(before, mode, list), Ok(after), "{mode:?} {list:?}");
        }
        assert_eq!(with_mode(0, AxisMode::Feedrate, Some(&['R'])), Err(CommandError::SYNTAX));
        assert_eq!(with_mode(0, AxisMode::Absolute, Some(&['Q'])), Err(CommandError::SYNTAX));
    }

    #[test]
    fn motors_of_a_coordinate_system() {
        let mut axes = AxisDefinitions::default();
        axes.set(3, AxisDefinition::parse(&mut Scanner::new(b"X"), 1).unwrap());
        axes.set(5, AxisDefinition::parse(&mut Scanner::new(b"Y"), 1).unwrap());
        assert_eq!(axes.motors_in(1).collect::<Vec<_>>(), [3, 5]);
        axes.undefine(1);
        assert_eq!(axes.motors_in(1).count(), 0);
    }
}
