//! Whether the firmware makes the servo report, as far as its timer shows without a write.

use crate::device::{Bus, BusError};
use crate::function::servo::read_timer;
use crate::map::ServoBlock;

/// How often to look.
const LOOK_NS: u64 = 500_000;
/// How often the timer must have moved on, and never back: a word that a program keeps there may change, too.
const MOVES: u32 = 4;

/// Looks at the timer of a report that is not used yet.
#[derive(Default)]
pub struct ServoSign {
    timer: Option<u32>,
    moves: u32,
    due_ns: u64,
}

impl ServoSign {
    /// When to look next.
    #[must_use]
    pub const fn due_ns(&self) -> u64 {
        self.due_ns
    }

    /// Reads the timer of `report` at `now_ns`: whether it runs.
    ///
    /// # Errors
    /// When the bus cannot be reached.
    pub fn look(&mut self, bus: &mut impl Bus, report: &ServoBlock, now_ns: u64) -> Result<bool, BusError> {
        let timer = read_timer(bus, report)?;
        let turn = 1 << report.timer.bits();
        let last = self.timer.replace(timer).unwrap_or(timer);
        let on = (timer + turn - last) % turn;
        self.moves = match on {
            0 => self.moves,
            _ if on < turn / 2 => self.moves + 1,
            _ => 0,
        };
        self.due_ns = now_ns + LOOK_NS;
        Ok(self.moves >= MOVES)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::FileBoard;
    use crate::map::PMAC;
    use crate::map::pmac::SERVO_PMAC_STATUS;

    #[test]
    fn a_timer_that_runs_is_a_sign_and_a_word_that_jumps_is_none() {
        let file = tempfile::tempfile().unwrap();
        file.set_len(0x4000).unwrap();
        let mut bus = FileBoard::from_file(&file, 0x4000).unwrap();
        let mut seen = |values: &[u16]| {
            let mut sign = ServoSign::default();
            let mut runs = Vec::new();
            for value in values {
                bus.write16(SERVO_PMAC_STATUS, *value).unwrap();
                runs.push(sign.look(&mut bus, &PMAC.servo, 7).unwrap());
            }
            assert_eq!(sign.due_ns(), 7 + LOOK_NS);
            runs
        };
        assert_eq!(seen(&[7, 7, 8, 9, 9, 10, 12]), [false, false, false, false, false, false, true]);
        assert_eq!(seen(&[0x7FFE, 0x7FFF, 0, 1, 2]), [false, false, false, false, true], "it comes round");
        assert!(!seen(&[5, 6, 7, 8, 3, 4, 5, 6, 1]).contains(&true), "it goes back");
    }
}
