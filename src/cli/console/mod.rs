//! What commands print with: the terminal, tables, output files and signals.

pub mod confirm;
pub mod interrupt;
pub mod keys;
pub mod late;
pub mod note;
pub mod output;
pub mod progress;
pub mod sink;
pub mod table;
pub mod table_file;
pub mod time;
