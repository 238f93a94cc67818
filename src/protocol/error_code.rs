//! What PMAC's error numbers mean (software reference manual, I6; 018 and 019 only on Turbo).

/// The meaning of `ERRnnn`.
#[must_use]
pub fn meaning(code: u16) -> &'static str {
    match code {
        1 => "command not allowed while a program runs",
        2 => "password error",
        3 => "data error or unrecognised command",
        4 => "illegal character",
        5 => "command needs an open buffer",
        6 => "no room in the buffer",
        7 => "buffer already in use",
        8 => "MACRO auxiliary communication error",
        9 => "program structure error",
        10 => "both overtravel limits set for a motor of the coordinate system",
        11 => "previous move not completed",
        12 => "a motor of the coordinate system is in open loop",
        13 => "a motor of the coordinate system is not activated",
        14 => "no motor in the coordinate system",
        15 => "not pointing to a valid program buffer",
        16 => "the program is not properly structured",
        17 => "motors are not at the stopped position",
        18 => "phase reference during a move, or a move during phase reference",
        19 => "position change while moves are in the CC buffer",
        _ => "unknown error number",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_of_the_manual_has_a_meaning_of_its_own() {
        let known: std::collections::HashSet<_> = (1..=19).map(meaning).collect();
        assert_eq!(known.len(), 19);
        assert!(!known.contains(meaning(0)));
        assert_eq!(meaning(999), meaning(0));
    }
}
