//! The command socket: who may connect, what a call means, whose turn it is, and what must not outlive its caller. One thread.

mod audit;
mod connection;
mod fair_queue;
pub mod jobs;
mod leases;
pub mod listener;
pub mod methods;
pub mod policy;
pub mod server;
mod time_quota;
mod watches;
