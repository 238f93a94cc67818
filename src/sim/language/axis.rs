//! Axis definitions and lists of axes, as typed.

use crate::map::Generation;
use crate::sim::board::axes::{AxisDefinition, INVERSE_KINEMATIC, is_axis};
use crate::sim::board::error::CommandError;
use crate::sim::language::scanner::Scanner;

/// Parses the text after `->`. `Ok(None)` is `0`: no axis. `I` is Turbo's (Turbo Software Reference p. 284).
///
/// # Errors
/// ERR003 for more than three terms, an axis named twice, axes of two groups, or any other text.
pub fn definition(
    scanner: &mut Scanner,
    coordinate_system: usize,
    generation: Generation,
) -> Result<Option<AxisDefinition>, CommandError> {
    if generation == Generation::Turbo && scanner.take(b'I') {
        let terms = vec![(1.0, INVERSE_KINEMATIC)];
        return Ok(Some(AxisDefinition { coordinate_system, terms, offset: 0.0 }));
    }
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
    Ok(Some(AxisDefinition { coordinate_system, terms, offset: offset.unwrap_or(0.0) }))
}

/// Accepts one axis, or two or three different ones, all of XYZ or all of UVW.
fn check_axes(terms: &[(f64, char)]) -> Result<(), CommandError> {
    let together = |group: &str| terms.iter().all(|&(_, axis)| group.contains(axis));
    let repeated = terms.iter().enumerate().any(|(i, &(_, axis))| terms[..i].iter().any(|&(_, a)| a == axis));
    let several = terms.len() <= 3 && !repeated && (together("XYZ") || together("UVW"));
    if terms.len() == 1 || several { Ok(()) } else { Err(CommandError::SYNTAX) }
}

/// Longest list in parentheses: nine axes and the vector.
const LONGEST_LIST: usize = 10;

/// `(X,Y)` after `ABS`, `INC` or `FRAX`; `None` without a list.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::board::axes::{AxisDefinitions, AxisMode, with_mode};

    fn parse(text: &str) -> Result<Option<AxisDefinition>, CommandError> {
        definition(&mut Scanner::new(text.as_bytes()), 0, Generation::Pmac)
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
        let on = |axis: &[u8]| definition(&mut Scanner::new(axis), 1, Generation::Pmac).unwrap();
        axes.set(3, on(b"X"));
        axes.set(5, on(b"Y"));
        assert_eq!(axes.motors_in(1).collect::<Vec<_>>(), [3, 5]);
        axes.undefine(1);
        assert_eq!(axes.motors_in(1).count(), 0);
    }
}
