//! Set-up calculators (layer 1): the lines to send to a board, and why. They only compute; they send nothing.
//!
//! [`isa`] and [`vme`] give the lines that place the DPRAM in the host's memory, [`enable`] those that switch the
//! automatic functions on. [`absolute`] tells which registers an absolute-position word makes PMAC read, and
//! [`position`] computes the position. The addresses here are those of PMAC's set-up registers (X:$0783 to X:$078C,
//! Turbo I90 to I99); the DPRAM's own come from [`crate::map`].

pub mod absolute;
#[cfg(test)]
mod absolute_tests;
pub mod enable;
#[cfg(test)]
mod enable_tests;
pub mod isa;
pub mod vme;
#[cfg(test)]
mod vme_tests;

pub use absolute::position;

use std::fmt;

use serde::{Serialize, Serializer};

/// The bytes of the DPRAM that a board shows at a time, and the multiple at which they start: 16 KiB.
pub const WINDOW: u32 = 0x4000;

/// The lines that place a board's DPRAM, in order, and the meaning of every part.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct SetupPlan {
    /// The on-line command lines, `SAVE` and `$$$` included.
    pub commands: Vec<String>,
    /// The byte that the host writes on the bus after every reset, before it touches the DPRAM; `None` if it writes
    /// none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub after_reset: Option<Vec<BusWrite>>,
    /// The values in the lines, register by register.
    pub values: Vec<SetupValue>,
    /// Settings that are possible but that the user likely does not want.
    pub warnings: Vec<String>,
}

/// One byte that the host writes on its own bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct BusWrite {
    /// The bus address of the byte. `0x…` in JSON.
    #[serde(serialize_with = "hexadecimal")]
    pub address: u32,
    /// The byte. `0x…` in JSON.
    #[serde(serialize_with = "hexadecimal")]
    pub value: u8,
}

fn hexadecimal<S: Serializer>(
    number: &(impl fmt::UpperHex + Copy),
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.collect_str(&format_args!("0x{number:02X}"))
}

/// A set-up register and the meaning of its value.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct SetupValue {
    /// `X:$0786` or `I93`.
    pub register: String,
    /// The value, `$0E`.
    pub value: String,
    /// Its bits, highest first.
    pub fields: Vec<BitField>,
    #[serde(skip)]
    number: u32,
}

/// Some bits of a register and their meaning.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct BitField {
    /// Which: `7-6`, or `2`.
    pub bits: String,
    /// As binary digits.
    pub value: String,
    /// Their meaning.
    pub meaning: String,
}

impl SetupValue {
    /// A register's 8-bit value, not explained yet.
    fn new(register: String, number: u32) -> Self {
        Self { register, value: format!("${number:02X}"), fields: Vec::new(), number }
    }

    /// Explains the bits `high` to `low`.
    fn field(mut self, high: u32, low: u32, meaning: impl Into<String>) -> Self {
        let width = high - low + 1;
        let bits = if width == 1 { high.to_string() } else { format!("{high}-{low}") };
        let value = (self.number >> low) & ((1 << width) - 1);
        let value = format!("{value:0digits$b}", digits = width as usize);
        self.fields.push(BitField { bits, value, meaning: meaning.into() });
        self
    }
}

/// `SAVE` keeps the values over a reset, and only a reset makes the board use them.
fn with_save_and_reset(mut lines: Vec<String>) -> Vec<String> {
    lines.extend(["SAVE".to_owned(), "$$$".to_owned()]);
    lines
}

/// The address of the last byte of the window at `start`, for messages.
const fn last_of_window(start: u32) -> u32 {
    start.saturating_add(WINDOW - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_cut_out_as_they_lie() {
        let value =
            SetupValue::new("X:$0787".to_owned(), 0xC5).field(7, 6, "a").field(2, 2, "b").field(1, 1, "c");
        let cut: Vec<_> =
            value.fields.iter().map(|field| (field.bits.as_str(), field.value.as_str())).collect();
        assert_eq!(cut, [("7-6", "11"), ("2", "1"), ("1", "0")]);
        assert_eq!(value.value, "$C5");
    }
}
