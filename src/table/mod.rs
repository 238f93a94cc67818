//! Tables of numbers in files (layer 1): named fields with units, and rows.
//!
//! | file | content |
//! |---|---|
//! | `file_format` | a file's form, by its name |
//! | `csv` | a line of text |
//! | `npy` | an element of a NumPy array |
//! | `read` | reads both |

pub mod csv;
pub mod file_format;
pub mod npy;
pub mod read;

use serde::Serialize;

pub use csv::CsvWriter;
pub use file_format::FileFormat;
pub use npy::NpyWriter;
pub use read::{ReadError, Table};

/// How to write the numbers of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FieldKind {
    /// Whole, at most 2^53.
    Integer,
    /// A time in seconds, in text to the nanosecond.
    Seconds,
    /// Any number: in text, the shortest that reads back as the same f64.
    Real,
}

/// One field of every row.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Field {
    /// Its name; no other field has it.
    pub name: String,
    /// The unit; empty if none is known.
    pub unit: String,
    /// How to write its numbers.
    pub kind: FieldKind,
}

impl Field {
    /// A field.
    #[must_use]
    pub fn new(name: impl Into<String>, unit: impl Into<String>, kind: FieldKind) -> Self {
        Self { name: name.into(), unit: unit.into(), kind }
    }

    /// Name and unit, for a table's head.
    #[must_use]
    pub fn title(&self) -> String {
        if self.unit.is_empty() { self.name.clone() } else { format!("{} [{}]", self.name, self.unit) }
    }

    /// Name and unit of a [`Field::title`].
    #[must_use]
    pub fn parts(title: &str) -> (&str, &str) {
        title.strip_suffix(']').and_then(|title| title.split_once(" [")).unwrap_or((title, ""))
    }
}
