//! The daemon as a system service: rights, signals, the journal, the service manager, its own simulator.

pub(super) mod journal;
mod notify;
pub mod privilege;
pub mod simulator;
pub(super) mod socket_directory;
pub(super) mod state_file;
pub(super) mod supervisor;
