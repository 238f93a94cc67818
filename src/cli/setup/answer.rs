//! The answer of a calculator, before printing.

use serde::Serialize;
use serde_json::Value;

/// An answer as JSON and as text.
#[derive(Debug, Clone, PartialEq)]
pub struct Explanation {
    /// The JSON document for `--json`.
    pub document: Value,
    /// The text. It ends with a newline.
    pub text: String,
    /// The lines to send, in order.
    pub commands: Vec<String>,
}

impl Explanation {
    /// An answer without lines to send.
    ///
    /// # Errors
    /// The document cannot be written as JSON.
    pub fn of(document: &impl Serialize, text: String) -> Result<Self, String> {
        let document = serde_json::to_value(document).map_err(|error| error.to_string())?;
        Ok(Self { document, text, commands: Vec::new() })
    }

    /// The same answer, with lines to send.
    pub fn with(self, commands: Vec<String>) -> Self {
        Self { commands, ..self }
    }
}
