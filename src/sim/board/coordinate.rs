//! The coordinate systems: time base and status words.
//!
//! The time base moves each servo cycle toward the word at Ix93's address (0 in feed hold) by at most Ix94, or Ix95 in
//! and out of a hold (Software Reference pp. 122-125). All other state of a coordinate system is in memory registers.

use crate::format::int24;
use crate::sim::board::memory::Memory;
use crate::sim::board::variables::Variables;

/// `??` word 1 after a reset: FRAX(X,Y,Z), axes absolute, circle vectors incremental, nothing running.
const STATUS_AT_RESET: u32 = 0xA8_0020;

/// A coordinate system.
#[derive(Debug, Clone, Default)]
pub struct CoordinateSystem {
    /// Present time base in units of I10.
    present: f64,
    /// The time base as a fraction of 100%.
    factor: f64,
    held: bool,
    resuming: bool,
}

impl CoordinateSystem {
    /// At 100%, with nothing running.
    pub fn reset(&mut self, index: usize, variables: &Variables, memory: &mut Memory) {
        let full = variables.i(10);
        *self = Self { present: full, factor: 1.0, held: false, resuming: false };
        let at = memory.registers();
        memory.write(at.time_base_commanded.of(index), full as u32);
        memory.write(at.time_base_present.of(index), full as u32);
        memory.write(at.coordinate_status.of(index), STATUS_AT_RESET);
        memory.write(at.program_status.of(index), 0);
    }

    /// One servo cycle.
    pub fn cycle(&mut self, index: usize, variables: &Variables, memory: &mut Memory) {
        let ix = |n| variables.i(memory.tables().coordinate_i(index, n));
        let commanded =
            if self.held { 0.0 } else { f64::from(int24::signed(memory.read_x(ix(93) as u32))).max(0.0) };
        let rate = ix(if self.held || self.resuming { 95 } else { 94 });
        let step = (commanded - self.present).clamp(-rate, rate);
        self.present += step;
        if self.present == commanded {
            self.resuming = false;
        }
        if step != 0.0 {
            memory.write(memory.registers().time_base_present.of(index), self.present as u32);
        }
        let full = variables.i(10);
        self.factor = if full > 0.0 { self.present / full } else { 0.0 };
    }

    /// The time base as a factor, 1.0 at 100%.
    #[must_use]
    pub fn factor(&self) -> f64 {
        self.factor
    }

    /// Whether the coordinate system is in a feed hold.
    #[must_use]
    pub fn is_held(&self) -> bool {
        self.held
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
