//! The coordinate systems: time base and status words.
//!
//! The time base moves each servo cycle toward the word at Ix93's address (0 in feed hold) by at most Ix94, or Ix95 in
//! and out of a hold (Software Reference pp. 122-125). Everything else of a coordinate system is a register in memory.

use crate::format::int24;
use crate::sim::board::memory::Memory;
use crate::sim::board::offsets;
use crate::sim::board::variables::Variables;

/// Largest 24-bit positive value, where an override saturates.
const FULL: f64 = 8_388_607.0;
/// `??` word 1 after a reset: FRAX(X,Y,Z), axes absolute, circle vectors incremental, nothing running.
const STATUS_AT_RESET: u32 = 0xA8_0020;
/// `??` word 1, bit 0: a program runs.
const RUNNING: u32 = 1;

/// One coordinate system.
#[derive(Debug, Clone, Default)]
pub struct CoordinateSystem {
    /// Present time base in units of I10.
    present: f64,
    held: bool,
    resuming: bool,
}

impl CoordinateSystem {
    /// At 100%, with nothing running.
    pub fn reset(&mut self, index: usize, variables: &Variables, memory: &mut Memory) {
        let full = variables.i(10);
        *self = Self { present: full, held: false, resuming: false };
        memory.write_x(offsets::background(offsets::TIME_BASE_COMMANDED, index), full as u32);
        memory.write_x(offsets::background(offsets::TIME_BASE_PRESENT, index), full as u32);
        memory.write_x(offsets::background(offsets::COORDINATE_STATUS, index), STATUS_AT_RESET);
        memory.write_y(offsets::background(offsets::PROGRAM_STATUS, index), 0);
    }

    /// One servo cycle; gives the time base as a factor, 1.0 at 100%.
    pub fn cycle(&mut self, index: usize, variables: &Variables, memory: &mut Memory) -> f64 {
        let x = 100 * (index + 1);
        let commanded = if self.held {
            0.0
        } else {
            f64::from(int24::signed(memory.read_x(variables.i(x + 93) as u16))).max(0.0)
        };
        let rate = variables.i(if self.held || self.resuming { x + 95 } else { x + 94 });
        let step = (commanded - self.present).clamp(-rate, rate);
        self.present += step;
        if self.present == commanded {
            self.resuming = false;
        }
        if step != 0.0 {
            memory.write_x(offsets::background(offsets::TIME_BASE_PRESENT, index), self.present as u32);
        }
        let full = variables.i(10);
        if full > 0.0 { self.present / full } else { 0.0 }
    }

    /// `H`: the time base goes to zero.
    pub fn hold(&mut self) {
        self.held = true;
    }

    /// Out of a hold: the time base goes back.
    pub fn resume(&mut self) {
        self.resuming |= self.held;
        self.held = false;
    }
}

/// `%{percent}`.
pub fn set_override(index: usize, percent: f64, variables: &Variables, memory: &mut Memory) {
    let value = (percent * variables.i(10) / 100.0).round().clamp(0.0, FULL);
    memory.write_x(offsets::background(offsets::TIME_BASE_COMMANDED, index), value as u32);
}

/// `%`.
pub fn override_percent(index: usize, variables: &Variables, memory: &Memory) -> f64 {
    let value = memory.read_x(offsets::background(offsets::TIME_BASE_COMMANDED, index));
    let full = variables.i(10);
    if full > 0.0 { 100.0 * f64::from(int24::signed(value)) / full } else { 0.0 }
}

/// Whether a motion program runs in the coordinate system.
pub fn running(index: usize, memory: &Memory) -> bool {
    memory.read_x(offsets::background(offsets::COORDINATE_STATUS, index)) & RUNNING != 0
}

/// Ends a program: `??` word 1 without "running", single step and continuous motion.
pub fn stop_program(index: usize, memory: &mut Memory) {
    let address = offsets::background(offsets::COORDINATE_STATUS, index);
    let status = memory.read_x(address);
    memory.write_x(address, status & !0b1_0111);
}
