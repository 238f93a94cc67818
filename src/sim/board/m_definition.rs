//! M-variable definitions: the address of an M-variable and the format of its bits (Software Reference p. 253).
//!
//! `X:$C003,8,16,S` is 16 signed bits from bit 8 of an X word; `D:` and `L:` are 48-bit fixed and floating point, `DP:`
//! and `F:` the 32 bits of a DPRAM location as integer and as IEEE single. `TW*:` are inputs behind the thumbwheel
//! multiplexer. The simulated board has no multiplexer, so they read 0.

use crate::format::{fixed48, float32, float48, int24};
use crate::sim::board::memory::Memory;
use crate::sim::board::number::decimal;

/// The half of an address that holds a bit field.
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
        address: u32,
        /// Lowest bit, 0-23.
        offset: u8,
        /// Number of bits; with `offset` at most 24.
        width: u8,
        /// Reading.
        format: Format,
    },
    /// `D:` 48-bit fixed point.
    Fixed(u32),
    /// `L:` 48-bit floating point.
    Long(u32),
    /// `F:` IEEE single in DPRAM.
    Single(u32),
    /// `DP:` 32-bit integer in DPRAM.
    Dual(u32),
    /// `TWB:`, `TWD:`, `TWR:`, `TWS:` with their arguments.
    Thumbwheel {
        /// `B`, `D`, `R` or `S`.
        kind: char,
        /// Multiplexer address, offset, size.
        arguments: Vec<f64>,
        /// The letter of the last argument, if any.
        format: Option<char>,
    },
}

/// The fields that a definition can name, in the order of their codes: each bit alone, and wider ones from each fourth bit on
/// (Software Reference p. 262).
const FIELDS: [(u8, u8, Format); 108] = {
    let mut fields = [(0, 1, Format::Unsigned); 108];
    let (mut index, mut width) = (0, 1);
    while width <= 24 {
        let (step, formats) = if width == 1 { (1, 1) } else { (4, FORMATS.len()) };
        let mut offset = 0;
        while offset + width <= 24 {
            let mut format = 0;
            while format < formats {
                fields[index] = (offset, width, FORMATS[format]);
                (index, format) = (index + 1, format + 1);
            }
            offset += step;
        }
        width = if width == 1 { 4 } else { width + 4 };
    }
    fields
};
const FORMATS: [Format; 4] = [Format::Unsigned, Format::Signed, Format::Decimal, Format::ComplementDecimal];

/// The codes below are of variables that point nowhere: four bits of the code belong to the value.
const FIRST_CODE: u32 = 16;
const WHOLE: [fn(u32) -> MDefinition; 4] =
    [MDefinition::Fixed, MDefinition::Long, MDefinition::Single, MDefinition::Dual];
const THUMBWHEEL_CODE: u32 = FIRST_CODE + WHOLE.len() as u32;
const FIELD_CODE: u32 = THUMBWHEEL_CODE + 1;

impl MDefinition {
    /// The 8 bits beside the address in which the board keeps the rest of the definition, and the address. `None` for a
    /// field that no code names. User Manual p. 154 says that the board has such bits, but not their meaning: these
    /// codes are the simulator's own.
    #[must_use]
    pub fn to_code(&self) -> Option<(u32, u32)> {
        let whole = |index: u32| FIRST_CODE + index;
        Some(match *self {
            Self::None => (0, 0),
            Self::Fixed(address) => (whole(0), address),
            Self::Long(address) => (whole(1), address),
            Self::Single(address) => (whole(2), address),
            Self::Dual(address) => (whole(3), address),
            Self::Thumbwheel { .. } => (THUMBWHEEL_CODE, 0),
            Self::Field { half, address, offset, width, format } => {
                let format = if width == 1 { Format::Unsigned } else { format };
                let index = FIELDS.iter().position(|&field| field == (offset, width, format))?;
                let first = if half == Half::X { 0 } else { FIELDS.len() };
                (FIELD_CODE + (first + index) as u32, address)
            }
        })
    }

    /// The definition with code `code`. `None` also for an input behind the multiplexer: the code does not hold all of
    /// its definition.
    #[must_use]
    pub fn from_code(code: u32, address: u32) -> Self {
        let index = |first| code.checked_sub(first).map(|index| index as usize);
        if let Some(whole) = index(FIRST_CODE).and_then(|index| WHOLE.get(index)) {
            return whole(address);
        }
        let Some(index) = index(FIELD_CODE).filter(|&index| index < 2 * FIELDS.len()) else {
            return Self::None;
        };
        let (offset, width, format) = FIELDS[index % FIELDS.len()];
        let half = if index < FIELDS.len() { Half::X } else { Half::Y };
        Self::Field { half, address, offset, width, format }
    }

    /// The address that the definition points to.
    #[must_use]
    pub const fn address(&self) -> Option<u32> {
        match *self {
            Self::Field { address, .. }
            | Self::Fixed(address)
            | Self::Long(address)
            | Self::Single(address)
            | Self::Dual(address) => Some(address),
            Self::None | Self::Thumbwheel { .. } => None,
        }
    }

    /// The value at the definition's address; `None` without an address.
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

    /// Writes `value`; `false` without an address. The board loses a value for the multiplexer: no device is connected.
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

fn word(memory: &Memory, half: Half, address: u32) -> u32 {
    match half {
        Half::X => memory.read_x(address),
        Half::Y => memory.read_y(address),
    }
}

fn write_pair(memory: &mut Memory, address: u32, [y, x]: [u32; 2]) {
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
