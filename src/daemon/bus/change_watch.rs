//! Finds changes on the board that did not come through this daemon: by another host on the serial port or on the bus,
//! or by a program of the board.
//!
//! The daemon asks for a few I-variables again and again, and forgets the values that a command line through it may
//! set. If a remembered value differs, another host or a program has changed it. The daemon misses a change that is
//! undone before the next question.

use std::time::Instant;

use crate::daemon::shared::status::{CHANGES, Change};
use crate::language::Meaning;
use crate::map::Family;

/// A variable, by the board's last answer.
#[derive(Debug, Clone, Copy)]
struct Told {
    variable: u16,
    value: u32,
    at: Instant,
    /// The value before the change, and when the board last told that value.
    before: Option<(u32, Instant)>,
}

/// The variables that the daemon asks for.
#[derive(Debug)]
pub struct ChangeWatch {
    told: [Option<Told>; CHANGES],
    /// Setting the first variable clears the second: on Turbo boards I57=1 sets I48 to 0 (Turbo User Manual p. 403).
    clears: Option<[u16; 2]>,
}

impl ChangeWatch {
    /// A watch without answers yet, for a board of `family`.
    #[must_use]
    pub fn new(family: &Family) -> Self {
        let i = &family.i;
        Self { told: [None; CHANGES], clears: i.servo_in_background.map(|other| [other, i.servo_enable]) }
    }

    /// The board, asked at `now`, says that `variable` is `value`.
    pub fn told(&mut self, variable: u16, value: u32, now: Instant) {
        let is_it = |told: &Option<Told>| told.is_some_and(|told| told.variable == variable);
        let place = self.told.iter().position(is_it).or_else(|| self.told.iter().position(Option::is_none));
        let Some(slot) = place.and_then(|place| self.told.get_mut(place)) else { return };
        let told = slot.get_or_insert(Told { variable, value, at: now, before: None });
        if told.value != value {
            let (was, at) = told.before.unwrap_or((told.value, told.at));
            told.before = (was != value).then_some((was, at));
            told.value = value;
        }
        told.at = now;
    }

    /// A line goes to the board through the daemon: forgets the variables that the line may set, until the next answer.
    pub fn line_goes(&mut self, line: &Meaning) {
        if line.resets {
            return self.forget();
        }
        let is_set = |told: &Told| {
            let is_cleared = |[by, cleared]: [u16; 2]| cleared == told.variable && line.settings.may_have(by);
            line.settings.may_have(told.variable) || self.clears.is_some_and(is_cleared)
        };
        for slot in &mut self.told {
            *slot = slot.filter(|told| !is_set(told));
        }
    }

    /// The board was reset or replaced: forgets all answers.
    pub fn forget(&mut self) {
        self.told = [None; CHANGES];
    }

    /// The changes that did not come through this daemon.
    #[must_use]
    pub fn changes(&self) -> [Option<Change>; CHANGES] {
        self.told.map(|told| {
            let Told { variable, value, before, .. } = told?;
            let (was, since) = before?;
            Some(Change { variable, was, is: value, since })
        })
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::map::{PMAC, TURBO2};

    fn changes(watch: &ChangeWatch) -> Vec<(u16, u32, u32)> {
        let changes = watch.changes().into_iter().flatten();
        changes.map(|change| (change.variable, change.was, change.is)).collect()
    }

    #[test]
    fn what_no_line_of_ours_can_have_set_was_changed_by_somebody_else() {
        let start = Instant::now();
        let at = |seconds| start + Duration::from_secs(seconds);
        let mut watch = ChangeWatch::new(&PMAC);
        for (variable, value) in [(2, 3), (55, 1), (19, 1)] {
            watch.told(variable, value, at(0));
        }
        watch.told(2, 3, at(30));
        assert!(changes(&watch).is_empty());
        watch.told(2, 1, at(60));
        assert_eq!(changes(&watch), [(2, 3, 1)]);
        watch.told(2, 0, at(90));
        assert_eq!(changes(&watch), [(2, 3, 0)]);
        assert_eq!(watch.changes()[0].unwrap().since, at(30), "when it was seen to be 3 last");
        watch.told(2, 3, at(120));
        assert!(changes(&watch).is_empty(), "put back");
        // Our own lines.
        for (line, is_ours) in
            [("I55=0", true), ("I50..60=0", true), ("I(P1)=3", true), ("$$$", true), ("I19=5 P55=0", false)]
        {
            watch.forget();
            watch.told(55, 1, at(0));
            watch.line_goes(&Meaning::of(line));
            watch.told(55, 0, at(1));
            assert_eq!(changes(&watch).is_empty(), is_ours, "{line}");
        }
        // The value that a line sets may clear another variable.
        let mut turbo = ChangeWatch::new(&TURBO2);
        for (line, is_ours) in [("I57=1", true), ("I49=1", false)] {
            turbo.forget();
            turbo.told(48, 1, at(0));
            turbo.line_goes(&Meaning::of(line));
            turbo.told(48, 0, at(1));
            assert_eq!(changes(&turbo).is_empty(), is_ours, "{line}");
        }
        // A change no longer matters once a client sets the variable through the daemon.
        watch.line_goes(&Meaning::of("I55=1"));
        assert!(changes(&watch).is_empty());
    }
}
