//! A refused setting, and its place in the configuration file.

use std::fmt::Display;
use std::path::Path;

use toml::de::{DeTable, DeValue};

/// A refused setting.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refusal {
    /// The full key, such as `mailbox.page`, or `roles.operate.0` in a list. `None` if no single key is wrong, or if
    /// the setting is not from the file.
    pub key: Option<String>,
    /// The fault, and the cure.
    pub text: String,
    /// The setting stands on the command line.
    pub typed: bool,
}

impl Refusal {
    /// Refuses the setting `key`.
    pub fn of(key: impl Into<String>, text: impl Display) -> Self {
        Self { key: Some(key.into()), text: text.to_string(), typed: false }
    }

    /// A refusal without a place in the file.
    pub fn anywhere(text: impl Display) -> Self {
        Self { key: None, text: text.to_string(), typed: false }
    }

    /// Something on the command line is wrong.
    pub fn typed(text: impl Display) -> Self {
        Self { key: None, text: text.to_string(), typed: true }
    }

    /// The message, with the file, line and column of the key. `text` is the content of the file at `path`.
    #[must_use]
    pub fn placed(&self, path: &Path, text: &str) -> String {
        let place = self.key.as_deref().and_then(|key| offset(text, key));
        let place = place.map(|offset| position(text, offset));
        match place {
            Some((line, column)) => format!("{}:{line}:{column}: {}", path.display(), self.text),
            None => self.text.clone(),
        }
    }
}

/// The offset of the value of `key`, or of the innermost table that the file has.
fn offset(text: &str, key: &str) -> Option<usize> {
    let table = DeTable::parse(text).ok()?;
    let mut parts = key.split('.');
    let mut found = table.get_ref().get(parts.next()?)?;
    for part in parts {
        let value: &DeValue = found.get_ref();
        let inner = match part.parse::<usize>() {
            Ok(index) => value.get(index),
            Err(_) => value.get(part),
        };
        match inner {
            Some(inner) => found = inner,
            None => break,
        }
    }
    Some(found.span().start)
}

/// The line and column of the byte at `offset`, from 1.
#[must_use]
pub fn position(text: &str, offset: usize) -> (usize, usize) {
    let before = text.get(..offset).unwrap_or(text);
    let line = before.matches('\n').count() + 1;
    let column = before.rsplit('\n').next().map_or(0, |last| last.chars().count()) + 1;
    (line, column)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_is_found_as_far_down_as_it_is_there() {
        let text = "a = 1\n[b]\nc = [\n  'x',\n  'ÿ', 'z']\n\"d\" = 2\nf.g = 3\n";
        let place = |key: &str| offset(text, key).map(|offset| position(text, offset));
        assert_eq!(place("a"), Some((1, 5)));
        assert_eq!(place("b"), Some((2, 1)));
        assert_eq!(place("b.c"), Some((3, 5)));
        assert_eq!(place("b.c.0"), Some((4, 3)));
        assert_eq!(place("b.c.2"), Some((5, 8)));
        assert_eq!(place("b.d"), Some((6, 7)));
        assert_eq!(place("b.f.g"), Some((7, 7)));
        assert_eq!(place("b.missing"), Some((2, 1)), "its table");
        assert_eq!(place("e"), None);
        let refusal = Refusal::of("b.d", "is too much");
        assert_eq!(refusal.placed(Path::new("F"), text), "F:6:7: is too much");
        assert_eq!(Refusal::of("e", "is missing").placed(Path::new("F"), text), "is missing");
    }
}
