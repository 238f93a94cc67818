//! The meaning of each status bit in a sentence, for people (Software Reference p. 189-198, Turbo Software Reference p.
//! 283-290). A line of the table has the owner of the word, the bit's name, and the meaning of a set bit.

use super::StatusTable;

const MEANINGS: &str = include_str!("meanings.tsv");

/// The owners and the names that [`MEANINGS`] knows, each with its meaning.
fn rows() -> impl Iterator<Item = [&'static str; 3]> {
    MEANINGS.lines().filter_map(|line| {
        let (owner, rest) = line.split_once('\t')?;
        let (name, meaning) = rest.split_once('\t')?;
        Some([owner, name, meaning])
    })
}

impl StatusTable {
    /// The owner of the word: `motor`, `system` or `board`.
    #[must_use]
    pub fn owner(&self) -> &'static str {
        match self.name {
            "servo_status" | "motor_status" => "motor",
            "global_status_x" | "global_status_y" => "board",
            _ => "system",
        }
    }

    /// The meaning of the flag or field `name` of this word; empty for a name that the word does not have.
    #[must_use]
    pub fn meaning(&self, name: &str) -> &'static str {
        let owner = self.owner();
        rows().find(|row| row[..2] == [owner, name]).map_or("", |[_, _, meaning]| meaning)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{PMAC, TURBO};
    use super::*;

    #[test]
    fn every_bit_has_one_meaning_and_every_meaning_a_bit() {
        let mut named: Vec<[&str; 2]> = Vec::new();
        for tables in [&PMAC, &TURBO] {
            for table in [tables.motor, tables.coordinate_system, tables.global].into_iter().flatten() {
                let flags = table.flags.iter().map(|(_, name)| *name);
                for name in flags.chain(table.fields.iter().map(|field| field.name)) {
                    assert!(!table.meaning(name).is_empty(), "{} {name}", table.name);
                    named.push([table.owner(), name]);
                }
            }
        }
        let mut seen = Vec::new();
        for [owner, name, meaning] in rows() {
            assert!(named.contains(&[owner, name]), "{owner} {name}: no such bit");
            assert!(!seen.contains(&[owner, name]), "{owner} {name} twice");
            assert!(!meaning.ends_with('.') && meaning.chars().count() <= 100, "{name}");
            seen.push([owner, name]);
        }
        assert_eq!(rows().count(), MEANINGS.lines().count());
    }
}
