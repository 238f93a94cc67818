//! The bus thread's work for clients, a file for each function.

pub mod ascii;
pub mod command_lines;
pub mod kill;
pub(in crate::daemon) mod mirrored;
pub mod open_loops;
pub mod open_words;
pub mod panel;
pub mod rotary;
pub(in crate::daemon) mod variables;
pub mod write;
