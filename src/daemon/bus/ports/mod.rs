//! The ports that carry lines and interrupts between the daemon and the board.

pub mod command_port;
pub mod fallback;
pub mod host_port;
pub mod interrupt;
pub mod mailbox;
