//! The family in a board's answer to `TYPE`.

use std::fmt;

use super::{Family, PMAC, PMAC2, TURBO, TURBO2};

/// A board whose answer to `TYPE` contradicts its configured family.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OtherFamily {
    /// The configured family.
    pub taken: &'static Family,
    /// The family in the answer.
    pub says: &'static Family,
}

impl OtherFamily {
    /// Whether the two families use the same words for different functions.
    #[must_use]
    pub fn is_laid_out_otherwise(&self) -> bool {
        self.taken.generation != self.says.generation
    }
}

impl fmt::Display for OtherFamily {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { taken, says } = self;
        write!(
            f,
            "the board says by TYPE that it is a {}, but pmacd takes it for a {}",
            says.title, taken.title
        )?;
        if self.is_laid_out_otherwise() {
            f.write_str(", which has other functions in the same words: stop pmacd before anything else")?;
        } else {
            f.write_str(", which has the same functions in the same words")?;
        }
        f.write_str("; ")?;
        // A Turbo board may have a DPRAM of either size (Turbo User Manual p. 397).
        if says.lengths().count() > 1 {
            write!(f, "if its DPRAM has {} x 16 bits, ", says.dpram().to_uppercase())?;
        }
        write!(f, "write family = \"{}\"", says.name)
    }
}

/// The message for a board that [`lacks_dpram`].
pub const LACKS_DPRAM: &str = "the board says by TYPE that it is a PMAC STD, for which the DPRAM (Option 2) is not available: \
                               what pmacd reads may be no DPRAM of this board; see `board` in its configuration";

/// Whether the answer to `TYPE` names a board without any DPRAM: a board for the STD bus (Software Reference p. 286).
#[must_use]
pub fn lacks_dpram(answer: &str) -> bool {
    answer.split(',').nth(1).is_some_and(|bus| bus.trim() == "STD")
}

impl Family {
    /// The member of this family's generation that `TYPE` names; without one, this family.
    #[must_use]
    pub fn told_by_type(&'static self, answer: &str) -> &'static Self {
        Self::of_type(answer).filter(|told| told.generation == self.generation).unwrap_or(self)
    }

    /// The family in the answer to `TYPE`, if it differs from this one.
    #[must_use]
    pub fn contradicted_by_type(&'static self, answer: &str) -> Option<OtherFamily> {
        let says = Self::of_type(answer).filter(|told| told.number != self.number)?;
        Some(OtherFamily { taken: self, says })
    }

    /// The family that an answer to `TYPE` names (Software Reference p. 286); `None` for an unknown text.
    #[must_use]
    pub fn of_type(answer: &str) -> Option<&'static Self> {
        // An Ultralite (`PMACUL`, `TURBOU`) is a PMAC2 without its own axes.
        match answer.split(',').next().map(str::trim) {
            Some("PMAC1") => Some(&PMAC),
            Some("PMAC2" | "PMACUL") => Some(&PMAC2),
            Some("TURBO1") => Some(&TURBO),
            Some("TURBO2" | "TURBOU") => Some(&TURBO2),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::FAMILIES;

    const ANSWERS: [&str; 4] = ["PMAC1, ISA, BATTERY", "PMAC2, VME", "TURBO1, X4", "TURBO2, X4"];

    #[test]
    fn type_tells_a_board_of_another_family() {
        for (at, taken) in FAMILIES.iter().copied().enumerate() {
            for (says, answer) in ANSWERS.into_iter().enumerate() {
                let told = taken.contradicted_by_type(answer).map(|other| other.says.name);
                let expected = (at != says).then_some(FAMILIES[says].name);
                assert_eq!(told, expected, "{} {answer}", taken.name);
            }
            assert_eq!(taken.contradicted_by_type("UMAC 7"), None, "a text that is not known tells nothing");
        }
    }

    #[test]
    fn only_a_board_for_the_std_bus_lacks_the_dpram() {
        assert!(lacks_dpram("PMAC1, STD, BATTERY, PID, CLK X1") && lacks_dpram("PMAC1,STD"));
        for answer in ANSWERS.into_iter().chain(["PMAC1, ISA/VME, FLASH", "PMAC1", "STD", ""]) {
            assert!(!lacks_dpram(answer), "{answer}");
        }
    }

    #[test]
    fn only_the_other_generation_is_laid_out_otherwise() {
        let told = |taken: &'static Family, answer| taken.contradicted_by_type(answer).unwrap();
        let other = told(&PMAC, "TURBO2, X4");
        assert!(other.is_laid_out_otherwise());
        let text = other.to_string();
        assert!(
            text.contains("is a Turbo PMAC2, but pmacd takes it for a PMAC, which has other functions"),
            "{text}"
        );
        assert!(text.ends_with("if its DPRAM has 32K x 16 bits, write family = \"turbo2\""), "{text}");
        let alike = told(&PMAC, "PMACUL, VME");
        assert!(!alike.is_laid_out_otherwise());
        assert!(alike.to_string().contains("has the same functions in the same words"), "{alike}");
        assert!(!told(&TURBO, "TURBOU, X4").is_laid_out_otherwise());
        // All PMACs have a DPRAM of one size.
        assert!(alike.to_string().ends_with("words; write family = \"pmac2\""), "{alike}");
    }
}
