//! The daemon: owns the board, mirrors it, serves commands (layer 5).
//!
//! Two threads work, one writes the log and one waits for signals. The bus thread ([`board_loop`]) owns the board; the socket's thread
//! ([`socket`]) owns the clients; between them stand two bounded queues ([`shared::queue`]).

pub mod ascii_desk;
pub mod board;
pub mod board_function;
pub mod board_loop;
pub mod bring_up;
pub mod command_lines;
pub mod config;
mod desk_ways;
pub mod exit;
pub mod functions;
pub mod host_link;
pub mod identify;
pub mod interrupt_link;
pub mod machine;
pub mod mailbox_link;
mod mirrored;
pub mod options;
pub mod panel_desk;
pub mod parts;
mod phase;
mod port_watch;
mod presence;
mod resets;
pub mod response_port;
pub mod room;
pub mod rotary_desk;
pub mod service;
pub mod shared;
pub mod socket;
mod telling;
mod variables;
pub mod write_desk;

pub use bring_up::{main, main_with};
