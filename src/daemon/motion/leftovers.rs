//! Lines left in the board's own rotary buffers that no client expects to run: a client that starts that program hears
//! of them first.
//!
//! A rotary stream that ends early leaves such lines, and the board may hold others. The daemon does not know which
//! lines the buffers held before its own start, nor how far a program came that a client streamed whole and then
//! aborted. So the daemon asks the board before that coordinate system starts.
//!
//! The stream has pointed the coordinate system at its rotary buffer with `B0`, and neither `Q` nor `A` points it
//! elsewhere. So `R`, `S`, ^R, ^S and the panel's keys would run the lines left.
//!
//! Only certain starts count: a start that names its coordinate system, or starts all of them. The daemon forgets
//! leftovers when a line takes them away or points the coordinate system elsewhere, and at a reset: no rotary buffer
//! survives a reset of the board.

use super::effect::Starts;
use crate::map::Systems;
use crate::protocol::CallError;

/// The error of `PR` without a rotary buffer.
const NO_BUFFER: u16 = 3;

/// The lines left for one coordinate system.
#[derive(Debug, Clone, Copy, Default)]
struct Left {
    lines: u64,
    /// The daemon knows that no other lines are left.
    is_known: bool,
    /// The board told of the lines, not a stream.
    is_found: bool,
    /// The daemon has asked the board since a stream left lines, or since the daemon refused a start.
    is_asked: bool,
    /// The rotary buffer may hold lines that the daemon does not count: a client has streamed a whole program, has
    /// started the lines left all the same, or has pointed the coordinate system elsewhere.
    is_whole: bool,
}

/// The lines left for every coordinate system.
#[derive(Debug, Default)]
pub struct Leftovers([Left; u32::BITS as usize]);

impl Leftovers {
    /// The leftovers of a board after a reset: none.
    pub fn after_reset() -> Self {
        Self([Left { is_known: true, ..Left::default() }; u32::BITS as usize])
    }

    /// A stream that fed `systems` has ended and left `lines` that no client expects.
    pub fn set(&mut self, systems: Systems, lines: u64) {
        let left = Left { lines, is_known: true, is_whole: lines == 0, ..Left::default() };
        self.of(systems).for_each(|row| *row = left);
    }

    /// The board counts `lines` in the rotary buffer of each of `systems`.
    pub fn find(&mut self, systems: Systems, lines: u64) {
        self.of(systems).for_each(|row| {
            let is_found = row.is_found || row.lines == 0;
            let is_whole = lines == 0;
            *row = Left { lines, is_known: true, is_found, is_asked: true, is_whole };
        });
    }

    /// The board refuses to count the lines, with this `error`. Unless the error says that no buffer exists, its cause
    /// is unknown: the count of the last stream stays valid then.
    pub fn refused(&mut self, systems: Systems, error: u16) {
        if error != NO_BUFFER && self.of(systems).any(|row| row.lines > 0) {
            self.of(systems).for_each(|row| row.is_asked = true);
        } else {
            self.find(systems, 0);
        }
    }

    /// A client has ended the programs of `systems`, or has pointed them at their rotary buffers again: the daemon will
    /// ask the board about lines there that it does not count.
    pub fn aborted(&mut self, systems: Systems) {
        self.of(systems).for_each(|row| row.is_known &= !row.is_whole);
    }

    /// The lines left for `systems` may be gone. A line that names no coordinate system may have meant another one.
    pub fn forget(&mut self, systems: Systems) {
        for row in self.of(systems) {
            row.is_known |= systems != Systems::ALL;
            (row.is_whole, row.lines) = (true, 0);
        }
    }

    /// The coordinate systems to start about which the daemon has to ask the board first: the daemon does not know what
    /// is left there, or a stream left lines that the board may have lost since.
    pub fn to_ask(&self, starts: Starts) -> Systems {
        let asks = |system: &usize| {
            let row = self.0[system - 1];
            !row.is_known || row.lines > 0 && !row.is_asked
        };
        if starts.confirmed { Systems::NONE } else { starts.systems.numbers().filter(asks).collect() }
    }

    /// Checks that programs may start.
    ///
    /// # Errors
    /// Lists the lines that would run.
    pub fn check(&mut self, starts: Starts) -> Result<(), CallError> {
        if starts.confirmed {
            self.forget(starts.systems);
        }
        let Some(cs) = starts.systems.numbers().find(|system| self.0[system - 1].lines > 0) else {
            return Ok(());
        };
        self.of(starts.systems).for_each(|row| row.is_asked = false);
        let Left { lines, is_found, .. } = self.0[cs - 1];
        let what = if is_found {
            format!(
                "{lines} lines of an earlier program are left in &{cs}'s rotary buffer, and would run now"
            )
        } else {
            format!(
                "the last rotary stream into &{cs} ended early, and {lines} lines of it would run now from its rotary buffer"
            )
        };
        Err(CallError::refused(format_args!(
            "not started: {what}. pmacctl rotary stream --clear takes them away. {} runs them. To run program 5 instead, send \
             '&{cs}B5' first",
            start_anyway(cs)
        )))
    }

    fn of(&mut self, systems: Systems) -> impl Iterator<Item = &mut Left> {
        (1..).zip(&mut self.0).filter_map(move |(number, row)| systems.contains(number).then_some(row))
    }
}

/// The commands that start coordinate system `cs` whatever lines are left.
pub fn start_anyway(cs: impl std::fmt::Display) -> String {
    format!("pmacctl run {cs} --continue, or pmacctl send --yes '&{cs}R',")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::motion::effect::LineEffect;
    use crate::language::Meaning;

    #[test]
    fn what_is_left_is_told_until_it_may_be_gone() {
        let start = |systems, confirmed| Starts { systems: Systems::from_bits(systems), confirmed };
        let left = || {
            let mut left = Leftovers::default();
            left.set(Systems::of(2), 7);
            left
        };
        assert!(left().check(start(0b01, false)).is_ok(), "another one");
        let told = left().check(start(0b11, false)).unwrap_err().to_string();
        assert!(told.contains("into &2") && told.contains("7 lines of it"), "{told}");
        assert!(told.contains("pmacctl run 2 --continue, or pmacctl send --yes '&2R', runs them"), "{told}");
        assert!(left().check(start(u32::MAX, false)).is_err());
        assert!(Leftovers::after_reset().check(start(0b10, false)).is_ok(), "the board was reset");
        let mut confirmed = left();
        assert!(confirmed.check(start(0b10, true)).is_ok());
        assert!(confirmed.check(start(0b10, false)).is_ok(), "they run");
        let mut forgotten = left();
        forgotten.forget(Systems::ALL);
        assert!(forgotten.check(start(0b10, false)).is_ok());
    }

    #[test]
    fn what_was_left_is_asked_about_again_once_another_program_or_a_part_of_it_has_run() {
        let start = Starts { systems: Systems::of(1), confirmed: false };
        let effect = |left: &mut Leftovers, line: &str| {
            let LineEffect { forgets, aborts, .. } = LineEffect::of(&Meaning::of(line), false, Some(2));
            left.forget(forgets);
            left.aborted(aborts);
        };
        let mut left = Leftovers::default();
        left.set(Systems::of(1), 7);
        effect(&mut left, "&1B5");
        assert_eq!((left.to_ask(start).bits(), left.check(start).is_ok()), (0, true), "PROG 5 runs");
        effect(&mut left, "&1B0");
        assert_eq!(left.to_ask(start).bits(), 0b1);
        for end in ["&1A", "&1Q"] {
            left.find(Systems::of(1), 7);
            assert!(left.check(Starts { confirmed: true, ..start }).is_ok());
            assert_eq!(left.to_ask(start).bits(), 0, "they run");
            effect(&mut left, end);
            assert_eq!(left.to_ask(start).bits(), 0b1, "{end}");
        }
    }

    #[test]
    fn the_board_is_asked_again_at_each_start_of_what_is_left() {
        let start = Starts { systems: Systems::of(1), confirmed: false };
        let mut left = Leftovers::default();
        left.set(Systems::of(1), 7);
        for still in [7, 5, 5] {
            assert_eq!(left.to_ask(start).bits(), 0b1);
            left.find(Systems::of(1), still);
            assert_eq!(left.to_ask(start).bits(), 0, "asked");
            let told = left.check(start).unwrap_err().to_string();
            assert!(told.contains(&format!("{still} lines of it")), "{told}");
        }
        // Another host, or a reset that the daemon missed, has taken the lines.
        assert_eq!(left.to_ask(start).bits(), 0b1);
        left.refused(Systems::of(1), NO_BUFFER);
        assert!(left.check(start).is_ok());
    }

    #[test]
    fn what_is_left_is_not_known_until_the_board_was_asked_or_it_is_gone() {
        let start = Starts { systems: Systems::first(4), confirmed: false };
        let mut left = Leftovers::default();
        assert_eq!(left.to_ask(start).bits(), 0b1111);
        assert_eq!(left.to_ask(Starts { confirmed: true, ..start }).bits(), 0, "they are to run");
        left.set(Systems::of(1), 0);
        left.find(Systems::of(2), 7);
        left.forget(Systems::ALL);
        assert_eq!(left.to_ask(start).bits(), 0b1100, "a line without a number is no answer");
        left.find(Systems::of(2), 7);
        left.forget(Systems::of(3));
        assert_eq!(left.to_ask(start).bits(), 0b1000);
        let told = left.check(start).unwrap_err().to_string();
        assert!(told.contains("7 lines of an earlier program are left in &2's rotary buffer"), "{told}");
        // A client streamed the whole program, and aborted it.
        left.set(Systems::of(1), 0);
        assert_eq!(left.to_ask(start).bits(), 0b1010, "&1 runs to its end, and &2 was refused");
        left.aborted(Systems::first(2));
        assert_eq!(left.to_ask(start).bits(), 0b1011, "&2 still has what it had");
        left.find(Systems::of(1), 0);
        // The board refuses to say: it has no buffer, or a program had an error.
        let one = Starts { systems: Systems::of(1), confirmed: false };
        for (error, may_start) in [(5, false), (NO_BUFFER, true)] {
            left.set(Systems::of(1), 200);
            assert_eq!(left.to_ask(one).bits(), 0b1);
            left.refused(Systems::of(1), error);
            assert_eq!((left.to_ask(one).bits(), left.check(one).is_ok()), (0, may_start), "ERR{error:03}");
        }
        left = Leftovers::after_reset();
        assert_eq!(left.to_ask(start), Systems::NONE, "no rotary buffer is kept over a reset");
        assert!(left.check(start).is_ok());
    }
}
