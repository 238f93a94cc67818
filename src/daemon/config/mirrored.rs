//! `[servo]` and `[background]`: the motors and fields of a report to read.

use serde::Deserialize;

use super::span::Refusal;
use crate::map::{Family, block_fields};
use crate::protocol::{BackgroundSettings, ServoSettings};

/// `[servo]` as written.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ServoTable {
    motors: Option<Vec<i64>>,
    fields: Option<Vec<String>>,
    spare_words: Option<bool>,
}

impl ServoTable {
    /// The selection, for a board of `family`.
    ///
    /// # Errors
    /// The motor or field that the family has not.
    pub(super) fn decide(self, family: &Family) -> Result<ServoSettings, Refusal> {
        let all = ServoSettings::all(family);
        Ok(ServoSettings {
            motors: self
                .motors
                .map_or(Ok(all.motors), |motors| numbers("servo", &motors, family.servo.motors.count))?,
            fields: self.fields.map_or(Ok(all.fields), |names| fields("servo", &names, family))?,
            spare_words: self.spare_words.unwrap_or(all.spare_words),
        })
    }
}

/// `[background]` as written.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BackgroundTable {
    motors: Option<Vec<i64>>,
    fields: Option<Vec<String>>,
}

impl BackgroundTable {
    /// The selection, for a board of `family`.
    ///
    /// # Errors
    /// The motor or field that the family has not.
    pub(super) fn decide(self, family: &Family) -> Result<BackgroundSettings, Refusal> {
        let all = BackgroundSettings::all(family);
        Ok(BackgroundSettings {
            motors: self.motors.map_or(Ok(all.motors), |motors| {
                numbers("background", &motors, family.background.blocks.count)
            })?,
            fields: self.fields.map_or(Ok(all.fields), |names| fields("background", &names, family))?,
        })
    }
}

fn numbers(table: &str, written: &[i64], count: usize) -> Result<Vec<u32>, Refusal> {
    let check = |(index, number): (usize, &i64)| {
        let found = u32::try_from(*number).ok().filter(|number| (1..=count).contains(&(*number as usize)));
        found.ok_or_else(|| {
            let text = format!("there is no motor {number}; write 1 to {count}");
            Refusal::of(format!("{table}.motors.{index}"), text)
        })
    };
    written.iter().enumerate().map(check).collect()
}

/// The names in the register table, without the prefix: `motor_actual_position` is `actual_position`.
fn fields(table: &str, written: &[String], family: &Family) -> Result<Vec<String>, Refusal> {
    let check = |(index, text): (usize, &String)| {
        let found = block_fields(family, table).find(|field| field.is_called(text));
        found.map(|field| field.name.to_owned()).ok_or_else(|| {
            let names: Vec<_> = block_fields(family, table).map(|field| field.name).collect();
            let text = format!("there is no {table} field `{text}`; there are {}", names.join(", "));
            Refusal::of(format!("{table}.fields.{index}"), text)
        })
    };
    written.iter().enumerate().map(check).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::{FAMILIES, PMAC, Selection};

    fn words(selection: Selection, block: usize) -> usize {
        let mut runs = Vec::new();
        selection.runs(block, 8, &mut runs);
        runs.iter().map(ExactSizeIterator::len).sum()
    }

    fn servo(text: &str) -> Result<ServoSettings, Refusal> {
        toml::from_str::<ServoTable>(text).unwrap().decide(&PMAC)
    }

    #[test]
    fn all_is_read_unless_something_is_left_out() {
        let read = |text| words(servo(text).unwrap().selection(&PMAC), PMAC.servo.motors.words);
        assert_eq!(read(""), 240);
        assert_eq!(read("spare_words = false"), 8 * 26);
        assert_eq!(read("motors = [3, 1]"), 60);
        assert_eq!(read("motors = [1, 1]\nfields = ['actual_position', 'motor_servo_status']"), 6);
        assert_eq!(read("fields = ['spare']\nspare_words = false"), 0);
        let background = |text: &str| {
            let decided = toml::from_str::<BackgroundTable>(text).unwrap().decide(&PMAC).unwrap();
            words(decided.selection(&PMAC), PMAC.background.blocks.words)
        };
        assert_eq!(background(""), 8 * 62);
        assert_eq!(background("motors = [2]\nfields = ['cs_program_status', 'x_target_position']"), 6);
    }

    #[test]
    fn what_the_family_has_not_is_refused_by_name() {
        for (text, key, reason) in [
            ("motors = [1, 9]", "servo.motors.1", "there is no motor 9; write 1 to 8"),
            ("motors = [0]", "servo.motors.0", "there is no motor 0"),
            ("motors = [-1]", "servo.motors.0", "there is no motor -1"),
            (
                "fields = ['following_error']",
                "servo.fields.0",
                "there is no servo field `following_error`; there are commanded_position, ",
            ),
        ] {
            let refusal = servo(text).unwrap_err();
            assert!(refusal.text.contains(reason), "{text}: {refusal:?}");
            assert_eq!(refusal.key.as_deref(), Some(key));
        }
        assert!(toml::from_str::<ServoTable>("spares = false").is_err());
        let spare: BackgroundTable = toml::from_str("fields = ['spare']").unwrap();
        assert!(spare.decide(&PMAC).is_err());
    }

    #[test]
    fn an_empty_table_reads_all_of_every_family() {
        for family in FAMILIES {
            let decided = ServoTable::default().decide(family).unwrap();
            assert_eq!(decided, ServoSettings::all(family));
            assert_eq!(decided.motors.len(), family.servo.motors.count);
        }
    }
}
