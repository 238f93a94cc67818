//! What the letters of a line tell of it, on a thread that does not allocate.

use crate::protocol::line::only_asks_for_variables;

/// Whether a line can do more than ask for, or set, variables and say where motors are: those have no other letters, and no signs of
/// commands (`#1$`, `&1<`, `&1%100`). Saving and listing take long, and move nothing.
pub(super) fn may_move(line: &[u8]) -> bool {
    let begins = |word: &[u8]| line.get(..word.len()).is_some_and(|start| start.eq_ignore_ascii_case(word));
    let moves = |byte: &u8| match byte {
        b'$' | b'%' | b'<' | b'\\' | b'/' => true,
        byte => byte.is_ascii_alphabetic() && !b"IPQMVF".contains(&byte.to_ascii_uppercase()),
    };
    !begins(b"SAVE") && !begins(b"LIST") && (line.iter().any(moves) || is_arrow_alone(line))
}

/// Whether a line can start a motion program: by `R` or `S`, whatever else it says, by `>`, or by a reset.
pub(super) fn may_start_program(line: &[u8]) -> bool {
    may_move(line) && line.iter().any(|byte| b"RS>$".contains(&byte.to_ascii_uppercase()))
}

/// `&1>` begins to move; `M1->` asks.
fn is_arrow_alone(line: &[u8]) -> bool {
    (0..line.len()).any(|at| line[at] == b'>' && (at == 0 || line[at - 1] != b'-'))
}

/// Whether the board has a value to answer: the line asks for variables, or ends with a question for a motor or coordinate system.
pub(super) fn asks_for_value(line: &[u8]) -> bool {
    let line = line.trim_ascii();
    let ends = |letters: &[u8]| line.last().is_some_and(|byte| letters.contains(&byte.to_ascii_uppercase()));
    only_asks_for_variables(line) || !may_move(line) && !line.contains(&b'=') && ends(b"PVF?")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_known_by_their_letters() {
        for line in ["I10", "p1..5", "M1->", "Q1 P2", "#1P", "#3?", "&2?", "?", "#1P#2P"] {
            assert!(asks_for_value(line.as_bytes()) && !may_move(line.as_bytes()), "{line}");
        }
        for line in
            ["", "P1=5", "#1", "&2", "#1J+", "I10=P1", "LIST PROG 1", "SAVE", "#1J+ #1P", "OPEN PROG 5"]
        {
            assert!(!asks_for_value(line.as_bytes()), "{line}");
        }
        for line in ["#1J+", "&1R", "ENABLE PLC 3", "#1HM", "#1$", "&1<", "&1>", "&1\\", "&1%100"] {
            assert!(may_move(line.as_bytes()), "{line}");
        }
        for (line, starts) in
            [("&1B5R", true), ("&2s", true), ("&1>", true), ("#1J+", false), ("LIST PROG 1", false)]
        {
            assert_eq!(may_start_program(line.as_bytes()), starts, "{line}");
        }
    }
}
