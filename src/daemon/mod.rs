//! The daemon: owns the board, mirrors it, serves commands (layer 5).
//!
//! Two threads work, one writes the log and one waits for signals. The bus thread ([`bus::board_loop`]) owns the board; the socket's thread
//! ([`socket`]) owns the clients; between them stand two bounded queues ([`shared::queue`]).

pub mod bring_up;
pub mod bus;
pub mod config;
pub mod exit;
pub mod machine;
pub mod options;
pub mod parts;
pub mod service;
pub mod shared;
pub mod socket;

pub use bring_up::{main, main_with};
