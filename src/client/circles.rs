//! Arcs that the board replaces by chords: without segmentation (I13=0, on Turbo boards Isx13=0) it moves along the chord (Software
//! Reference p. 305; Turbo Software Reference p. 98).

use std::fmt::Display;
use std::time::Duration;

use super::Connection;
use crate::map::Family;
use crate::protocol::answer;

/// Time limit of the question.
const ANSWER_WITHIN: Duration = Duration::from_secs(5);

/// Whether `text` commands circles: `CIRCLE1`, `CIR2`, `CIRCLE 1`, and `G2` or `G03`, which call `CIRCLE` in the
/// board's PROG 1000.
#[must_use]
pub fn is_circle(text: &str) -> bool {
    // Text in quotes is a message of the program.
    text.to_ascii_uppercase().split('"').step_by(2).any(|part| {
        let mut words = part.match_indices("CIR").map(|(at, word)| &part[at + word.len()..]);
        let mut codes = part.match_indices('G').filter(|(at, _)| !part[..*at].ends_with("PRO"));
        words.any(|rest| rest.strip_prefix("CLE").unwrap_or(rest).trim_start().starts_with(['1', '2']))
            || codes.any(|(at, code)| {
                let rest = part[at + code.len()..].trim_start();
                let end = rest.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(rest.len());
                matches!(rest[..end].parse(), Ok(2.0 | 3.0))
            })
    })
}

/// The warning for the circle at `place`, if the board would not make a circle in `system` (without `system`: in any
/// system). `None` if the board does not answer.
pub fn warning(connection: &mut Connection, place: impl Display, system: Option<u32>) -> Option<String> {
    let family = Family::by_name(&connection.info().ok()?.family).ok()?;
    let systems = match system {
        Some(system) => vec![usize::try_from(system).ok()?],
        None => (1..=family.coordinate_systems).collect(),
    };
    let mut variables: Vec<String> =
        systems.into_iter().map(|system| format!("I{}", family.i.segmentation(system))).collect();
    variables.dedup();
    let told = connection.question(&variables.join(" "), ANSWER_WITHIN).ok()?;
    let variable = match variables.as_slice() {
        [one] => one.clone(),
        [first, .., last] => format!("each of {first} to {last}"),
        [] => return None,
    };
    (!told.is_empty() && told.iter().all(|line| answer::integer(line) == Some(0))).then(|| {
        format!(
            "warning: {place}: while {variable} is 0 the board moves along the chord, not the circle; {} is the segmentation time in ms",
            variables.first().map_or("", String::as_str)
        )
    })
}

#[cfg(test)]
mod tests {
    use super::is_circle;

    #[test]
    fn circles_are_known() {
        for text in [
            "CIRCLE1",
            "circle 2 X10 Y0 I5",
            "CIR1",
            "INC CIR2",
            "X1 CIRCLE1X2",
            "G2 X1 I5",
            "g03x1",
            "N10G 2.0X1",
            "G02",
        ] {
            assert!(is_circle(text), "{text}");
        }
        for text in [
            "CIRCLE",
            "LINEAR",
            "SEND\"CIRCLE1\"",
            "CIRCUS1",
            "G20",
            "G28 X1",
            "G1 X2",
            "G2.1",
            "CMD\"G2\"",
            "OPEN PROG 2",
            "G",
        ] {
            assert!(!is_circle(text), "{text}");
        }
    }
}
