//! The ways by which lines and interrupts come and go.

pub mod command_port;
pub mod fallback;
pub mod host_port;
pub mod interrupt;
pub mod mailbox;
