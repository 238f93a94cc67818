//! Command files and settings: `download`, `backup`, `diff`, `restore`.

pub mod backup;
pub mod download;
mod mistakes;
pub mod preprocess;
pub mod sequence;
pub mod settings_file;
