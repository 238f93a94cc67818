//! The form of a table's file: `log`, `gather` and `tune` write it, `plot` reads it. [`super::csv`] writes a line of
//! the one form, [`super::npy`] an element of the other.

use std::path::Path;

/// The form of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileFormat {
    /// Comma-separated text.
    Csv,
    /// A NumPy array.
    Npy,
}

impl FileFormat {
    /// The form of the file `path`, by its ending; `-` is CSV on stdout.
    ///
    /// # Errors
    /// Another ending.
    pub fn of(path: &Path) -> Result<Self, String> {
        match path.extension().and_then(|extension| extension.to_str()) {
            _ if path == Path::new("-") => Ok(Self::Csv),
            Some("csv") => Ok(Self::Csv),
            Some("npy") => Ok(Self::Npy),
            _ => Err("the name must end in .csv or .npy; - is CSV on stdout".to_owned()),
        }
    }
}
