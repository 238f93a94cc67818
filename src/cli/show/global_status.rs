//! The board's global status, the two words of `???`.

use serde_json::{Value, json};

use crate::decode::{BackgroundData, Flags, ServoData};

/// The flags of the words, from the report that has them; `None` if neither report does.
pub fn flags(servo: Option<&ServoData>, background: Option<&BackgroundData>) -> Option<[Flags; 2]> {
    let flags = servo.and_then(ServoData::global_flags);
    flags.or_else(|| background.and_then(BackgroundData::global_flags))
}

/// The words and the names of their flags; null without them.
pub fn document(servo: Option<&ServoData>, background: Option<&BackgroundData>) -> Value {
    flags(servo, background).map_or(Value::Null, |flags| {
        let words = flags.map(|flags| format!("${:06X}", flags.word));
        json!({ "words": words, "flags": flags.iter().flat_map(Flags::names).collect::<Vec<_>>() })
    })
}

/// The content of [`document`] on a line; `None` for an empty document.
pub fn text(document: &Value) -> Option<String> {
    let join = |values: &Value| {
        let values = values.as_array()?.iter().filter_map(Value::as_str);
        Some(values.collect::<Vec<_>>().join(" "))
    };
    let flags = join(&document["flags"])?;
    let flags = if flags.is_empty() { "no flag is set" } else { &flags };
    Some(format!("{}: {flags}", join(&document["words"])?))
}
