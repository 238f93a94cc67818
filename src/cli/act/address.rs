//! What is addressed on the board, and which lines go by it.
//!
//! `#n` and `&n` stay in force for later lines, and for everybody's (User Manual p. 29): what one user has addressed another one
//! changes. A line that names what it is for goes there all the same.

use std::fmt;

use crate::protocol::line;

/// The addressed motor and coordinate system.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Addressed {
    motor: u32,
    system: u32,
}

impl Addressed {
    /// Asks the board; the answer to it is read by [`Addressed::of`].
    pub const QUESTION: &str = "# &";

    /// What the board has answered.
    pub fn of(reply: &[String]) -> Option<Self> {
        let [motor, system] = reply else { return None };
        Some(Self { motor: motor.trim().parse().ok()?, system: system.trim().parse().ok()? })
    }
}

impl fmt::Display for Addressed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "#{} &{}", self.motor, self.system)
    }
}

/// Whether `line` has a command for the motor or coordinate system that is addressed, and does not name it before.
pub fn goes_by_address(line: &str) -> bool {
    let commands = line::commands(line).collect::<Vec<_>>().join(" ").to_ascii_uppercase();
    let (mut named_motor, mut named_system) = (false, false);
    let mut rest = commands.as_str();
    while !rest.is_empty() {
        let next = rest.char_indices().skip(1).find(|(_, c)| ['#', '&'].contains(c));
        let (part, behind) = rest.split_at(next.map_or(rest.len(), |(at, _)| at));
        let said = part.trim_start_matches(['#', '&', ' ']);
        let words = said.trim_start_matches(|c: char| c.is_ascii_digit());
        // `#1`, not `#` alone, which asks.
        let is_address = words.len() < said.len();
        named_motor |= is_address && part.starts_with('#');
        named_system |= is_address && part.starts_with('&');
        let goes_by = |word: &str| match whose(word) {
            Some(Whose::Motor) => !named_motor,
            Some(Whose::System) => !named_system,
            None => false,
        };
        let words: Vec<&str> =
            if part.starts_with(['#', '&']) { words } else { part }.split_ascii_whitespace().collect();
        let goes_by_table = |what: &str| goes_by_table(what, named_motor, named_system);
        let of_two = words
            .windows(2)
            .any(|two| matches!(two, ["DEFINE" | "DEF" | "DELETE" | "DEL", what] if goes_by_table(what)));
        if of_two || words.iter().any(|word| goes_by(word)) {
            return true;
        }
        rest = behind;
    }
    false
}

/// Whether a table or buffer of this kind is the addressed motor's or coordinate system's.
fn goes_by_table(what: &str, named_motor: bool, named_system: bool) -> bool {
    let is_systems = ["ROT", "LOOK"].iter().any(|kind| what.starts_with(kind));
    let is_motors = ["COMP", "BLCOMP", "TCOMP"].iter().any(|kind| what.starts_with(kind));
    is_systems && !named_system || is_motors && !named_motor
}

enum Whose {
    Motor,
    System,
}

/// Whether the command `word`, in capitals, addresses a motor or a coordinate system, or neither (Software Reference,
/// "On-line commands", pp. 171-300).
fn whose(word: &str) -> Option<Whose> {
    let mut letters = word.chars();
    let (first, second) = (letters.next()?, letters.next());
    let has_number = second.is_some_and(|c| c.is_ascii_digit() || matches!(c, '-' | '.' | '$' | '('));
    match (word, first) {
        ("P" | "V" | "F" | "K" | "?" | "$" | "$*" | "HOME" | "HM" | "HOMEZ" | "HMZ", _) => Some(Whose::Motor),
        (_, 'J') => Some(Whose::Motor),
        (_, 'O') if has_number => Some(Whose::Motor),
        ("A" | "R" | "S" | "H" | "Z" | "/" | "\\" | "<" | ">" | "??" | "$$" | "$$*", _) => {
            Some(Whose::System)
        }
        ("PC" | "PE" | "PR" | "LEARN" | "UNDEFINE" | "ABS" | "INC" | "FRAX" | "PMATCH" | "MFLUSH", _) => {
            Some(Whose::System)
        }
        (_, 'Q' | '%') => Some(Whose::System),
        (_, 'B') if has_number => Some(Whose::System),
        (_, 'A' | 'B' | 'C' | 'U' | 'V' | 'W' | 'X' | 'Y' | 'Z') if second == Some('=') => {
            Some(Whose::System)
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn b1_2_a_line_tells_whether_it_goes_by_the_address() {
        for line in ["J+", "j/", "J=5000", "P", "?", "HM", "K", "O10", "&1J+", "P1=5 J+", "#", "$"] {
            assert_eq!(goes_by_address(line), line != "#", "{line}");
        }
        for line in [
            "R",
            "A",
            "Q",
            "Q5",
            "Q5=1",
            "B1R",
            "%50",
            "??",
            "PC",
            "#1R",
            "X=5",
            "DEFINE ROT 100",
            "DEL COMP",
        ] {
            assert!(goes_by_address(line), "{line}");
        }
        for line in [
            "#1J+",
            "# 2 J/ M340=1",
            "#1 P",
            "&2R",
            "&1B5R",
            "&1#2J+",
            "#2&1Q",
            "P1",
            "P1=5",
            "I122",
            "M1=1",
            "OPEN PROG 7 CLEAR",
            "LIST PROG 7",
            "CLOSE",
            "GATHER",
            "SIZE",
            "TYPE",
            "VERSION",
            "???",
            "$$$",
            "SAVE",
            "ENABLE PLC 1",
            "&3DEFINE ROT 100",
            "SEND\"J+\"",
            "#5",
            "&",
            "",
        ] {
            assert!(!goes_by_address(line), "{line}");
        }
    }

    #[test]
    fn b1_2_the_answer_to_the_question_is_the_address() {
        let of =
            |reply: &[&str]| Addressed::of(&reply.iter().map(|line| (*line).to_owned()).collect::<Vec<_>>());
        assert_eq!(of(&["2", "1"]).map(|addressed| addressed.to_string()).as_deref(), Some("#2 &1"));
        assert_eq!((of(&["2"]), of(&["2", "x"])), (None, None));
    }
}
