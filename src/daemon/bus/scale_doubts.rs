//! Which motors' scales a command line may change: the daemon does not know these until the board has told them again.

use crate::language::Meaning;
use crate::language::settings::Settings;
use crate::map::{IVariables, Motors};
use crate::segment::Identity;

/// The I-variable of the servo period in every family.
pub const I10: u16 = 10;

/// The motors' scales in the order of [`IVariables::SCALES`].
pub fn scale_tables(identity: &mut Identity) -> [&mut [Option<i32>]; IVariables::SCALES.len()] {
    [&mut identity.ix07, &mut identity.ix08, &mut identity.ix09, &mut identity.ix60]
}

/// The values in doubt.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ScaleDoubts {
    /// For each of [`IVariables::SCALES`], the motors whose value is in doubt.
    motors: [Motors; IVariables::SCALES.len()],
    /// I10, which is the scale of velocities in seconds and of the feed rate override.
    servo_period: bool,
}

impl ScaleDoubts {
    const ALL: Self = Self { motors: [Motors::ALL; IVariables::SCALES.len()], servo_period: true };

    /// The scales that a line may change: those that it sets by number, or all if it gives a range or an expression, or
    /// resets the board. `None` after a line that leaves every answer of the board to [`super::identify`] as it is. A
    /// jog (J=), P, Q and M come too often to ask all questions after each.
    #[must_use]
    pub fn of(line: &Meaning) -> Option<Self> {
        let Settings { any, several, scales, .. } = line.settings;
        if line.resets || several {
            return Some(Self::ALL);
        }
        let doubts = Self { motors: scales, servo_period: line.settings.has(I10) };
        (any || line.has_address).then_some(doubts)
    }

    /// Adds doubts.
    pub fn add(&mut self, more: Self) {
        for (motors, more) in self.motors.iter_mut().zip(more.motors) {
            motors.add(more);
        }
        self.servo_period |= more.servo_period;
    }

    /// `identity` without the scales that are in doubt.
    #[must_use]
    pub fn leave_out(self, mut identity: Identity) -> Identity {
        if self.servo_period {
            // The period by which the daemon awaits the reports stays: that clock finds a change by itself.
            identity.i10 = None;
        }
        for (table, motors) in scale_tables(&mut identity).into_iter().zip(self.motors) {
            for (index, scale) in table.iter_mut().enumerate() {
                *scale = scale.filter(|_| !motors.contains(index + 1));
            }
        }
        identity
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_puts_in_doubt_the_scales_that_it_may_change() {
        for (line, expected) in [
            ("I108=48", [0, 1, 0, 0]),
            ("i 3209 = 96", [0, 0, 1 << 31, 0]),
            ("I260=1", [0, 0, 0, 1 << 1]),
            ("I122=I108", [0; 4]),
            ("I307=1I408=2", [1 << 2, 1 << 3, 0, 0]),
            ("I8=1 I9908=1 I109>I108", [0; 4]),
            ("M1->X:$C000,8", [0; 4]),
        ] {
            let expected = ScaleDoubts { motors: expected.map(Motors::from_bits), servo_period: false };
            assert_eq!(ScaleDoubts::of(&Meaning::of(line)), Some(expected), "{line}");
        }
        for line in ["I100..199=0", "I108,8,100=96", "I(P1)=7", "$$$"] {
            assert_eq!(ScaleDoubts::of(&Meaning::of(line)), Some(ScaleDoubts::ALL), "{line}");
        }
        for (line, expected) in [("i10=3713707", true), ("I110=1 I100=2", false), ("P1=1I10=5", true)] {
            assert_eq!(ScaleDoubts::of(&Meaning::of(line)).unwrap().servo_period, expected, "{line}");
        }
    }
    #[test]
    fn only_lines_that_may_change_an_answer_have_it_asked_again() {
        for line in ["I59=4", "i108=96", "P1=2I19=1", "$$$", "WX$D009,1", "I(P1)=3"] {
            assert!(ScaleDoubts::of(&Meaning::of(line)).is_some(), "{line}");
        }
        for line in
            ["#1J=1000 #2J=-5", "LINEAR X8=1 DWELL7=8", "SEND\"I108=1\"", "P5=1", "M1=0", "#1J=", "I108", "?"]
        {
            assert_eq!(ScaleDoubts::of(&Meaning::of(line)), None, "{line}");
        }
    }
}
