//! The daemon among the system's services: rights, signals, the journal, the service manager, a simulator of its own.

pub(super) mod journal;
pub(super) mod log_sink;
mod notify;
pub mod privilege;
pub mod simulator;
pub(super) mod socket_directory;
pub(super) mod supervisor;
