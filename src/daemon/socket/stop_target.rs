//! What a stop stops, and the command line that does it.
//!
//! `#nJ/` stops a jog, `&nA` aborts and `&nH` holds a coordinate system. The address that `#n` and `&n` change is everybody's
//! (UM p. 29), so the line puts it back.

use std::fmt;
use std::time::Duration;

use crate::daemon::shared::queue::{LINE_MAX, Text};
use crate::map::status::{StatusTable, reply_has};

/// How long the panel has for a stop.
pub(super) const PANEL_TAKES: Duration = Duration::from_millis(100);

/// The digits of a status that is whole: two words of 24 bits.
const STATUS_DIGITS: usize = 12;

/// What the board has told of its motors' loops; bit 0 is motor 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Loops {
    /// The motors of which it has told.
    pub told: u32,
    /// Of these, those whose loop is open.
    pub open: u32,
}

/// What is to be stopped; bit 0 is number 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// Motors that jog.
    Motors(u32),
    /// The programs of coordinate systems, by this on-line command.
    Systems(u32, char),
}

impl Target {
    /// Asks what is addressed, and then for the status of each motor. That leaves the last one addressed. The addressed motor's
    /// status stands between: on Turbo boards `##n` is a command of its own (Turbo Software Reference p. 270).
    pub(super) fn question(self) -> Text<LINE_MAX> {
        let Self::Motors(motors) = self else { return Text::from("&") };
        let status: String = numbers(motors).map(|motor| format!("#{motor}?")).collect();
        Text::of(&format_args!("#?{status}"))
    }

    /// The loops of its motors as the board's answers to [`Self::question`] tell.
    pub(super) fn loops(self, answers: &[String], motor: &'static [StatusTable]) -> Loops {
        numbers(self.motors()).zip(answers.iter().skip(2)).fold(
            Loops::default(),
            |loops, (number, status)| {
                let bit = |is_so| u32::from(is_so) << (number - 1);
                let is_told = status.trim().len() >= STATUS_DIGITS;
                Loops {
                    told: loops.told | bit(is_told),
                    open: loops.open | bit(is_told && reply_has(status, motor, "open_loop")),
                }
            },
        )
    }

    /// The line that stops it, but not the motors in `open`, whose loops it would close. Then addresses `addressed` again.
    /// `None` when nothing is left to do.
    pub(super) fn line(self, open: u32, addressed: Option<u32>) -> Option<Text<LINE_MAX>> {
        let (mask, sign, command) = match self {
            Self::Motors(motors) => (motors & !open, '#', "J/".to_owned()),
            Self::Systems(systems, letter) => (systems, '&', letter.to_string()),
        };
        let mut line: String = numbers(mask).map(|number| format!("{sign}{number}{command}")).collect();
        if let Some(addressed) = addressed {
            line += &format!("{sign}{addressed}");
        }
        (!line.is_empty()).then(|| Text::of(&line))
    }

    /// The coordinate systems that it aborts, bit 0 being number 1.
    pub(super) const fn aborted(self) -> u32 {
        match self {
            Self::Systems(systems, 'A') => systems,
            Self::Systems(..) | Self::Motors(_) => 0,
        }
    }

    /// Its motors, bit 0 being motor 1.
    pub(super) const fn motors(self) -> u32 {
        match self {
            Self::Motors(motors) => motors,
            Self::Systems(..) => 0,
        }
    }
}

/// The numbers in `mask`, bit 0 being number 1.
pub(super) fn numbers(mask: u32) -> impl Iterator<Item = u32> {
    (1..=32).filter(move |number| mask >> (number - 1) & 1 != 0)
}

impl fmt::Display for Target {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (what, mask) = match self {
            Self::Motors(motors) => ("motor", *motors),
            Self::Systems(systems, _) => ("coordinate system", *systems),
        };
        let list: Vec<String> = numbers(mask).map(|number| number.to_string()).collect();
        write!(f, "{what} {}", list.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn b2_6_the_line_stops_what_is_closed_and_puts_the_address_back() {
        let line =
            |target: Target, open, addressed| target.line(open, addressed).map(|line| line.to_string());
        assert_eq!(line(Target::Motors(0b101), 0, Some(2)).unwrap(), "#1J/#3J/#2");
        assert_eq!(line(Target::Motors(0b101), 0b001, None).unwrap(), "#3J/");
        assert_eq!(line(Target::Motors(0b101), 0b111, Some(1)).unwrap(), "#1", "killed motors stay killed");
        assert_eq!(line(Target::Motors(0b101), 0b111, None), None);
        assert_eq!(line(Target::Systems(0b10, 'A'), 0b11, Some(1)).unwrap(), "&2A&1");
        assert_eq!(Target::Motors(0b101).to_string(), "motor 1, 3");
        assert_eq!(&*Target::Motors(0b101).question(), "#?#1?#3?");
        assert!(Target::Motors(u32::MAX).question().ends_with("#32?"), "all fit into a line");
    }

    #[test]
    fn b2_6_the_status_of_each_motor_tells_of_its_loop() {
        let answers = ["1", "846000804401", "812000804401", "846000804401", "8460"].map(str::to_owned);
        let loops =
            |count: usize| Target::Motors(0b1101).loops(&answers[..count], crate::map::TURBO2.status.motor);
        assert_eq!(loops(5), Loops { told: 0b101, open: 0b100 }, "the last one is not whole");
        assert_eq!(loops(3), Loops { told: 0b1, open: 0 });
        assert_eq!(loops(2), Loops::default());
    }
}
