//! Lines that lie in the board's own rotary buffers and that nobody expects to run: who starts that program hears of them first.
//!
//! They are what a rotary stream left because it ended early, and what the daemon finds there. It does not know what there was
//! before its own start, nor how far a program came that was streamed whole and then aborted: so the board is asked before that
//! coordinate system is started.
//!
//! The stream has pointed the coordinate system at its rotary buffer with `B0` ("point to rotary buffer", FACTS 7), and neither
//! `Q` nor `A` points it elsewhere. So `R`, `S`, ^R, ^S and the panel's keys would run what is left.
//!
//! Only what is certain counts: a start that names its coordinate system, or starts all of them. What is left is forgotten when a
//! line takes it away or points elsewhere, and at a reset: a rotary buffer is not kept over one (FACTS 7).

use std::time::Duration;

use crate::protocol::buffer_line::WhileOpen;
use crate::protocol::moved_motors::EndlessJogs;
use crate::protocol::tokens::{self, Kind, Needs};
use crate::protocol::{CallError, control, i_lines, line};

/// The programs that a call starts, and whether its caller means what is left too.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Starts {
    /// The coordinate systems: bit 0 is &1.
    pub systems: u32,
    /// The caller says that what is left is to run.
    pub confirmed: bool,
}

/// The error of `PR` without a rotary buffer.
const NO_BUFFER: u16 = 3;

/// What every coordinate system has left, &1 first.
#[derive(Debug, Default)]
pub(super) struct Leftovers {
    lines: [u64; u32::BITS as usize],
    /// Of these the daemon knows what is left. Bit 0 is &1.
    known: u32,
    /// Of these it was the board that told.
    found: u32,
    /// Of these the board was asked since a stream has left something, or a start was refused.
    asked: u32,
    /// Of these the rotary buffer may hold lines that nobody counts: a stream that was fed whole, or what somebody has started all the
    /// same or has pointed the coordinate system away from.
    whole: u32,
    /// How many resets there had been.
    resets: u64,
}

impl Leftovers {
    /// A stream that fed `systems` has ended and left `lines` that nobody expects.
    pub(super) fn set(&mut self, systems: u32, lines: u64, resets: u64) {
        self.see(resets);
        self.known |= systems;
        self.found &= !systems;
        self.asked &= !systems;
        self.whole = if lines == 0 { self.whole | systems } else { self.whole & !systems };
        self.of(systems).for_each(|(_, left)| *left = lines);
    }

    /// The board counts `lines` in the rotary buffer of `system`.
    pub(super) fn find(&mut self, system: u32, lines: u64, resets: u64) {
        self.see(resets);
        let is_a_streams = self.found & system == 0 && self.of(system).any(|(_, left)| *left > 0);
        self.set(system, lines, resets);
        self.asked |= system;
        self.found |= if is_a_streams { 0 } else { system };
    }

    /// The board refuses to count them by this `error`. Of one that does not say that there is no buffer, nobody knows whose it is: what
    /// a stream has left counts then.
    pub(super) fn refused(&mut self, system: u32, error: u16, resets: u64) {
        if error != NO_BUFFER && self.of(system).any(|(_, left)| *left > 0) {
            self.asked |= system;
        } else {
            self.find(system, 0, resets);
        }
    }

    /// The programs of `systems` were ended, or point at their rotary buffers again: of what nobody counts there, the board is asked.
    pub(super) fn aborted(&mut self, systems: u32) {
        self.known &= !(systems & self.whole);
    }

    /// What `systems` had left may be gone. A line that names none may have meant another one.
    pub(super) fn forget(&mut self, systems: u32) {
        self.known |= if systems == u32::MAX { 0 } else { systems };
        self.whole |= systems;
        self.of(systems).for_each(|(_, left)| *left = 0);
    }

    /// Of the programs to be started, those of which it is not known what is left.
    pub(super) fn unknown(&mut self, starts: Starts, resets: u64) -> u32 {
        self.see(resets);
        if starts.confirmed { 0 } else { starts.systems & !self.known }
    }

    /// Of the programs to be started, those of which a stream has left something: the board, which was not asked, may have lost it
    /// since.
    pub(super) fn left(&mut self, starts: Starts) -> u32 {
        let systems = if starts.confirmed { 0 } else { starts.systems & !self.asked };
        let left = self.of(systems).filter(|(_, left)| **left > 0);
        left.fold(0, |mask, (number, _)| mask | 1 << (number - 1))
    }

    /// Whether programs may be started; `resets` tells whether the board still has what was left. They can be started by the
    /// panel where it `has_panel`.
    ///
    /// # Errors
    /// What would run.
    pub(super) fn check(&mut self, starts: Starts, resets: u64, has_panel: bool) -> Result<(), CallError> {
        self.see(resets);
        if starts.confirmed {
            self.forget(starts.systems);
        }
        let left = self.of(starts.systems).find(|(_, left)| **left > 0).map(|(cs, lines)| (cs, *lines));
        let Some((cs, lines)) = left else { return Ok(()) };
        self.asked &= !starts.systems;
        let what = if self.found >> (cs - 1) & 1 != 0 {
            format!(
                "{lines} lines of an earlier program are left in &{cs}'s rotary buffer, and would run now"
            )
        } else {
            format!(
                "the last rotary stream into &{cs} ended early, and {lines} lines of it would run now from its rotary buffer"
            )
        };
        Err(CallError::Refused {
            reason: format!(
                "not started: {what}. pmacctl rotary stream --clear takes them away. {} runs them. To run program 5 instead, send \
                 '&{cs}B5' first",
                start_anyway(cs, has_panel)
            ),
        })
    }

    fn see(&mut self, resets: u64) {
        if std::mem::replace(&mut self.resets, resets) != resets {
            *self = Self { known: u32::MAX, resets, ..Self::default() };
        }
    }

    fn of(&mut self, systems: u32) -> impl Iterator<Item = (usize, &mut u64)> {
        let is_one = move |(number, _): &(usize, &mut u64)| systems >> (number - 1) & 1 != 0;
        (1..).zip(&mut self.lines).filter(is_one)
    }
}

/// What a command line does to the programs of the coordinate systems it names, to the control panel, and to motors.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct LineEffect {
    /// It starts them.
    pub starts: u32,
    /// It points them elsewhere, or takes away what their rotary buffers hold.
    pub forgets: u32,
    /// It ends them, or points them at their rotary buffers.
    pub aborts: u32,
    /// It switches the control panel off.
    pub ends_panel: bool,
    /// What it comes to where a program buffer is open.
    pub while_open: WhileOpen,
    /// The motors that jog on, and are to stop when its sender is gone: if the board carries it out, and if it refuses it.
    pub jogs: [u32; 2],
    /// How long their sender may be silent meanwhile, if that ends them, too.
    pub silence: Option<Duration>,
}

impl LineEffect {
    /// Of `line`, while the rotary buffers are open or not, on a board whose I-variable `panel` is 3 while it reads the control
    /// panel. Which coordinate system a line means that names none is not known.
    pub(super) fn of(line: &str, rotary_is_open: bool, panel: Option<u16>) -> Self {
        let is_off = |setting: i_lines::Setting| {
            panel.is_some_and(|panel| setting.numbers.has(panel.into())) && setting.value != Some(3)
        };
        let ends_panel = i_lines::settings(line.as_bytes()).any(is_off);
        let plain = line::plain(line);
        // CLEAR empties what is open (GRAMMAR 2.7), which this line may have opened itself.
        let clears = match plain.find("OPEN") {
            Some(at) => plain[at..].starts_with("OPENROT"),
            None => rotary_is_open,
        };
        let takes_away = |commands: &str| {
            let is_cleared = clears && ["CLEAR", "CLR"].iter().any(|word| commands.contains(word));
            is_cleared || ["DELETEROT", "DELROT"].iter().any(|word| commands.contains(word))
        };
        let before = plain.split('&').next().unwrap_or_default();
        let all = takes_away(before) || line::resets(line.as_bytes());
        let mut effect = Self { forgets: if all { u32::MAX } else { 0 }, ends_panel, ..Self::default() };
        let text = line::commands(line).collect::<Vec<_>>().join(" ").to_ascii_uppercase();
        for ((bit, commands), spaced) in line::addressed(&plain, '&').zip(text.split('&').skip(1)) {
            effect.forgets |= if takes_away(commands) { bit } else { 0 };
            effect.add_starts(bit, commands);
            effect.add_starts(
                bit,
                spaced.trim_start_matches(|c: char| c.is_ascii_digit() || c.is_whitespace()),
            );
        }
        effect
    }

    /// The jogs of `line` end with its sender, and when he is silent for so long.
    pub(super) fn ends_jogs(&mut self, line: &str, silence: Option<Duration>) {
        self.jogs = [EndlessJogs::of(line), EndlessJogs::of_refused(line)].map(|jogs| jogs.motors);
        self.silence = silence;
    }

    /// Adds whether `commands` start or abort the coordinate system that is addressed, or point it elsewhere. An `&` may be an
    /// operator, and `P R` one word or two: a start that is asked about once too often harms nobody.
    fn add_starts(&mut self, bit: u32, commands: &str) {
        let mut elsewhere = false;
        for token in tokens::of_known(commands) {
            let said = &commands[token.span];
            match (token.kind, said.as_bytes().first()) {
                (Kind::Moves(Needs::System), Some(b'B')) => {
                    let program = said[1..].trim_start_matches('0');
                    elsewhere = program.starts_with(|c: char| c.is_ascii_digit());
                    *if elsewhere { &mut self.forgets } else { &mut self.aborts } |= bit;
                }
                (Kind::Moves(Needs::System), Some(b'R' | b'S')) if !elsewhere => self.starts |= bit,
                (Kind::Moves(Needs::System), Some(b'A' | b'Q')) => self.aborts |= bit,
                _ => {}
            }
        }
    }
}

/// The commands that start coordinate system `cs` whatever is left.
pub(super) fn start_anyway(cs: impl std::fmt::Display, has_panel: bool) -> String {
    let by_line = format!("pmacctl send --yes '&{cs}R'");
    if has_panel { format!("pmacctl panel start {cs} --continue, or {by_line},") } else { by_line }
}

/// The coordinate systems whose programs `character` starts: all of them, or none.
pub(super) const fn started_by(character: u8) -> u32 {
    if matches!(character, control::RUN | control::STEP) { u32::MAX } else { 0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn b1_5_a_line_tells_which_programs_it_starts_and_which_lines_may_be_gone() {
        for (line, starts, forgets) in [
            ("&1R", 0b1, 0),
            ("& 2 b0 s", 0b10, 0),
            ("&1R&2R", 0b11, 0),
            ("R", 0, 0),
            ("&1PR", 0, 0),
            ("&1B5R", 0, 0b1),
            ("&1R#1P", 0b1, 0),
            ("&1 R P1", 0b1, 0),
            ("&1#1P R", 0b1, 0),
            ("P1=5 &1R", 0b1, 0),
            ("#1->X &3R", 0b100, 0),
            ("&1B0P1=3S", 0b1, 0),
            ("&1B5B0R", 0b1, 0b1),
            ("&1RX$700", 0, 0),
            ("&1SAVE", 0, 0),
            ("&1B0", 0, 0),
            ("&1B0.5", 0, 0),
            ("&3DELETE ROT", 0, 0b100),
            ("&3DELETE GATHER", 0, 0),
            ("&3CLEAR", 0, 0),
            ("OPEN ROT CLEAR", 0, u32::MAX),
            ("&2 OPEN ROTARY CLEAR", 0, 0b10),
            ("OPEN PLC 3 CLEAR", 0, 0),
            ("OPEN PROG 3 CLEAR", 0, 0),
            ("SEND\"DELROT &1R $$$\"", 0, 0),
            ("$$$", 0, u32::MAX),
            ("&0R", 0, 0),
            ("&99R", 0, 0),
            ("&1A", 0, 0),
            ("#1J+", 0, 0),
        ] {
            let aborts = match line {
                "&1A" | "&1B0" | "&1B0.5" | "&1B0P1=3S" | "&1B5B0R" => 1,
                "& 2 b0 s" => 2,
                _ => 0,
            };
            let expected = LineEffect { starts, forgets, aborts, ..LineEffect::default() };
            assert_eq!(LineEffect::of(line, false, Some(2)), expected, "{line}");
        }
        for (line, forgets) in [("CLEAR", u32::MAX), ("&3clr", 0b100), ("OPEN PLC 3 CLEAR", 0)] {
            let expected = LineEffect { forgets, ..LineEffect::default() };
            assert_eq!(LineEffect::of(line, true, Some(2)), expected, "{line}");
        }
    }

    #[test]
    fn b2_6_a_line_tells_whether_it_switches_the_panel_off() {
        for (line, ends) in [
            ("I2=0", true),
            ("I1..5=0", true),
            ("i 2 = P1", true),
            ("I2=3", false),
            ("I2", false),
            ("I22=0", false),
        ] {
            assert_eq!(LineEffect::of(line, false, Some(2)).ends_panel, ends, "{line}");
            assert!(!LineEffect::of(line, false, None).ends_panel, "{line}");
        }
    }

    #[test]
    fn b1_5_what_is_left_is_told_until_it_may_be_gone() {
        let start = |systems, confirmed| Starts { systems, confirmed };
        let left = || {
            let mut left = Leftovers::default();
            left.set(0b10, 7, 1);
            left
        };
        assert!(left().check(start(0b01, false), 1, true).is_ok(), "another one");
        let told = left().check(start(0b11, false), 1, true).unwrap_err().to_string();
        assert!(told.contains("into &2") && told.contains("7 lines of it"), "{told}");
        assert!(
            told.contains("pmacctl panel start 2 --continue, or pmacctl send --yes '&2R', runs them"),
            "{told}"
        );
        let told = left().check(start(0b10, false), 1, false).unwrap_err().to_string();
        assert!(told.contains("pmacctl send --yes '&2R' runs them") && !told.contains("panel"), "{told}");
        assert!(left().check(start(u32::MAX, false), 1, true).is_err());
        assert!(left().check(start(0b10, false), 2, true).is_ok(), "the board was reset");
        let mut confirmed = left();
        assert!(confirmed.check(start(0b10, true), 1, true).is_ok());
        assert!(confirmed.check(start(0b10, false), 1, true).is_ok(), "they run");
        let mut forgotten = left();
        forgotten.forget(u32::MAX);
        assert!(forgotten.check(start(0b10, false), 1, true).is_ok());
    }

    #[test]
    fn what_was_left_is_asked_about_again_once_another_program_or_a_part_of_it_has_run() {
        let start = Starts { systems: 0b1, confirmed: false };
        let effect = |left: &mut Leftovers, line: &str| {
            let LineEffect { forgets, aborts, .. } = LineEffect::of(line, false, Some(2));
            left.forget(forgets);
            left.aborted(aborts);
        };
        let mut left = Leftovers::default();
        left.set(0b1, 7, 0);
        effect(&mut left, "&1B5");
        assert_eq!((left.unknown(start, 0), left.check(start, 0, true).is_ok()), (0, true), "PROG 5 runs");
        effect(&mut left, "&1B0");
        assert_eq!(left.unknown(start, 0), 0b1);
        for end in ["&1A", "&1Q"] {
            left.find(0b1, 7, 0);
            assert!(left.check(Starts { confirmed: true, ..start }, 0, true).is_ok());
            assert_eq!(left.unknown(start, 0), 0, "they run");
            effect(&mut left, end);
            assert_eq!(left.unknown(start, 0), 0b1, "{end}");
        }
    }

    #[test]
    fn the_board_is_asked_again_at_each_start_of_what_is_left() {
        let start = Starts { systems: 0b1, confirmed: false };
        let mut left = Leftovers::default();
        left.set(0b1, 7, 0);
        for still in [7, 5, 5] {
            assert_eq!(left.left(start), 0b1);
            left.find(0b1, still, 0);
            assert_eq!(left.left(start), 0, "asked");
            let told = left.check(start, 0, true).unwrap_err().to_string();
            assert!(told.contains(&format!("{still} lines of it")), "{told}");
        }
        // Another host, or a reset that nobody saw, has taken it.
        assert_eq!(left.left(start), 0b1);
        left.refused(0b1, NO_BUFFER, 0);
        assert!(left.check(start, 0, true).is_ok());
    }

    #[test]
    fn b1_5_what_is_left_is_not_known_until_the_board_was_asked_or_it_is_gone() {
        let start = Starts { systems: 0b1111, confirmed: false };
        let mut left = Leftovers::default();
        assert_eq!(left.unknown(start, 0), 0b1111);
        assert_eq!(left.unknown(Starts { confirmed: true, ..start }, 0), 0, "they are to run");
        left.set(0b1, 0, 0);
        left.find(0b10, 7, 0);
        left.forget(u32::MAX);
        assert_eq!(left.unknown(start, 0), 0b1100, "a line without a number is no answer");
        left.find(0b10, 7, 0);
        left.forget(0b100);
        assert_eq!(left.unknown(start, 0), 0b1000);
        let told = left.check(start, 0, true).unwrap_err().to_string();
        assert!(told.contains("7 lines of an earlier program are left in &2's rotary buffer"), "{told}");
        // A program that was streamed whole, and aborted.
        left.set(0b1, 0, 0);
        assert_eq!(left.unknown(start, 0), 0b1000, "it runs to its end");
        left.aborted(0b11);
        assert_eq!(left.unknown(start, 0), 0b1001, "of &2 the board has told");
        left.find(0b1, 0, 0);
        // The board refuses to say: it has no buffer, or a program had an error.
        let one = Starts { systems: 0b1, confirmed: false };
        for (error, may_start) in [(5, false), (NO_BUFFER, true)] {
            left.set(0b1, 200, 0);
            assert_eq!(left.left(one), 0b1);
            left.refused(0b1, error, 0);
            assert_eq!((left.left(one), left.check(one, 0, true).is_ok()), (0, may_start), "ERR{error:03}");
        }
        assert_eq!(left.unknown(start, 1), 0, "no rotary buffer is kept over a reset");
        assert!(left.check(start, 1, true).is_ok());
    }
}
