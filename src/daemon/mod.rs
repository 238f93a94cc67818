//! The daemon: owns the board, mirrors it, serves commands (layer 5).

pub mod ascii_desk;
pub mod identify;
pub mod queue;
