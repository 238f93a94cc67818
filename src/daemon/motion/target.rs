//! The target of a stop, and the command line that stops it.
//!
//! `#nJ/` stops a jog, `&nA` aborts and `&nH` holds a coordinate system. All senders share the address that `#n` and
//! `&n` change (User Manual p. 29), so the line puts the address back.

use std::fmt;

use crate::daemon::shared::queue::{LINE_MAX, Text};
use crate::map::status::{StatusTable, reply_has};
use crate::map::{Motors, Systems};

/// The digits of a complete status: two words of 24 bits.
const STATUS_DIGITS: usize = 12;

/// The board's news of its motors' loops.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Loops {
    /// The motors about which the board has told.
    pub told: Motors,
    /// The told motors whose loop is open.
    pub open: Motors,
}

/// The target of a stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// Motors that jog.
    Motors(Motors),
    /// The programs of coordinate systems, by this on-line command.
    Systems(Systems, char),
}

impl Target {
    /// Asks for the address, then for the status of each motor, which leaves the last motor addressed. The question
    /// also asks for the addressed motor's status in between: on Turbo boards `##n` is a command of its own (Turbo
    /// Software Reference p. 270).
    pub fn question(self) -> Text<LINE_MAX> {
        let Self::Motors(motors) = self else { return Text::from("&") };
        let status: String = motors.numbers().map(|motor| format!("#{motor}?")).collect();
        Text::of(&format_args!("#?{status}"))
    }

    /// The loops of the target's motors, from the board's answers to [`Self::question`].
    pub fn loops(self, answers: &[String], motor: &'static [StatusTable]) -> Loops {
        let mut loops = Loops::default();
        for (number, status) in self.motors().numbers().zip(answers.iter().skip(2)) {
            if status.trim().len() >= STATUS_DIGITS {
                loops.told.add(Motors::of(number));
                if reply_has(status, motor, "open_loop") {
                    loops.open.add(Motors::of(number));
                }
            }
        }
        loops
    }

    /// The line that stops the target, then addresses `addressed` again. The line leaves out the motors in `open`,
    /// whose loops it would close. `None` if the line would be empty.
    pub fn line(self, open: Motors, addressed: Option<u32>) -> Option<Text<LINE_MAX>> {
        let (mut line, sign): (String, _) = match self {
            Self::Motors(motors) => {
                (motors.without(open).numbers().map(|number| format!("#{number}J/")).collect(), '#')
            }
            Self::Systems(systems, letter) => {
                (systems.numbers().map(|number| format!("&{number}{letter}")).collect(), '&')
            }
        };
        if let Some(addressed) = addressed {
            line += &format!("{sign}{addressed}");
        }
        (!line.is_empty()).then(|| Text::of(&line))
    }

    /// The coordinate systems that the stop aborts.
    pub const fn aborted(self) -> Systems {
        match self {
            Self::Systems(systems, 'A') => systems,
            Self::Systems(..) | Self::Motors(_) => Systems::NONE,
        }
    }

    /// The target's motors.
    pub const fn motors(self) -> Motors {
        match self {
            Self::Motors(motors) => motors,
            Self::Systems(..) => Motors::NONE,
        }
    }
}

impl fmt::Display for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Motors(motors) => write!(f, "motor {motors}"),
            Self::Systems(systems, _) => write!(f, "coordinate system {systems}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motors(bits: u32) -> Motors {
        Motors::from_bits(bits)
    }

    #[test]
    fn the_line_stops_what_is_closed_and_puts_the_address_back() {
        let line = |target: Target, open, addressed| {
            target.line(motors(open), addressed).map(|line| line.to_string())
        };
        assert_eq!(line(Target::Motors(motors(0b101)), 0, Some(2)).unwrap(), "#1J/#3J/#2");
        assert_eq!(line(Target::Motors(motors(0b101)), 0b001, None).unwrap(), "#3J/");
        assert_eq!(
            line(Target::Motors(motors(0b101)), 0b111, Some(1)).unwrap(),
            "#1",
            "killed motors stay killed"
        );
        assert_eq!(line(Target::Motors(motors(0b101)), 0b111, None), None);
        assert_eq!(line(Target::Systems(Systems::of(2), 'A'), 0b11, Some(1)).unwrap(), "&2A&1");
        assert_eq!(Target::Motors(motors(0b101)).to_string(), "motor 1, 3");
        assert_eq!(&*Target::Motors(motors(0b101)).question(), "#?#1?#3?");
        assert!(Target::Motors(motors(u32::MAX)).question().ends_with("#32?"), "all fit into a line");
    }

    #[test]
    fn the_status_of_each_motor_tells_of_its_loop() {
        let answers = ["1", "846000804401", "812000804401", "846000804401", "8460"].map(str::to_owned);
        let loops = |count: usize| {
            Target::Motors(motors(0b1101)).loops(&answers[..count], crate::map::TURBO2.status.motor)
        };
        assert_eq!(loops(5), Loops { told: motors(0b101), open: motors(0b100) }, "the last one is not whole");
        assert_eq!(loops(3), Loops { told: motors(0b1), open: Motors::NONE });
        assert_eq!(loops(2), Loops::default());
    }
}
