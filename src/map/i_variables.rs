//! What each I-variable is: its title, unit, range, default, and page (Software Reference, Turbo Software Reference of
//! 2014).
//!
//! A line of the table has: the families, P for PMAC, Q for PMAC2, T for Turbo PMAC, U for Turbo PMAC2; the name; what
//! its number counts; title, unit, range, default, page. A name is `I10`; `Ix30`, of each motor; `Is87`, of each
//! coordinate system; `I21..44`; or `I910+10*8`, one in ten from I910 on, eight of them. A range of pages has the
//! variable somewhere.

use serde::Serialize;

use super::Family;
use super::family::Generation;

const TABLE: &str = include_str!("i_variables.tsv");

/// An I-variable of a family.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct IVariable {
    /// Its name: `I130`, or `Ix30` for those of all motors.
    pub name: String,
    /// What it is.
    pub title: &'static str,
    /// Its owner: `motor 1`; empty for one of the board's.
    pub of: String,
    /// Its unit; empty without one.
    pub unit: &'static str,
    /// The values that it takes.
    pub range: &'static str,
    /// The factory default.
    pub default: &'static str,
    /// The manual and the page.
    pub page: String,
}

/// A row of the table, for one family.
struct Row {
    cells: [&'static str; 8],
    /// The first variable's number, and for each count the distance to the next and how many there are.
    first: u16,
    counts: Vec<(u16, u16)>,
}

impl Row {
    /// The row in `line`, if `family` has it.
    fn parse(line: &'static str, family: &Family) -> Option<Self> {
        let mut cells = [""; 8];
        cells.iter_mut().zip(line.split('\t')).for_each(|(cell, text)| *cell = text);
        let letter = match family.number {
            1 => 'P',
            2 => 'Q',
            3 => 'T',
            _ => 'U',
        };
        let spelled = cells[1].strip_prefix('I').filter(|_| cells[0].contains(letter))?;
        let (first, counts) = if let Some(digits) = spelled.strip_prefix('x') {
            (100 + digits.parse::<u16>().ok()?, vec![(100, family.motors as u16)])
        } else if let Some(digits) = spelled.strip_prefix('s') {
            let base = if family.generation == Generation::Turbo { 5100 } else { 100 };
            (base + digits.parse::<u16>().ok()?, vec![(100, family.coordinate_systems as u16)])
        } else if let Some((first, last)) = spelled.split_once("..") {
            let first: u16 = first.parse().ok()?;
            (first, vec![(1, last.parse::<u16>().ok()? + 1 - first)])
        } else {
            let mut parts = spelled.split('+');
            let first = parts.next()?.parse().ok()?;
            let count = |part: &str| {
                let (step, count) = part.split_once('*')?;
                Some((step.parse().ok()?, count.parse().ok()?))
            };
            (first, parts.filter_map(count).collect())
        };
        Some(Self { cells, first, counts })
    }

    /// What the row's number counts, `motor 1`, for the variable `number`; `None` if that is another row's.
    fn owner(&self, number: u16) -> Option<String> {
        let mut rest = number.checked_sub(self.first)?;
        let counted = match &self.cells[1].as_bytes()[1] {
            b'x' => "motor",
            b's' => "coordinate system",
            _ => self.cells[2],
        };
        let mut owner = Vec::new();
        for ((step, count), what) in self.counts.iter().zip(counted.split(',')) {
            let index = (rest / step).min(count - 1);
            rest -= index * step;
            // The vendor counts the ICs from 0.
            let first = u16::from(!what.ends_with("IC"));
            owner.push(format!("{what} {}", index + first));
        }
        (rest == 0).then(|| owner.join(", "))
    }

    fn explained(&self, name: String, of: String, family: &Family) -> IVariable {
        let [_, _, _, title, unit, range, default, page] = self.cells;
        let manual = match family.generation {
            Generation::Turbo => "Turbo Software Reference",
            Generation::Pmac => "Software Reference",
        };
        IVariable { name, title, of, unit, range, default, page: format!("{manual} p. {page}") }
    }
}

fn rows(family: &Family) -> impl Iterator<Item = Row> {
    TABLE.lines().filter_map(|line| Row::parse(line, family))
}

/// The I-variable that `text` names on boards of `family`: `I130`, `Ix30` or `Ixx30`, `Isx87`. `None` for any other
/// text, and for a number without a known meaning.
#[must_use]
pub fn i_variable(text: &str, family: &Family) -> Option<IVariable> {
    let spelled = text.trim().to_ascii_lowercase();
    let spelled = spelled.strip_prefix('i')?;
    if let Ok(number) = spelled.parse() {
        let found = rows(family).find_map(|row| Some((row.owner(number)?, row)));
        return found.map(|(owner, row)| row.explained(format!("I{number}"), owner, family));
    }
    let begin = spelled.len() - spelled.trim_start_matches(['x', 's']).len();
    let (letters, digits) = spelled.split_at(begin);
    let kinds: &[(&str, &str)] = match letters {
        "x" | "xx" => &[("x", "each motor"), ("s", "each coordinate system")],
        "s" | "sx" => &[("s", "each coordinate system")],
        _ => return None,
    };
    let found = kinds.iter().find_map(|(letter, owner)| {
        let name = format!("I{letter}{digits}");
        // On PMAC and PMAC2, Ix87 is a coordinate system's.
        rows(family).find(|row| row.cells[1] == name).map(|row| (row, *owner))
    });
    found.map(|(row, owner)| row.explained(format!("I{letters}{digits}"), owner.to_owned(), family))
}

#[cfg(test)]
mod tests {
    use super::super::{FAMILIES, PMAC, PMAC2, TURBO, TURBO2};
    use super::*;

    fn told(text: &str, family: &Family) -> String {
        i_variable(text, family)
            .map_or_else(String::new, |it| format!("{} | {} | {}", it.of, it.title, it.page))
    }

    #[test]
    fn a_number_names_its_motor_or_coordinate_system() {
        let gain = i_variable("I130", &PMAC).unwrap();
        assert_eq!((&*gain.of, gain.default, &*gain.page), ("motor 1", "2000", "Software Reference p. 86"));
        assert!(gain.title.starts_with("proportional gain"));
        assert!(told("i3230", &TURBO2).starts_with("motor 32 | proportional gain"));
        assert!(told("I287", &PMAC2).starts_with("coordinate system 2 | acceleration time"));
        assert!(told("I287", &TURBO2).starts_with("motor 2 | reversal"));
        assert!(told("I5287", &TURBO2).starts_with("coordinate system 2 | acceleration time"));
        assert!(told("Ixx30", &TURBO2).starts_with("each motor | proportional gain"));
        for text in ["Ix87", "Isx87", "Is87"] {
            assert!(told(text, &PMAC).starts_with("each coordinate system | acceleration"), "{text}");
        }
        assert!(told("Ixx87", &TURBO2).starts_with("each motor | reversal"));
        assert!(told("I44", &PMAC).starts_with("source 24 | register to gather"));
        assert!(told("I915", &PMAC).starts_with("encoder 4 | how the encoder"));
        assert!(told("I922", &PMAC2).starts_with("channel 2 | input and edge"));
        assert!(told("I7123", &TURBO2).starts_with("servo IC 1, channel 2 | flag for the capture"));
        assert!(told("I7123", &TURBO).contains("3 fault"));
        for (text, family) in
            [("I930", &PMAC), ("I8", &PMAC), ("I24", &TURBO2), ("I8191", &TURBO), ("I3300", &TURBO)]
        {
            assert!(!told(text, family).is_empty(), "{text}");
        }
        for text in ["I", "130", "Ix", "I1x", "I9999", "Isx30", "P1", "Ixxx30", "é", "I8192", "I66000"] {
            assert_eq!(i_variable(text, &PMAC), None, "{text}");
        }
    }

    #[test]
    fn every_line_is_whole_and_no_number_has_two_meanings() {
        for line in TABLE.lines() {
            assert_eq!(line.split('\t').count(), 8, "{line}");
            assert!(FAMILIES.iter().any(|family| Row::parse(line, family).is_some()), "{line}");
        }
        for family in FAMILIES {
            let rows: Vec<Row> = rows(family).collect();
            for number in 0..8192 {
                let titles: Vec<_> = rows.iter().filter(|row| row.owner(number).is_some()).collect();
                assert!(titles.len() <= 1, "{} I{number}", family.name);
            }
            for number in (0..=20).chain([100, 130, 169, 186, 200]) {
                assert!(i_variable(&format!("I{number}"), family).is_some(), "{} I{number}", family.name);
            }
        }
    }
}
