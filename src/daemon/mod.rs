//! The daemon: owns the board, mirrors it, serves commands (layer 5).

pub mod ascii_desk;
mod connection;
mod dispatch;
pub mod identify;
pub mod info;
pub mod listener;
pub mod policy;
pub mod queue;
pub mod serve;
