//! The site's own words, as a table, a line or JSON.

use serde_json::{Value as Json, json};

use crate::cli::console::Table;
use crate::cli::show::motors::stamp;
use crate::cli::show::screen::{Live, state, update};
use crate::client::number::{float32, short};
use crate::client::{Snapshot, Staleness, UserValues, identity};
use crate::decode::Value;
use crate::map::{DEFAULT_FAMILY, Family, Space};

/// Stands for values that the board was writing at each read of the daemon.
const NOT_WHOLE: &str = "not whole";

/// The words to show.
pub struct Words<'a>(pub &'a Snapshot);

impl Words<'_> {
    fn all(&self) -> &[UserValues] {
        self.0.user.as_ref().map_or(&[], |view| &view.data.words)
    }

    fn family(&self) -> &'static Family {
        identity::family(&self.0.identity).unwrap_or(DEFAULT_FAMILY)
    }
}

impl Live for Words<'_> {
    fn update(&self) -> (u64, bool) {
        update(self.0.user.as_ref())
    }

    fn document(&self) -> Json {
        let family = self.family();
        let words: Vec<Json> = self.all().iter().map(|values| values.document(family)).collect();
        json!({ "user": stamp(self.0.user.as_ref(), self.0.stale), "words": words })
    }

    fn text(&self, width: Option<usize>, why: &mut dyn FnMut(Staleness) -> String) -> String {
        let Some(view) = &self.0.user else {
            return format!(
                "STALE: there are no words yet: {}\n",
                why(self.0.stale.unwrap_or(Staleness::Off))
            );
        };
        let note = view.stale.map_or_else(String::new, |stale| format!("STALE: {}\n", why(stale)));
        let mut table = Table::new("name|>value|unit|address");
        for values in self.all() {
            let word = &values.word;
            let address = word.location.pmac_address(self.family()).to_string();
            let bits = word.bits.map_or_else(String::new, |bits| format!(",{},{}", bits.offset, bits.width));
            table.row([word.name.to_string(), text(values), word.unit.to_string(), address + &bits]);
        }
        note + &match width {
            Some(width) => table.fitting(width, &["address"]),
            None => table.to_string(),
        }
    }

    fn line(&self) -> String {
        let words = self.all().iter().map(|values| {
            let value = text(values).replace(' ', if values.values.is_some() { "," } else { "_" });
            format!(" {}={value}", &values.word.name[..])
        });
        state(self.0.user.as_ref(), self.0.stale) + &words.collect::<String>()
    }
}

/// The values, separated by blanks.
pub fn text(UserValues { word, values }: &UserValues) -> String {
    let one = |value: &Value| match *value {
        Value::Float(value) if word.location.space == Space::F => float32(value),
        Value::Float(value) => short(value),
        Value::Fixed(value) => value.to_string(),
        Value::Long(value) => value.to_string(),
        Value::Word(value) => value.to_string(),
    };
    let Some(values) = values else { return NOT_WHOLE.to_owned() };
    values.iter().map(one).collect::<Vec<_>>().join(" ")
}
