//! Whether two texts set a board to the same values: a board lists in its own spelling.

use std::collections::BTreeMap;

use crate::map::number::same_when_listed;
use crate::protocol::answer;
use crate::rotary::same_line;

/// Whether two numbers are the same in a listing.
pub fn same_number(one: &str, other: &str) -> bool {
    matches!((answer::number(one), answer::number(other)), (Some(one), Some(other)) if same_when_listed(one, other))
}

/// The lines of a program that have an effect, each as [`same_line`] compares it. A program means the same with and
/// without `RETURN` at its end.
pub fn program(text: &str) -> Vec<&str> {
    let mut lines: Vec<&str> = text.lines().filter(|line| !line.trim().is_empty()).collect();
    while lines.pop_if(|line| same_line(line, "RETURN")).is_some() {}
    lines
}

/// Whether two programs are the same.
pub fn same_program(one: &str, other: &str) -> bool {
    let (one, other) = (program(one), program(other));
    one.len() == other.len() && one.iter().zip(other).all(|(one, other)| same_line(one, other))
}

/// Whether two axis definitions are the same: `1000.0X + 5` and `1000X+5`.
pub fn same_axis(one: &str, other: &str) -> bool {
    let (Some(one), Some(other)) = (terms(one), terms(other)) else { return false };
    one.len() == other.len()
        && one.iter().zip(&other).all(|(one, other)| one.0 == other.0 && same_when_listed(*one.1, *other.1))
}

/// The terms of an axis definition, each with its axis; the offset has none. `None` for anything else.
fn terms(text: &str) -> Option<BTreeMap<Option<char>, f64>> {
    let plain: String = text.chars().filter(|c| *c != ' ').map(|c| c.to_ascii_uppercase()).collect();
    let mut terms = BTreeMap::from([(None, 0.0)]);
    let mut rest = plain.as_str();
    while !rest.is_empty() {
        let (sign, behind) = match rest.strip_prefix('-') {
            Some(behind) => (-1.0, behind),
            None => (1.0, rest.strip_prefix('+').unwrap_or(rest)),
        };
        let end = behind.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(behind.len());
        let (digits, behind) = behind.split_at(end);
        let axis = behind.chars().next().filter(char::is_ascii_alphabetic);
        let scale = if digits.is_empty() && axis.is_some() { 1.0 } else { digits.parse().ok()? };
        rest = &behind[usize::from(axis.is_some())..];
        let is_next = rest.is_empty() || rest.starts_with(['+', '-']);
        if !is_next || (terms.insert(axis, sign * scale).is_some() && axis.is_some()) {
            return None;
        }
    }
    (!plain.is_empty()).then_some(terms)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axis_definitions_are_compared_by_their_terms() {
        for (one, other) in
            [("1000.0x + 5", "1000X+5"), ("X", "1X"), ("10X-5Y+0", "-5Y+10X"), ("0", "0.0"), ("i", "I")]
        {
            assert!(same_axis(one, other), "{one}");
        }
        for (one, other) in
            [("X", "Y"), ("X", "0"), ("10X", "10X+1"), ("X", "-X"), ("?", "?"), ("", "0"), ("XX", "X")]
        {
            assert!(!same_axis(one, other), "{one}");
        }
    }

    #[test]
    fn a_return_at_the_end_of_a_program_is_no_difference() {
        assert!(same_program("LINEAR\n\nX10\nRETURN", "LIN\nX10") && same_program("", "RET\n"));
        assert!(!same_program("RET\nX1", "X1") && !same_program("X1\nX2", "X2\nX1"));
    }
}
