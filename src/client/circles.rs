//! Arcs that the board would not make: without segmentation (I13=0) it moves along the chord (Software Reference p. 305).

use std::fmt::Display;
use std::time::Duration;

use super::Connection;
use crate::map::Family;

/// Time limit of the question.
const PATIENCE: Duration = Duration::from_secs(5);

/// Whether `text` switches to circles: `CIRCLE1`, `CIR2`, `CIRCLE 1`.
#[must_use]
pub fn is_circle(text: &str) -> bool {
    let upper = text.to_ascii_uppercase();
    // What stands in quotes is text that a program sends.
    upper.split('"').step_by(2).any(|part| {
        part.match_indices("CIR").any(|(at, word)| {
            let behind = &part[at + word.len()..];
            behind.strip_prefix("CLE").unwrap_or(behind).trim_start().starts_with(['1', '2'])
        })
    })
}

/// The warning for the circle at `place`, if the board would make none of it. Nothing is said where the board cannot be asked.
pub fn warning(connection: &mut Connection, place: impl Display) -> Option<String> {
    let variable = Family::by_name(&connection.info().ok()?.family).ok()?.i.segmentation?;
    let told = connection.question(&format!("I{variable}"), PATIENCE).ok()?;
    (told.first()?.trim() == "0").then(|| {
        format!(
            "warning: {place}: while I{variable} is 0 the board moves along the chord, not the circle; I{variable} is the segmentation \
             time in ms"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::is_circle;

    #[test]
    fn b5_5_circles_are_known() {
        for text in ["CIRCLE1", "circle 2 X10 Y0 I5", "CIR1", "INC CIR2", "X1 CIRCLE1X2"] {
            assert!(is_circle(text), "{text}");
        }
        for text in ["CIRCLE", "LINEAR", "SEND\"CIRCLE1\"", "CIRCUS1"] {
            assert!(!is_circle(text), "{text}");
        }
    }
}
