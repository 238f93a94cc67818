//! What the daemon is told: the configuration file, its checks, and what follows from it for a board.

pub mod board_settings;
mod checks;
pub mod mirrored;
pub mod ports;
pub mod settings;
pub mod span;
