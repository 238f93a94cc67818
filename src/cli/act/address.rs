//! The motor and coordinate system that the board has addressed.
//!
//! `#n` and `&n` stay in force for later lines of all users (User Manual p. 29): another user may change the address. A
//! line that names its motor or coordinate system does not depend on the address.

use std::fmt;

/// The addressed motor and coordinate system.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Addressed {
    motor: u32,
    system: u32,
}

impl Addressed {
    /// The question; [`Addressed::of`] reads the answer.
    pub const QUESTION: &str = "# &";

    /// Reads the answer to [`Addressed::QUESTION`].
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::language::Meaning;

    fn goes_by_address(line: &str) -> bool {
        Meaning::of(line).goes_by_address
    }

    #[test]
    fn a_line_tells_whether_it_goes_by_the_address() {
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
    fn the_answer_to_the_question_is_the_address() {
        let of =
            |reply: &[&str]| Addressed::of(&reply.iter().map(|line| (*line).to_owned()).collect::<Vec<_>>());
        assert_eq!(of(&["2", "1"]).map(|addressed| addressed.to_string()).as_deref(), Some("#2 &1"));
        assert_eq!((of(&["2"]), of(&["2", "x"])), (None, None));
    }
}
