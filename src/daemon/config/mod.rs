//! The daemon's configuration: the file, its checks, and the settings for a board.

pub mod board_settings;
mod checks;
pub mod family;
pub mod mirrored;
pub mod motors;
pub mod ports;
mod replay;
pub mod settings;
pub mod span;
pub mod user;
