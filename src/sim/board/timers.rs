//! Countdown timers: a program writes a number of servo cycles to a timer and waits until the board has counted it down
//! (Turbo Software Reference p. 176; PMAC Quick Reference p. 65).

use crate::format::int24;
use crate::sim::board::Board;

/// Where a timer stops.
const LOWEST: i32 = -0x80_0000;
/// I68: the number of active coordinate systems less one, on Turbo.
const ACTIVE_SYSTEMS: usize = 68;

impl Board {
    /// Counts each timer down by one servo cycle. A coordinate system's timers run while I68 activates the system.
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
