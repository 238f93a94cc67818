//! `[[motor]]`: the name that users give a motor, and the unit in which they think.

use serde::Deserialize;

use super::span::Refusal;
use crate::format::Text;
use crate::format::visible::is_hidden;
use crate::map::Family;
use crate::segment::identity::NAME_BYTES;
use crate::segment::{Identity, UserUnit};

/// Names that no unit can have: a position in counts would be another.
const COUNTS: [&str; 2] = ["count", "counts"];

/// A `[[motor]]` table of the configuration.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotorTable {
    number: i64,
    name: Option<String>,
    unit: Option<String>,
    counts_per_unit: Option<f64>,
}

/// A motor with a name, or a unit, or both.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotorNames {
    /// The motor's number, from 1.
    number: usize,
    name: Option<Text<NAME_BYTES>>,
    unit: Option<UserUnit>,
}

impl MotorNames {
    /// Puts name and unit where clients find them.
    pub fn tell(&self, identity: &mut Identity) {
        if let Some(name) = identity.names.get_mut(self.number - 1) {
            *name = self.name;
        }
        if let Some(unit) = identity.units.get_mut(self.number - 1) {
            *unit = self.unit;
        }
    }
}

/// The motors' settings, for a board of `family`.
///
/// # Errors
/// Names the motor that the family lacks or that the tables name twice, the invalid name or unit, or the incomplete
/// unit.
pub(super) fn decide(tables: &[MotorTable], family: &Family) -> Result<Vec<MotorNames>, Refusal> {
    let mut motors: Vec<MotorNames> = Vec::new();
    for (index, table) in tables.iter().enumerate() {
        let refuse = |key: &str, text: String| Refusal::of(format!("motor.{index}.{key}"), text);
        let found = one(table, family).map_err(|(key, text)| refuse(key, text))?;
        if motors.iter().any(|other| other.number == found.number) {
            return Err(refuse("number", format!("motor {} has a [[motor]] already", found.number)));
        }
        if let Some(name) = found.name.filter(|name| motors.iter().any(|other| other.name == Some(*name))) {
            return Err(refuse("name", format!("another motor is called {:?} already", &name[..])));
        }
        motors.push(found);
    }
    Ok(motors)
}

fn one(table: &MotorTable, family: &Family) -> Result<MotorNames, (&'static str, String)> {
    let number = usize::try_from(table.number).ok().filter(|number| (1..=family.motors).contains(number));
    let number = number.ok_or_else(|| {
        ("number", format!("there is no motor {}; write 1 to {}", table.number, family.motors))
    })?;
    let name = table.name.as_deref().map(name).transpose().map_err(|text| ("name", text))?;
    let unit = match (table.unit.as_deref(), table.counts_per_unit) {
        (Some(unit), Some(counts_per_unit)) => {
            if !counts_per_unit.is_normal() {
                let text = format!("counts_per_unit = {counts_per_unit}: write a number that is not 0");
                return Err(("counts_per_unit", text));
            }
            Some(UserUnit { name: self::unit(unit).map_err(|text| ("unit", text))?, counts_per_unit })
        }
        (None, None) => None,
        (Some(_), None) => return Err(("unit", "unit needs counts_per_unit beside it".to_owned())),
        (None, Some(_)) => {
            return Err(("counts_per_unit", "counts_per_unit needs unit beside it".to_owned()));
        }
    };
    if name.is_none() && unit.is_none() {
        return Err(("number", "neither name nor unit: leave this [[motor]] out".to_owned()));
    }
    Ok(MotorNames { number, name, unit })
}

/// A name can be typed, and is no number.
fn name(text: &str) -> Result<Text<NAME_BYTES>, String> {
    let begins = text.starts_with(|first: char| first.is_ascii_alphabetic());
    let typed = text.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"._-".contains(&byte));
    let name = Text::new(text.as_bytes()).filter(|_| begins && typed);
    name.ok_or_else(|| {
        format!("name = {text:?}: write 1 to {NAME_BYTES} letters, digits, `.`, `_` and `-`, a letter first")
    })
}

fn unit(text: &str) -> Result<Text<NAME_BYTES>, String> {
    let printed = !text.is_empty() && !text.contains(|c: char| is_hidden(c) || c.is_whitespace());
    if COUNTS.contains(&text) {
        return Err(format!(
            "unit = {text:?}: every motor has this one; write the unit of the machine, as deg or mm"
        ));
    }
    let unit = Text::new(text.as_bytes()).filter(|_| printed);
    unit.ok_or_else(|| format!("unit = {text:?}: write 1 to {NAME_BYTES} bytes without blanks, as deg or mm"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::PMAC;

    #[derive(Deserialize)]
    struct File {
        motor: Vec<MotorTable>,
    }

    fn decided(text: &str) -> Result<Vec<MotorNames>, (String, String)> {
        let File { motor } = toml::from_str(text).unwrap();
        decide(&motor, &PMAC).map_err(|refusal| (refusal.key.unwrap_or_default(), refusal.text))
    }

    #[test]
    fn names_and_units_reach_the_identity() {
        let text = "[[motor]]\nnumber = 2\nname = 'azimuth'\nunit = '°'\ncounts_per_unit = -12000\n\
                    [[motor]]\nnumber = 8\nname = 'focus'\n";
        let mut identity = Identity::default();
        decided(text).unwrap().iter().for_each(|motor| motor.tell(&mut identity));
        assert_eq!(identity.names[1].as_deref(), Some("azimuth"));
        assert_eq!(identity.units[1], Some(UserUnit { name: "°".into(), counts_per_unit: -12000.0 }));
        assert_eq!((identity.names[7].as_deref(), identity.units[7]), (Some("focus"), None));
        assert_eq!(identity.names[0], None);
    }

    #[test]
    fn what_cannot_be_is_refused_by_name() {
        let first = "[[motor]]\nnumber = 1\nname = 'x'\n";
        for (text, key, what) in [
            ("number = 9\nname = 'a'", "number", "there is no motor 9; write 1 to 8"),
            ("number = 0\nname = 'a'", "number", "there is no motor 0"),
            ("number = 1\nname = 'a'", "number", "motor 1 has a [[motor]] already"),
            ("number = 2\nname = 'x'", "name", "another motor is called \"x\" already"),
            ("number = 2\nname = '2'", "name", "a letter first"),
            ("number = 2\nname = 'a b'", "name", "write 1 to 16 letters"),
            ("number = 2\nname = 'seventeen-bytes-17'", "name", "write 1 to 16 letters"),
            ("number = 2\nunit = 'deg'", "unit", "needs counts_per_unit"),
            ("number = 2\ncounts_per_unit = 5", "counts_per_unit", "needs unit"),
            ("number = 2\nunit = 'deg'\ncounts_per_unit = 0", "counts_per_unit", "not 0"),
            ("number = 2\nunit = 'deg'\ncounts_per_unit = nan", "counts_per_unit", "not 0"),
            ("number = 2\nunit = 'a b'\ncounts_per_unit = 5", "unit", "without blanks"),
            ("number = 2\nunit = \"m\\u202Em\"\ncounts_per_unit = 5", "unit", "without blanks"),
            ("number = 2\nunit = 'counts'\ncounts_per_unit = 5", "unit", "every motor has this one"),
            ("number = 2", "number", "leave this [[motor]] out"),
        ] {
            let (found, why) = decided(&format!("{first}[[motor]]\n{text}\n")).unwrap_err();
            assert_eq!(found, format!("motor.1.{key}"), "{text}");
            assert!(why.contains(what), "{text}: {why}");
        }
    }
}
