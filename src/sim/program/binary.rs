//! Binary rotary commands to [`Item`]s: PMAC's reading of two 24-bit words (DPRAM manual pp. 31-35).
//!
//! Names and codes come from the format's one table, as addresses come from the register map. This file decodes the
//! bits as the board reads them: exponent bias 31, CODE2 of a mode at bit 16 of word 1, axes at their bits in the first
//! `??` word.

use crate::map::Generation;
use crate::map::readings::RotaryCode2;
use crate::rotary::codes::{self, CODES, Code, Shape};
use crate::sim::board::axes::AxisMode;
use crate::sim::board::variables::VariableKind;
use crate::sim::language::scanner::Scanner;
use crate::sim::program::item::{AXES, Data, Item, Mark, Mode, Operator, PlcSwitch};
use crate::sim::program::words::{self, Keyword};

/// Two words that are no command, or a mark without an axis before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("${word1:06X} ${word2:06X} is no program command here")]
pub struct NoCommand {
    /// The first word.
    pub word1: u32,
    /// The second word.
    pub word2: u32,
}

/// A program command: the two 24-bit words of its binary form.
pub type Command = (u32, u32);

/// In a command's first word: it begins a line (DPRAM manual, "Internal PMAC 48-bit command format").
pub const START_OF_LINE: u32 = 1 << 11;
const BIAS: i32 = 31;

/// The place of CODE2 in ABS, INC and FRAX unless a test sets another: the drawing has an unused field between CODE2
/// and bit 11 (DPRAM manual p. 33, diagrams B and C), as commands with CODE2 at bit 16 have (E and F), but not commands
/// with CODE2 at bit 12 (A).
pub const CODE2: RotaryCode2 = RotaryCode2::Bit16;

/// The items of one line. `home_motors` is the last motor that has a bit in HOME and HOMEZ.
///
/// # Errors
/// [`NoCommand`] for the first pair that is no command.
pub fn line(commands: &[Command], code2: RotaryCode2, home_motors: u16) -> Result<Vec<Item>, NoCommand> {
    let mut items: Vec<Item> = Vec::new();
    for &(word1, word2) in commands {
        let no_command = NoCommand { word1, word2 };
        let word = word1 & 0xFF_FFFF & !START_OF_LINE;
        let code = CODES.iter().find(|code| matches(code, word, code2)).ok_or(no_command)?;
        if let Shape::Mark { .. } = code.shape {
            let value = Data::Constant(short(word, word2));
            let mark = if code.name == ":" { Mark::Velocity } else { Mark::Trigger };
            match items.last_mut() {
                Some(Item::Axis(_, _, slot @ None)) => *slot = Some((mark, value)),
                _ => return Err(no_command),
            }
        } else {
            items.push(item(code, word, word2, home_motors).ok_or(no_command)?);
        }
    }
    Ok(items)
}

fn matches(code: &Code, word: u32, code2: RotaryCode2) -> bool {
    let (code1, low) = ((word >> 6 & 0x1F) as u8, (word & 0x3F) as u8);
    let (high, two) = ((word >> 16) as u8, (word >> 12 & 3) as u8);
    let axes = (word >> code2.lowest_bit() & 3) as u8;
    let mode = code1 == codes::MODES;
    match code.shape {
        Shape::Letter { code1: own, .. } => code1 == own,
        Shape::Data { code2 } | Shape::Mark { code2 } => code1 == codes::DATA && high == code2,
        Shape::Assignment { code1: own, code2, .. } => code1 == own && code2 == two,
        Shape::Count { code2 } | Shape::Bare { code2 } => mode && low == 0 && high & 0x1F == code2,
        Shape::Axes { code2, .. } => mode && low == 2 && axes == code2,
        Shape::Motors { subcode } => mode && low == subcode,
        Shape::Plcs { code2 } => mode && low == 1 && two & 1 == code2,
    }
}

fn item(code: &Code, word: u32, data: u32, home_motors: u16) -> Option<Item> {
    let data = data & 0xFF_FFFF;
    Some(match code.shape {
        Shape::Letter { code1, .. } => {
            let mantissa = f64::from(signed(data)) * 4096.0 + f64::from(word >> 12);
            let value = Data::Constant(mantissa * 2f64.powi((word & 0x3F) as i32 - BIAS - 35));
            letter(code1, value)?
        }
        Shape::Data { .. } => statement(code.name, Some(Data::Constant(short(word, data))))?,
        Shape::Assignment { variable, operator, .. } => {
            let operator = match operator {
                codes::Operator::Assign => Operator::Assign,
                codes::Operator::AssignLater => Operator::AssignLater,
                codes::Operator::Or => Operator::Or,
                codes::Operator::Xor | codes::Operator::And => return None,
            };
            let number = Data::Constant(f64::from(word >> 14));
            Item::Assign(
                VariableKind::from_letter(variable)?,
                number,
                operator,
                Data::Constant(short(word, data)),
            )
        }
        Shape::Count { .. } => {
            let count = match data {
                1..=1023 => data,
                1024 => 0,
                _ => return None,
            };
            let number = Data::Constant(count.into());
            match (code.name, count) {
                ("CIRCLE", 1) => Item::Mode(Mode::Circle1),
                ("CIRCLE", 2) => Item::Mode(Mode::Circle2),
                ("SPLINE", 1) => Item::Mode(Mode::Spline1),
                ("SPLINE", 2) => Item::Mode(Mode::Spline2),
                ("CC", 0..=2) => Item::CutterCompensation(count as u8),
                (name, _) => statement(name, Some(number))?,
            }
        }
        Shape::Bare { .. } => statement(code.name, None)?,
        Shape::Axes { code2, vectors } => {
            let (mode, lowest) = match code2 {
                0 => (AxisMode::Absolute, 6),
                1 => (AxisMode::Incremental, 6),
                _ => (AxisMode::Feedrate, 7),
            };
            let mut list: Vec<char> = (0..AXES.len())
                .filter(|axis| data >> (lowest + 2 * axis) & 1 == 1)
                .map(|axis| char::from(AXES[axis]))
                .collect();
            let all = list.len() == AXES.len();
            if vectors && data >> 5 & 1 == 1 {
                list.push('R');
            }
            match (list.len(), all) {
                (0, _) => return None,
                (9, true) => Item::Axes(mode, None),
                _ => Item::Axes(mode, Some(list.into())),
            }
        }
        Shape::Motors { .. } => match data & ((1 << home_motors) - 1) {
            0 => return None,
            motors => Item::Home { zero: code.name == "HOMEZ", motors },
        },
        Shape::Plcs { .. } => match data << 8 | word >> 16 & 0xFF {
            0 => return None,
            plcs if code.name == "ENABLE" => Item::Plc(PlcSwitch::Enable, plcs),
            plcs => Item::Plc(PlcSwitch::Disable, plcs),
        },
        Shape::Mark { .. } => return None,
    })
}

/// The statement of a word, with a number or alone.
fn statement(name: &str, number: Option<Data>) -> Option<Item> {
    match (Scanner::new(name.as_bytes()).keyword(words::tables(Generation::Pmac))?, number) {
        (Keyword::Alone(item), None) => Some(item),
        (Keyword::Number(item), Some(number)) => Some(item(number)),
        _ => None,
    }
}

fn letter(code1: u8, value: Data) -> Option<Item> {
    if code1 == codes::CALL {
        return Some(Item::Call(value));
    }
    let letter = b'A' + code1.checked_sub(1)?;
    Some(match AXES.iter().position(|&axis| axis == letter) {
        Some(axis) => Item::Axis(axis, value, None),
        None => Item::Letter(letter, value),
    })
}

/// A number with a 24-bit mantissa.
fn short(word: u32, data: u32) -> f64 {
    f64::from(signed(data & 0xFF_FFFF)) * 2f64.powi((word & 0x3F) as i32 - BIAS - 23)
}

fn signed(data: u32) -> i32 {
    (data << 8) as i32 >> 8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::program::item::Line;
    use crate::sim::program::text;

    #[test]
    fn words_of_the_fact_sheet_become_text() {
        for (words, expected) in [
            (&[(0x000E23, 0x500000), (0x000661, 0x980000)][..], "X10 Y-3.25"),
            (
                &[(0x000E23, 0x500000), (0x000664, 0x500000), (0x0001A2, 0x500000), (0x000361, 0x600000)],
                "X10 Y20 F5 M3",
            ),
            (&[(0x000880, 0)], "B0"),
            (&[(0x0008DF, 0x800000)], "C-1"),
            (&[(0x99AEE4, 0x509999)], "CALL20.15"),
            (&[(0x0009E0, 0x400000), (0x000622, 0x500000)], "G1 X5"),
            (&[(0x000F26, 0x640000)], "TA100"),
            (&[(0x020F27, 0x640000)], "PVT200"),
            (&[(0x000E29, 0x7D0000), (0x460725, 0x640000)], "X1000:50"),
            (&[(0x440F27, 0x7D0000)], "DWE250"),
            (&[(0x010F80, 0)], "LIN"),
            (&[(0x000F80, 1)], "CIR1"),
            (&[(0x0D0F80, 0x400)], "AROT0"),
            (&[(0x020F80, 0), (0x0002DF, 0x800000)], "NRM K-1"),
            (&[(0x000F82, 0x140000)], "ABS(X,Y)"),
            (&[(0x010F82, 0x555540)], "INC"),
            (&[(0x020F82, 0x280000)], "FRAX(X,Y)"),
            (&[(0x000F86, 0xFF)], "HMZ1..8"),
            (&[(0x001F81, 0xFFFFFF)], "DIS PLC8..31"),
            (&[(0x192B9E, 0x800000)], "P100=-0.5"),
            (&[(0x050BE7, 0x7F8000)], "M20|=255"),
            (&[(0x007BE0, 0x400000)], "M1==1"),
        ] {
            let items = line(words, CODE2, 8).unwrap();
            assert_eq!(text::line(&Line { items, offset: 0 }, false), expected);
        }
        assert!(line(&[(0x000800, 0x00FFFF)], CODE2, 8).is_err());
        assert!(line(&[(0x460725, 0x640000)], CODE2, 8).is_err(), "a mark without an axis");
    }

    #[test]
    fn the_code_of_one_board_is_another_command_to_another_board() {
        let text = |command: Command, code2| {
            text::line(&Line { items: line(&[command], code2, 8).unwrap(), offset: 0 }, false)
        };
        assert_eq!(text((0x001F82, 0x555540), RotaryCode2::Bit12), "INC");
        assert_eq!(text((0x001F82, 0x555540), RotaryCode2::Bit16), "ABS");
        for word1 in [0x051BE7, 0x052BE7] {
            assert!(line(&[(word1, 0x7F8000)], CODE2, 8).is_err(), "^= and &= have no sure code");
        }
    }
}
