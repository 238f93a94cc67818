//! The daemon: owns the board, mirrors it, serves commands (layer 5).
//!
//! The bus thread ([`bus::board_loop`]) owns the board. The socket thread ([`socket`]) owns the clients. Two bounded
//! queues ([`shared::queue`]) join them. `scripts` holds the daemon's dialogues with the board, step by step, each for
//! one client; the socket thread drives them. A third thread writes the log. A fourth listens for interrupts while the
//! bus thread sleeps ([`bus::doorbell`]). The main thread waits for signals and keeps the segment's name.

mod ask_family;
pub mod bring_up;
pub mod bus;
pub mod config;
pub mod exit;
pub mod machine;
mod motion;
pub mod options;
pub mod parts;
pub mod recognise;
mod scripts;
pub mod service;
pub mod shared;
pub mod socket;

pub use bring_up::{main, main_with};
