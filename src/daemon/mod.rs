//! The daemon: owns the board, mirrors it, serves commands (layer 5).

pub mod queue;
