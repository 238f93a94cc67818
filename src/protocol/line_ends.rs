//! What a command line ends: programs, motions, a gather, or what is open. Who waits for one of these is told who has sent it.

use std::fmt::Write as _;

use super::line;
use super::moved_motors::motors_moved;
use super::tokens::{self, Kind, Needs};

/// What resets the board, and so ends everything.
pub const RESET: &str = "$$$";

/// What a line ends, as far as its text tells. In the masks bit 0 is number 1; every bit is set where the line names none: what
/// is addressed then, nobody but the board knows.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct LineEnds {
    /// The commands that do it: `&1Q`.
    pub what: String,
    /// A command of it names neither motor nor coordinate system, and goes to what is addressed.
    pub unnamed: bool,
    /// The coordinate systems whose programs end.
    pub systems: u32,
    /// The motors that stop, or are sent elsewhere.
    pub motors: u32,
    /// The coordinate systems whose rotary buffers are taken away.
    pub rotary: u32,
    /// A gather, and its buffer.
    pub gather: bool,
    /// The program buffer that is open.
    pub buffer: bool,
}

impl LineEnds {
    /// Of `line`; `None` where it ends nothing.
    #[must_use]
    pub fn of(line: &str) -> Option<Self> {
        let commands = line::commands(line).collect::<Vec<_>>().join(" ").to_ascii_uppercase();
        if line::resets(line.as_bytes()) {
            return Some(Self::all(RESET));
        }
        let mut ends = Self::default();
        // Words may have blanks in them, and be cut short: `END GATHER`, `DEL ROT` (GRAMMAR 1 and 2.7).
        let plain = line::plain(line);
        let have = |commands: &str, words: [&str; 2]| words.iter().any(|word| commands.contains(word));
        for (what, words) in [("ENDGATHER", ["ENDG"; 2]), ("DELETE GATHER", ["DELETEGAT", "DELGAT"])] {
            if have(&plain, words) {
                ends.gather = true;
                ends.add(what);
            }
        }
        let rotary = ["DELETEROT", "DELROT"];
        if have(&plain, rotary) {
            let named = line::addressed(&plain, '&').filter(|(_, commands)| have(commands, rotary));
            let named = named.fold(0, |mask, (bit, _)| mask | bit);
            ends.rotary = if named == 0 { u32::MAX } else { named };
            ends.add("DELETE ROT");
        }
        ends.add_commands(&commands);
        (!ends.what.is_empty()).then_some(ends)
    }

    /// Everything, by `what`.
    #[must_use]
    pub fn all(what: &str) -> Self {
        let all = u32::MAX;
        let what = what.to_owned();
        Self { what, unnamed: false, systems: all, motors: all, rotary: all, gather: true, buffer: true }
    }

    /// Of `commands`, in capitals, one by one.
    fn add_commands(&mut self, commands: &str) {
        let (mut motor, mut system) = (None, None);
        for token in tokens::of_known(commands) {
            let said: String = commands[token.span].split_ascii_whitespace().collect();
            match (token.kind, said.as_str()) {
                (Kind::Motor(number), _) => motor = Some(number),
                (Kind::System(number), _) => system = Some(number),
                (Kind::Moves(Needs::System), "A" | "Q" | "S" | "/" | "\\") => {
                    self.systems |= self.add_ended('&', system, &said);
                }
                (Kind::Moves(Needs::Motor), "J/" | "K") => self.motors |= self.add_ended('#', motor, &said),
                // Of a move that names no motor nobody knows whose it is.
                (Kind::Moves(Needs::Motor), _)
                    if motor.is_some_and(|number| motors_moved(&format!("#{number}{said}")) != 0) =>
                {
                    self.motors |= self.add_ended('#', motor, &said);
                }
                (Kind::Changes, "CLOSE" | "CLS") => {
                    self.buffer = true;
                    self.add(&said);
                }
                _ => {}
            }
        }
    }

    /// Adds `command`, to whom `sign` and `number` address; gives the bit, or all bits where nobody is.
    fn add_ended(&mut self, sign: char, number: Option<u32>, command: &str) -> u32 {
        let Some(number) = number else {
            self.unnamed = true;
            self.add(command);
            return u32::MAX;
        };
        let bit = line::bit(number);
        if bit != 0 {
            self.add(&format!("{sign}{number}{command}"));
        }
        bit
    }

    fn add(&mut self, command: &str) {
        let blank = if self.what.is_empty() { "" } else { " " };
        // Writing to a string cannot fail.
        let _ = write!(self.what, "{blank}{command}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn b1_9_a_line_tells_which_programs_motions_and_gathers_it_ends() {
        let all = u32::MAX;
        for (line, what, systems, motors) in [
            ("&1Q", "&1Q", 0b1, 0),
            ("& 2 a", "&2A", 0b10, 0),
            ("Q", "Q", all, 0),
            ("&1Q#2J/", "&1Q #2J/", 0b1, 0b10),
            ("#1K", "#1K", 0, 0b1),
            ("#1J/#3J/#2", "#1J/ #3J/", 0, 0b101),
            ("#3 J/ M340=1", "#3J/", 0, 0b100),
            ("J/", "J/", 0, all),
            ("#1J=5000", "#1J=5000", 0, 0b1),
            ("P1 &2\\", "&2\\", 0b10, 0),
            ("P1=5 &2\\", "\\", all, 0),
            ("#1J/P1", "#1J/", 0, 0b1),
            ("#1KP1", "#1K", 0, 0b1),
            ("&2#1Q", "&2Q", 0b10, 0),
            ("&1PRA", "&1A", 0b1, 0),
            ("&9999Q", "&9999Q", 0, 0),
        ] {
            let ends = LineEnds::of(line).unwrap_or_default();
            let expected = if systems | motors == 0 { String::new() } else { what.to_owned() };
            assert_eq!((ends.what, ends.systems, ends.motors), (expected, systems, motors), "{line}");
            assert_eq!(ends.unnamed, [systems, motors].contains(&all), "{line}");
            assert!(!ends.gather && !ends.buffer && ends.rotary == 0, "{line}");
        }
        for (line, what, rotary, gather, buffer) in [
            ("ENDGATHER", "ENDGATHER", 0, true, false),
            ("end gather", "ENDGATHER", 0, true, false),
            ("endg", "ENDGATHER", 0, true, false),
            ("DEL GAT", "DELETE GATHER", 0, true, false),
            ("&2 DELETE ROTARY", "DELETE ROT", 0b10, false, false),
            ("DELETE ROT", "DELETE ROT", all, false, false),
            ("CLOSE", "CLOSE", 0, false, true),
            ("P1=5CLS", "CLS", 0, false, true),
        ] {
            let ends = LineEnds::of(line).unwrap();
            assert_eq!(
                (ends.what.as_str(), ends.rotary, ends.gather, ends.buffer),
                (what, rotary, gather, buffer)
            );
        }
        assert_eq!(LineEnds::of("$$$***"), Some(LineEnds::all(RESET)));
        for line in
            ["Q5", "&1Q70=100", "&1B5R", "#1P", "ABS", "&1H", "SEND\"&1Q\"", "M1=1", "", "#", "GATHER"]
        {
            assert_eq!(LineEnds::of(line), None, "{line}");
        }
    }
}
