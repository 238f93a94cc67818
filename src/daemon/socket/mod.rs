//! The command socket: who may connect, what a call means, whose turn it is, and what must not outlive its caller. One thread.

mod admission;
mod audit;
mod call_table;
mod clients;
mod connection;
mod fair_queue;
mod first_start;
pub mod jobs;
mod jog_to;
pub mod listener;
pub mod methods;
pub mod options;
mod peer_groups;
mod peer_process;
pub mod policy;
mod program_errors;
mod replay;
mod sequences;
pub mod server;
mod time_quota;
mod tracing;
mod watches;
