//! Reads a call's parameters into a typed structure. An error names the parameter and the values that it takes.

use std::fmt;

use serde::de::value::StrDeserializer;
use serde::de::{
    self, DeserializeOwned, DeserializeSeed, Deserializer, IntoDeserializer, MapAccess, Visitor,
};
use serde_json::{Map, Value, map};

use super::{Call, CallError};

/// Reads the parameters of `call`.
///
/// # Errors
/// [`CallError::InvalidParameter`] for a parameter that is missing, of another type, out of its range, or unknown.
pub fn parameters<T: DeserializeOwned>(call: &Call) -> Result<T, CallError> {
    let parameters = call.parameters.clone().unwrap_or_default();
    let fields = Fields { left: parameters.into_iter(), next: None };
    T::deserialize(fields).map_err(|Wrong { parameter, what }| CallError::InvalidParameter {
        parameter: parameter.unwrap_or_else(|| "parameters".to_owned()),
        expected: what,
    })
}

/// The fields of an object, one after the other.
struct Fields {
    left: map::IntoIter,
    /// The value whose name the deserializer has read.
    next: Option<(String, Value)>,
}

/// The wrong parameter, if one is at fault, and the reason.
#[derive(Debug)]
struct Wrong {
    parameter: Option<String>,
    what: String,
}

impl fmt::Display for Wrong {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.what)
    }
}

impl std::error::Error for Wrong {}

impl de::Error for Wrong {
    fn custom<T: fmt::Display>(what: T) -> Self {
        Self { parameter: None, what: what.to_string() }
    }

    fn missing_field(name: &'static str) -> Self {
        Self { parameter: Some(name.to_owned()), what: "it is missing".to_owned() }
    }

    fn unknown_field(name: &str, expected: &'static [&'static str]) -> Self {
        let known = if expected.is_empty() { "none".to_owned() } else { expected.join(", ") };
        Self { parameter: Some(name.to_owned()), what: format!("the method takes {known}") }
    }
}

impl<'de> Deserializer<'de> for Fields {
    type Error = Wrong;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Wrong> {
        visitor.visit_map(self)
    }

    serde::forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf option unit unit_struct
        newtype_struct seq tuple tuple_struct map struct enum identifier ignored_any
    }
}

impl<'de> MapAccess<'de> for Fields {
    type Error = Wrong;

    fn next_key_seed<K: DeserializeSeed<'de>>(&mut self, seed: K) -> Result<Option<K::Value>, Wrong> {
        self.next = self.left.next();
        let Some((name, _)) = &self.next else { return Ok(None) };
        let name: StrDeserializer<'_, Wrong> = name.as_str().into_deserializer();
        seed.deserialize(name).map(Some)
    }

    fn next_value_seed<V: DeserializeSeed<'de>>(&mut self, seed: V) -> Result<V::Value, Wrong> {
        let Some((name, value)) = self.next.take() else { return Err(de::Error::custom("no value")) };
        seed.deserialize(value)
            .map_err(|error: serde_json::Error| Wrong { parameter: Some(name), what: in_words(&error) })
    }
}

/// The error in the interface's words: its numbers have ranges, not Rust types.
fn in_words(error: &serde_json::Error) -> String {
    let mut text = error.to_string();
    for (of_ours, words) in [
        ("expected u8", "expected a whole number from 0 to 255"),
        ("expected u16", "expected a whole number from 0 to 65535"),
        ("expected u32", "expected a whole number from 0 to 4294967295"),
        ("expected u64", "expected a whole number, not negative"),
        ("expected usize", "expected a whole number, not negative"),
        ("expected f64", "expected a number"),
        ("expected a sequence", "expected a list"),
    ] {
        text = text.replace(of_ours, words);
    }
    text
}

/// A call's parameters as the client sends them.
#[must_use]
pub fn to_map<T: serde::Serialize>(parameters: &T) -> Map<String, Value> {
    // Our parameters are structures of numbers, texts and lists, which always serialise as objects.
    match serde_json::to_value(parameters) {
        Ok(Value::Object(map)) => map,
        _ => Map::new(),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::protocol::calls::{NoParameters, Panel, Read, Rotary, Send, Write};

    fn wrong<T: DeserializeOwned + fmt::Debug>(parameters: Value) -> (String, String) {
        let call: Call = serde_json::from_value(json!({"method": "a.B", "parameters": parameters})).unwrap();
        match super::parameters::<T>(&call) {
            Err(CallError::InvalidParameter { parameter, expected }) => (parameter, expected),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn what_is_wrong_is_named_with_what_it_takes() {
        for (found, parameter, expected) in [
            (wrong::<Send>(json!({"line": 1})), "line", "expected a string"),
            (wrong::<Send>(json!({"line": "?", "timeout_ms": 0})), "timeout_ms", "1 to 600000"),
            (wrong::<Send>(json!({"line": "?", "timeout_ms": "1"})), "timeout_ms", "expected"),
            (wrong::<Send>(json!({"line": "?", "extra": 1})), "extra", "line, timeout_ms, question"),
            (wrong::<Read>(json!({"host_offset": 0})), "words", "missing"),
            (wrong::<Read>(json!({"host_offset": 0, "words": 1.5})), "words", "expected"),
            (wrong::<Read>(json!({"host_offset": 0, "words": -1})), "words", "expected"),
            (wrong::<Read>(json!({"host_offset": 1, "words": 1})), "host_offset", "even"),
            (
                wrong::<Read>(json!({"host_offset": 0, "words": 2f64.powi(70)})),
                "words",
                "a whole number, not",
            ),
            (wrong::<Write>(json!({"host_offset": 0, "words": [70000]})), "words", "from 0 to 65535"),
            (wrong::<Rotary>(json!({"buffer": 256})), "buffer", "from 0 to 255"),
            (wrong::<Read>(json!({"host_offset": -2, "words": 1})), "host_offset", "from 0 to 4294967295"),
            (wrong::<Panel>(json!({"action": "home", "numbers": 1})), "numbers", "a list"),
            (wrong::<NoParameters>(json!({"more": 1})), "more", "takes none"),
        ] {
            assert_eq!(found.0, parameter);
            assert!(found.1.contains(expected), "{found:?}");
            assert!(
                !["usize", "u8", "u16", "u32", "u64"].iter().any(|ours| found.1.contains(ours)),
                "{found:?}"
            );
        }
        let call: Call = serde_json::from_value(json!({"method": "a.B", "parameters": null})).unwrap();
        assert!(super::parameters::<NoParameters>(&call).is_ok());
    }
}
