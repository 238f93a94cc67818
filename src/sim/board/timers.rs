//! Countdown timers: programs write a number of servo cycles there and wait until it has gone down (Turbo Software Reference p. 176;
//! PMAC Quick Reference p. 65).

use crate::format::int24;
use crate::sim::board::Board;

/// Where a timer stops.
const LOWEST: i32 = -0x80_0000;
/// The number of active coordinate systems less one, on Turbo.
const ACTIVE_SYSTEMS: usize = 68;

impl Board {
    /// A servo cycle passes: each timer goes down by one. Those of a coordinate system run while I68 activates the system.
    pub(super) fn count_down(&mut self) {
        let tables = self.identity.tables;
        for &register in tables.registers.timers {
            let left = int24::signed(self.memory.read(register));
            self.memory.write(register, (left - 1).max(LOWEST) as u32);
        }
        let active = (self.variables.i(ACTIVE_SYSTEMS) as usize + 1).min(self.coordinates.len());
        for cs in 0..active {
            for &n in tables.settings.timers {
                let number = tables.coordinate_i(cs, n);
                let left = self.variables.i(number);
                self.variables.set_i(number, (left - 1.0).max(LOWEST.into()));
            }
        }
    }
}
