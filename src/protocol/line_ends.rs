//! What a command line ends: programs, motions, a gather, or what is open. Who waits for one of these is told who has sent it.

use std::fmt::Write as _;

use super::line;
use super::moved_motors::motors_moved;

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
        let mut rest = commands.as_str();
        while !rest.is_empty() {
            let next = rest.char_indices().skip(1).find(|(_, c)| ['#', '&'].contains(c));
            let next = next.map_or(rest.len(), |(at, _)| at);
            let (part, behind) = rest.split_at(next);
            ends.add_part(part);
            rest = behind;
        }
        (!ends.what.is_empty()).then_some(ends)
    }

    /// Everything, by `what`.
    #[must_use]
    pub fn all(what: &str) -> Self {
        let all = u32::MAX;
        let what = what.to_owned();
        Self { what, unnamed: false, systems: all, motors: all, rotary: all, gather: true, buffer: true }
    }

    /// Of what follows one address, or stands before the first.
    fn add_part(&mut self, part: &str) {
        let sign = part.chars().next().filter(|sign| ['#', '&'].contains(sign));
        let said = part.trim_start_matches(['#', '&', ' ']);
        let (number, commands) =
            said.split_at(said.find(|c: char| !c.is_ascii_digit()).unwrap_or(said.len()));
        let bit = number.parse().ok().and_then(|number: u32| 1_u32.checked_shl(number.checked_sub(1)?));
        let of = |wanted| if sign == Some(wanted) { bit.unwrap_or_default() } else { u32::MAX };
        let address = sign.map_or_else(String::new, |sign| format!("{sign}{number}"));
        for command in commands.split_ascii_whitespace() {
            let (systems, motors, address) = match command {
                "A" | "Q" | "S" | "/" | "\\" => (of('&'), 0, if sign == Some('&') { &*address } else { "" }),
                "J/" | "K" => (0, of('#'), if sign == Some('#') { &*address } else { "" }),
                _ => {
                    let elsewhere = motors_moved(&format!("{address}{command}"));
                    (0, elsewhere, &*address)
                }
            };
            if matches!(command, "CLOSE" | "CLS") {
                self.buffer = true;
                self.add(command);
            } else if systems | motors != 0 {
                self.unnamed |= [systems, motors].contains(&u32::MAX);
                self.systems |= systems;
                self.motors |= motors;
                self.add(&format!("{address}{command}"));
            }
        }
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
            ("P1=5 &2\\", "&2\\", 0b10, 0),
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
            ("P1=PASSWORD CLS", "CLS", 0, false, true),
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
