//! What the letters of a line tell of it, on a thread that does not allocate.

use crate::protocol::tokens::{self, Kind};

/// Whether a line can do more than ask for, or set, variables and say where motors are. Saving and listing take long, and move
/// nothing; what stands behind them may.
pub(super) fn may_move(line: &[u8]) -> bool {
    let mut may_move = false;
    tokens::each_known(line, |line, token| {
        let said = &line[token.span.clone()];
        may_move |= match token.kind {
            Kind::Moves(_) | Kind::WritesMemory | Kind::Unknown => true,
            Kind::Changes => said != b"SAVE" && !b"#&".contains(&said[0]),
            _ => false,
        };
    });
    may_move
}

/// Whether a line can start a motion program: by `R` or `S`, whatever else it says, by `>`, or by a reset.
pub(super) fn may_start_program(line: &[u8]) -> bool {
    may_move(line) && line.iter().any(|byte| b"RS>$".contains(&byte.to_ascii_uppercase()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_known_by_their_letters() {
        for line in ["#1J+", "&1R", "ENABLE PLC 3", "#1HM", "#1$", "&1<", "&1>", "&1\\", "&1%100"] {
            assert!(may_move(line.as_bytes()), "{line}");
        }
        for (line, starts) in
            [("&1B5R", true), ("&2s", true), ("&1>", true), ("#1J+", false), ("LIST PROG 1", false)]
        {
            assert_eq!(may_start_program(line.as_bytes()), starts, "{line}");
        }
        for line in [
            "SAVE",
            "LIST PROG 1",
            "I10=P1",
            "P1=5",
            "M1=0",
            "#1",
            "TYPE",
            "SIZE",
            "LIST TCOMP",
            "I10",
            "p1..5",
            "M1->",
            "#1P",
        ] {
            assert!(!may_move(line.as_bytes()), "{line}");
        }
    }

    #[test]
    fn what_stands_behind_a_save_or_a_list_may_move() {
        for line in ["SAVE#1J+", "save #1j+", "LIST LINK HM", "LIST PROG 1 &1R", "P1=5#1J+", "SAVE&1B1R"] {
            assert!(may_move(line.as_bytes()), "{line}");
        }
    }
}
