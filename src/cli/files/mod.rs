//! Command files and settings: `download`, `backup`, `diff`, `restore`.

pub mod backup;
mod check;
mod differences;
pub mod download;
mod listings;
mod meaning;
mod mistakes;
mod prologue;
mod prose;
pub mod saved;
pub mod sequence;
pub mod settings_file;
mod stations;
