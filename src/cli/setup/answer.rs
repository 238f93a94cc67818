//! The answer of a command that needs no daemon, before printing.

use serde::Serialize;
use serde_json::Value;

/// An answer as JSON and as text.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    /// The JSON document for `--json`.
    pub document: Value,
    /// The text. It ends with a newline.
    pub text: String,
    /// The exit status: 0 done, 1 the answer is "no".
    pub status: u8,
}

impl Answer {
    /// An answer with exit status 0.
    ///
    /// # Errors
    /// The document cannot be written as JSON.
    pub fn done(document: &impl Serialize, text: String) -> Result<Self, String> {
        let document = serde_json::to_value(document).map_err(|error| error.to_string())?;
        Ok(Self { document, text, status: 0 })
    }
}
