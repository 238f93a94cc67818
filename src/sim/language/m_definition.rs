//! M-variable definitions: where an M-variable points and how the bits there are read (Software Reference p. 253).
//!
//! `X:$C003,8,16,S` is 16 signed bits from bit 8 of an X word; `D:` and `L:` are 48-bit fixed and floating point, `DP:`
//! and `F:` the 32 bits of a DPRAM location as integer and as IEEE single, `TW*:` inputs behind the thumbwheel
//! multiplexer, of which the simulated board has none: they read 0.

use super::number::decimal;
use super::scanner::Scanner;
use super::{CommandError, Memory};
use crate::format::{fixed48, float32, float48, int24};

/// Field widths that a definition may name.
const WIDTHS: [u8; 7] = [1, 4, 8, 12, 16, 20, 24];

/// Which word of an address a bit field lies in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Half {
    /// The X word.
    X,
    /// The Y word.
    Y,
}

/// How the bits of a field are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Unsigned.
    Unsigned,
    /// Two's complement.
    Signed,
    /// A decimal digit every four bits.
    Decimal,
    /// The same, complemented.
    ComplementDecimal,
}

const FORMATS: [(u8, Format); 4] = [
    (b'U', Format::Unsigned),
    (b'S', Format::Signed),
    (b'D', Format::Decimal),
    (b'C', Format::ComplementDecimal),
];

/// Where an M-variable points.
#[derive(Debug, Clone, PartialEq)]
pub enum MDefinition {
    /// `*`: nowhere; the variable keeps its value itself.
    None,
    /// `X:` or `Y:` bits of a 24-bit word.
    Field {
        /// The word.
        half: Half,
        /// Its address.
        address: u16,
        /// Lowest bit, 0-23.
        offset: u8,
        /// Number of bits; with `offset` at most 24.
        width: u8,
        /// Reading.
        format: Format,
    },
    /// `D:` 48-bit fixed point.
    Fixed(u16),
    /// `L:` 48-bit floating point.
    Long(u16),
    /// `F:` IEEE single in DPRAM.
    Single(u16),
    /// `DP:` 32-bit integer in DPRAM.
    Dual(u16),
    /// `TWB:`, `TWD:`, `TWR:`, `TWS:` with their arguments.
    Thumbwheel {
        /// `B`, `D`, `R` or `S`.
        kind: char,
        /// Multiplexer address, offset, size.
        arguments: Vec<f64>,
        /// The letter of the last argument, if one was given.
        format: Option<char>,
    },
}

#[derive(Clone, Copy)]
enum Prefix {
    Half(Half),
    Fixed,
    Long,
    Single,
    Dual,
    Thumbwheel(char),
}

const PREFIXES: &[(&str, Prefix)] = &[
    ("X", Prefix::Half(Half::X)),
    ("Y", Prefix::Half(Half::Y)),
    ("D", Prefix::Fixed),
    ("L", Prefix::Long),
    ("F", Prefix::Single),
    ("DP", Prefix::Dual),
    ("TWB", Prefix::Thumbwheel('B')),
    ("TWD", Prefix::Thumbwheel('D')),
    ("TWR", Prefix::Thumbwheel('R')),
    ("TWS", Prefix::Thumbwheel('S')),
];

impl MDefinition {
    /// Reads what follows `->`. `None` when nothing does: the definition is asked for, not given.
    ///
    /// # Errors
    /// ERR003 for an address above `last`, a field that is not inside a word, and anything not understood.
    pub fn parse(scanner: &mut Scanner, last: u32) -> Result<Option<Self>, CommandError> {
        if scanner.take(b'*') {
            return Ok(Some(Self::None));
        }
        let mut ahead = scanner.clone();
        let Some(prefix) = ahead.keyword(&[PREFIXES]) else { return Ok(None) };
        let colon = ahead.take(b':');
        if !colon && !ahead.at_unsigned() {
            return Ok(None);
        }
        *scanner = ahead;
        if let Prefix::Thumbwheel(kind) = prefix {
            return Self::thumbwheel(scanner, kind).map(Some);
        }
        let address = scanner.address(last)?;
        Ok(Some(match prefix {
            Prefix::Half(half) => Self::field(scanner, half, address)?,
            Prefix::Fixed => Self::Fixed(address),
            Prefix::Long => Self::Long(address),
            Prefix::Single => Self::Single(address),
            Prefix::Dual | Prefix::Thumbwheel(_) => Self::Dual(address),
        }))
    }

    fn field(scanner: &mut Scanner, half: Half, address: u16) -> Result<Self, CommandError> {
        let mut offset = if scanner.take(b',') { small(scanner)? } else { 0 };
        let mut width = 1;
        let mut format = Format::Unsigned;
        let mut more = scanner.take(b',');
        if offset == 24 {
            (offset, width) = (0, 24);
        } else if more {
            width = small(scanner)?;
            more = scanner.take(b',');
        }
        if more {
            let letter = scanner.next_character();
            format = FORMATS
                .iter()
                .find(|(name, _)| Some(*name) == letter)
                .map(|(_, format)| *format)
                .ok_or(CommandError::SYNTAX)?;
        }
        let inside = u32::from(offset) + u32::from(width) <= 24;
        if !WIDTHS.contains(&width) || !inside {
            return Err(CommandError::SYNTAX);
        }
        Ok(Self::Field { half, address, offset, width, format })
    }

    fn thumbwheel(scanner: &mut Scanner, kind: char) -> Result<Self, CommandError> {
        let mut arguments = vec![scanner.unsigned()?];
        let mut format = None;
        while arguments.len() < 4 && scanner.take(b',') {
            if scanner.at_unsigned() {
                arguments.push(scanner.unsigned()?);
                continue;
            }
            let letter =
                scanner.next_character().filter(|c| b"USDC".contains(c)).ok_or(CommandError::SYNTAX)?;
            format = Some(char::from(letter));
            break;
        }
        Ok(Self::Thumbwheel { kind, arguments, format })
    }

    /// The value it points to; `None` when it points nowhere.
    #[must_use]
    pub fn read(&self, memory: &Memory) -> Option<f64> {
        Some(match *self {
            Self::None => return None,
            Self::Field { half, address, offset, width, format } => {
                let bits = word(memory, half, address) >> offset & mask(width);
                match format {
                    Format::Unsigned => f64::from(bits),
                    Format::Signed => f64::from((bits << (32 - width)) as i32 >> (32 - width)),
                    Format::Decimal => from_decimal(bits, width),
                    Format::ComplementDecimal => from_decimal(!bits & mask(width), width),
                }
            }
            Self::Fixed(address) => fixed48::decode(memory.read_y(address), memory.read_x(address)) as f64,
            Self::Long(address) => float48::decode(memory.read_y(address), memory.read_x(address)),
            Self::Single(address) => {
                let value =
                    f64::from(float32::decode(memory.read_y(address) as u16, memory.read_x(address) as u16));
                if value.is_nan() { 0.0 } else { value }
            }
            Self::Dual(address) => {
                f64::from(crate::format::join32(memory.read_y(address) as u16, memory.read_x(address) as u16)
                    as i32)
            }
            Self::Thumbwheel { .. } => 0.0,
        })
    }

    /// Writes `value`; `false` when it points nowhere. What goes to the multiplexer is lost, as nothing hangs there.
    pub fn write(&self, memory: &mut Memory, value: f64) -> bool {
        let whole = value.round_ties_even() as i64;
        match *self {
            Self::None => return false,
            Self::Field { half, address, offset, width, format } => {
                let bits = match format {
                    Format::Unsigned | Format::Signed => whole as u32,
                    Format::Decimal => to_decimal(whole, width),
                    Format::ComplementDecimal => !to_decimal(whole, width),
                } & mask(width);
                let kept = word(memory, half, address) & !(mask(width) << offset);
                let new = kept | bits << offset;
                match half {
                    Half::X => memory.write_x(address, new),
                    Half::Y => memory.write_y(address, new),
                }
            }
            Self::Fixed(address) => write_pair(memory, address, fixed48::encode(whole)),
            Self::Long(address) => write_pair(memory, address, float48::encode(value)),
            Self::Single(address) => {
                write_pair(memory, address, float32::encode(value as f32).map(u32::from));
            }
            Self::Dual(address) => {
                write_pair(memory, address, crate::format::split32(whole as u32).map(u32::from));
            }
            Self::Thumbwheel { .. } => {}
        }
        true
    }

    /// The definition as `M5->` lists it.
    #[must_use]
    pub fn text(&self) -> String {
        match self {
            Self::None => "*".to_owned(),
            Self::Field { half, address, offset, width, format } => {
                let half = if *half == Half::X { 'X' } else { 'Y' };
                let bits = match (*offset, *width) {
                    (0, 24) => "24".to_owned(),
                    (offset, 1) if *format == Format::Unsigned => offset.to_string(),
                    (offset, width) => format!("{offset},{width}"),
                };
                let format = match format {
                    Format::Unsigned => "",
                    Format::Signed => ",S",
                    Format::Decimal => ",D",
                    Format::ComplementDecimal => ",C",
                };
                format!("{half}:${address:X},{bits}{format}")
            }
            Self::Fixed(address) => format!("D:${address:X}"),
            Self::Long(address) => format!("L:${address:X}"),
            Self::Single(address) => format!("F:${address:X}"),
            Self::Dual(address) => format!("DP:${address:X}"),
            Self::Thumbwheel { kind, arguments, format } => {
                let mut text: Vec<String> = arguments.iter().map(|value| decimal(*value, 9)).collect();
                text.extend(format.map(String::from));
                format!("TW{kind}:{}", text.join(","))
            }
        }
    }
}

fn small(scanner: &mut Scanner) -> Result<u8, CommandError> {
    let value = scanner.integer()?;
    if value <= 24 { Ok(value as u8) } else { Err(CommandError::SYNTAX) }
}

fn word(memory: &Memory, half: Half, address: u16) -> u32 {
    match half {
        Half::X => memory.read_x(address),
        Half::Y => memory.read_y(address),
    }
}

fn write_pair(memory: &mut Memory, address: u16, [y, x]: [u32; 2]) {
    memory.write_y(address, y & int24::MASK);
    memory.write_x(address, x & int24::MASK);
}

const fn mask(width: u8) -> u32 {
    (1 << width) - 1
}

fn from_decimal(bits: u32, width: u8) -> f64 {
    let digits = (width / 4).max(1);
    (0..digits).rev().fold(0.0, |value, digit| value * 10.0 + f64::from(bits >> (4 * digit) & 0xF))
}

fn to_decimal(value: i64, width: u8) -> u32 {
    let mut rest = value.unsigned_abs();
    (0..(width / 4).max(1)).fold(0, |bits, digit| {
        let nibble = (rest % 10) as u32;
        rest /= 10;
        bits | nibble << (4 * digit)
    })
}

#[cfg(test)]
mod tests {
    use super::super::testing;
    use super::*;

    fn parse(text: &str) -> Result<Option<MDefinition>, CommandError> {
        MDefinition::parse(&mut Scanner::new(text.as_bytes()), 0xFFFF)
    }

    #[test]
    fn definitions_list_in_the_short_form() {
        for (typed, listed) in [
            ("*", "*"),
            ("X:$C001,24,S", "X:$C001,24,S"),
            ("x:$c001,0,24,s", "X:$C001,24,S"),
            ("Y:$C003,8,16,S", "Y:$C003,8,16,S"),
            ("Y:$FFC2,8", "Y:$FFC2,8"),
            ("Y:$FFC2,8,1,U", "Y:$FFC2,8"),
            ("Y:$FFC2", "Y:$FFC2,0"),
            ("Y:49152,0,4,D", "Y:$C000,0,4,D"),
            ("X$0806,24", "X:$806,24"),
            ("D:$28", "D:$28"),
            ("L:$1000", "L:$1000"),
            ("F:$D210", "F:$D210"),
            ("DP:$D200", "DP:$D200"),
            ("TWD:4,0.8,U", "TWD:4,0.8,U"),
            ("TWS:1", "TWS:1"),
        ] {
            assert_eq!(parse(typed).unwrap().unwrap().text(), listed, "{typed}");
        }
    }

    #[test]
    fn what_is_no_definition() {
        for text in ["X:$10000,0", "X:$C000,25", "X:$C000,20,8", "X:$C000,0,5", "X:$C000,0,8,Q", "X:", "DP:"]
        {
            assert_eq!(parse(text), Err(CommandError::SYNTAX), "{text}");
        }
        assert_eq!(parse(""), Ok(None));
        assert_eq!(parse("M2->"), Ok(None));
    }

    #[test]
    fn fields_read_and_write_their_bits_only() {
        let mut board = testing::board();
        let memory = &mut board.memory;
        memory.write_y(0x700, 0xABCDEF);
        for (text, value, read, word) in [
            ("Y:$700,8,8", 257.0, 1.0, 0xAB01EF),
            ("Y:$700,8,8,S", -1.0, -1.0, 0xABFFEF),
            ("Y:$700,0,4", 16.4, 0.0, 0xABFFE0),
            ("Y:$700,0,12,D", 1234.0, 234.0, 0xABF234),
            ("Y:$700,0,12,C", 234.0, 234.0, 0xABFDCB),
            ("Y:$700,24,S", -16384.0, -16384.0, 0xFFC000),
            ("Y:$700,23", 0.0, 0.0, 0x7FC000),
        ] {
            let definition = parse(text).unwrap().unwrap();
            assert!(definition.write(memory, value));
            assert_eq!((definition.read(memory), memory.read_y(0x700)), (Some(read), word), "{text}={value}");
        }
    }

    #[test]
    fn wide_forms_keep_their_value() {
        let mut board = testing::board();
        let memory = &mut board.memory;
        for (text, value) in [
            ("D:$28", -6_000_000_000.0),
            ("L:$1000", 5.75),
            ("F:$D210", -0.5),
            ("DP:$D200", -70000.0),
            ("DP:$D204", 2_147_483_647.0),
        ] {
            let definition = parse(text).unwrap().unwrap();
            assert!(definition.write(memory, value));
            assert_eq!(definition.read(memory), Some(value), "{text}");
        }
        assert!(!MDefinition::None.write(memory, 1.0));
    }
}
