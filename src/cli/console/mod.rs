//! The terminal, tables, output files and signals: what commands print with.

pub mod confirm;
pub mod interrupt;
pub mod keys;
pub mod output;
pub mod sink;
pub mod table;
pub mod time;
