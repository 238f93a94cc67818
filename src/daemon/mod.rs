//! The daemon: owns the board, mirrors it, serves commands (layer 5).

mod connection;
mod dispatch;
pub mod info;
pub mod listener;
pub mod policy;
pub mod queue;
pub mod serve;
