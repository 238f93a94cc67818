//! The position that a motor takes from its absolute sensor at power-on and `$*`: the value of the sensor that Ix10
//! names (on Turbo Ixx10 with Ixx95), less Ix26 (Software Reference, Ix10; Turbo Software Reference p. 154, which
//! prints Ixx81 for Ixx10).
//!
//! The board reads parallel words and the A/D converters of Acc-28 from the registers. Sensors at the multiplexer port
//! and at MACRO stations are not in the memory: the simulator takes the position of the motor's shaft for them.

use super::Board;
use crate::map::Generation;

const WORD_BITS: u32 = 24;
/// In the format: the position is a two's complement number.
const SIGNED: u32 = 0x80;
/// In the format of parallel data: X registers.
const X: u32 = 0x40;
/// The format of an Acc-28.
const ACC28: u32 = 0x31;

impl Board {
    /// In counts; `None` where the motor has no absolute sensor.
    pub(super) fn sensed_position(&self, motor: usize) -> Option<f64> {
        let named = self.ix(motor, 10) as u32;
        if named == 0 {
            return None;
        }
        let (address, form) = match self.family().generation {
            Generation::Pmac => (named & 0xFFFF, named & 0xFF_0000),
            Generation::Turbo => (named, self.ix(motor, 95) as u32),
        };
        let sensed =
            self.sensor(address, form).map_or_else(|| self.motors[motor].shaft(), |counts| counts as f64);
        Some(sensed - self.ix(motor, 26) / 16.0)
    }

    /// The value of the registers from `address` on, in the form of Ixx95.
    fn sensor(&self, address: u32, form: u32) -> Option<i64> {
        let format = form >> 16 & 0xFF;
        let read = |offset: u32| {
            let number = address + offset;
            let word = if format & X != 0 { self.memory.read_x(number) } else { self.memory.read_y(number) };
            u64::from(word & 0xFF_FFFF)
        };
        let (value, bits) = match format & !SIGNED {
            ACC28 => (read(0) >> 8, 16),
            code @ (0x08..=0x30 | 0x48..=0x70) => {
                // Whole words, or one byte of each: the low, the middle or the high one.
                let (piece, shift) = match form & 0xF {
                    byte @ 4..=6 => (8, 8 * (byte - 4)),
                    _ => (WORD_BITS, 0),
                };
                let bits = code & !X;
                let pieces = (0..bits.div_ceil(piece)).map(|index| {
                    let part = read(index) >> shift & ((1 << piece) - 1);
                    part << (piece * index)
                });
                (pieces.fold(0, |value, part| value | part) & ((1 << bits) - 1), bits)
            }
            _ => return None,
        };
        let negative = format & SIGNED != 0 && value >> (bits - 1) & 1 == 1;
        Some(value as i64 - if negative { 1 << bits } else { 0 })
    }
}
