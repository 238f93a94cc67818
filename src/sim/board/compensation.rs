//! Leadscrew and backlash compensation: counts that the board adds to a motor's measured position (User Manual,
//! "Leadscrew compensation" and "Backlash compensation"; I51, I99, Ix85, Ix86).
//!
//! A register holds the sum in units of the actual position. The loop closes on both together, and `P` reports both.
//!
//! `DEFINE COMP` tables hold 1/16 counts and work while I51=1. Several tables may correct one motor.
//!
//! The board adds the backlash, Ix86 1/16 counts, when the commanded position has gone back by more than I99 1/16
//! counts from its highest, and takes the backlash away on the way up. The added backlash changes by Ix85 1/16 counts a
//! background pass; with Ix85=0 the board adds no backlash. The board adds the value of a `BLCOMP` table to Ix86. (The
//! status bit shows that the backlash belongs to the negative direction. The units are the manual's.)

use crate::sim::board::Board;
use crate::sim::board::motor::backlash::Backlash;

/// Table entries, Ix85, Ix86 and I99 a count.
const UNITS: f64 = 16.0;

impl Board {
    /// Adds the 0-based `motor`'s compensation to its actual position: `leadscrew`, the 1/16 counts from the leadscrew
    /// tables, and the backlash taken up.
    pub fn compensate(&mut self, motor: usize, leadscrew: f64) {
        let tables = if self.variables.i(51) == 1.0 { leadscrew / UNITS } else { 0.0 };
        let sum = tables + self.motors[motor].backlash.added;
        if sum != self.motors[motor].compensation {
            self.motors[motor].compensation = sum;
            let units = (sum * self.ix(motor, 8) * 32.0).round() as i64;
            self.memory.write_d(self.memory.registers().compensation.of(motor), units);
        }
    }

    /// Takes up backlash, once a background pass. `table`: the 1/16 counts that the motor's `BLCOMP` table adds to
    /// Ix86.
    pub fn take_up_backlash(&mut self, motor: usize, table: f64) {
        let rate = self.ix(motor, 85) / UNITS;
        if !self.active(motor) || rate == 0.0 {
            self.motors[motor].backlash = Backlash::default();
            return;
        }
        let hysteresis = self.setting(self.settings().backlash_hysteresis, motor) / UNITS;
        let commanded = self.motors[motor].commanded();
        let mut backlash = self.motors[motor].backlash;
        backlash.follow(commanded, hysteresis);
        let size = (self.ix(motor, 86) + table) / UNITS;
        let wanted = if backlash.negative { size } else { 0.0 };
        backlash.added += (wanted - backlash.added).clamp(-rate, rate);
        self.motors[motor].backlash = backlash;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::board::register_table::Each;
    use crate::sim::testing::Bench;

    fn send(bench: &mut Bench, text: &str) -> Vec<String> {
        let mut lines = Vec::new();
        for line in text.lines() {
            let reply = bench.world.execute(line.as_bytes());
            assert_eq!(reply.error, None, "{line}");
            lines.extend(reply.lines);
        }
        lines
    }

    /// Goes to `position` and gives the compensation there and the encoder's final position, in 1/16 counts.
    fn at(bench: &mut Bench, position: f64) -> (f64, f64) {
        send(bench, &format!("#1J={position}"));
        bench.run(20);
        bench.until(200_000, |board| board.motor_status(0)[1] & 1 == 1);
        bench.run(500);
        let memory = &bench.world.board.memory;
        let units = |register: Each| memory.read_d(register.of(0)) as f64 / 3072.0 * UNITS;
        (units(memory.registers().compensation), units(memory.registers().actual))
    }

    #[test]
    fn a_leadscrew_table_is_followed_in_proportion_and_rolls_over() {
        let mut bench = Bench::started();
        send(&mut bench, "I111=0 #1J/\nDELETE ALL #1 DEFINE COMP 4,1000\n160\n320\n-160\n0");
        assert_eq!(at(&mut bench, 250.0), (0.0, 4000.0), "I51 is 0");
        send(&mut bench, "I51=1");
        let close = |found: f64, expected: f64| (found - expected).abs() <= 1.0;
        for (position, added) in [
            (250.0, 160.0),
            (125.0, 80.0),
            (375.0, 240.0),
            (750.0, -160.0),
            (1250.0, 160.0),
            (-250.0, -160.0),
        ] {
            // The encoder is off by the correction; the table goes by the encoder.
            let (found, encoder) = at(&mut bench, position);
            assert!(close(found + encoder, position * UNITS), "{position}: {found} {encoder}");
            assert!(close(found, added) || (found - added).abs() < 20.0, "{position}: {found}, not {added}");
            let reported: f64 = send(&mut bench, "#1P")[0].parse().unwrap();
            assert!((reported - position).abs() < 0.2, "{position}: {reported}");
        }
        send(&mut bench, "I51=0");
        assert_eq!(at(&mut bench, 250.0), (0.0, 4000.0));
    }

    #[test]
    fn one_motor_corrects_another_and_wrong_ones_are_refused() {
        let mut bench = Bench::started();
        send(&mut bench, "I111=0 I211=0 I51=1 #1J/#2J/\nDELETE ALL #2 DEFINE COMP 2,#1D,#2,1000\n160\n0");
        at(&mut bench, 500.0);
        let board = &mut bench.world.board;
        let compensation = board.memory.registers().compensation;
        assert_eq!(board.memory.read_d(compensation.of(1)), 10 * 3072);
        assert_eq!(board.memory.read_d(compensation.of(0)), 0);
        for line in ["#3 DEFINE COMP 2,#9,100", "#3 DEFINE COMP 2,#1#2,100", "#3 DEFINE COMP 2,"] {
            assert!(bench.world.execute(line.as_bytes()).error.is_some());
        }
    }

    #[test]
    fn backlash_comes_with_the_negative_direction() {
        let mut bench = Bench::started();
        send(&mut bench, "I111=0 #1J/\nI185=4 I186=320");
        assert_eq!(at(&mut bench, 1000.0).0, 0.0);
        assert_eq!(at(&mut bench, 997.0).0, 0.0, "less than I99");
        assert_eq!(at(&mut bench, 500.0), (320.0, 500.0 * UNITS - 320.0));
        assert!(bench.world.board.motor_status(0)[1] >> 4 & 1 == 1);
        assert_eq!(at(&mut bench, 800.0).0, 0.0);
        send(&mut bench, "DELETE ALL #1 DEFINE BLCOMP 2,1000\n160\n0");
        assert_eq!(at(&mut bench, 500.0).0, 480.0);
        send(&mut bench, "I185=0");
        assert_eq!(at(&mut bench, 500.0).0, 0.0);
    }
}
