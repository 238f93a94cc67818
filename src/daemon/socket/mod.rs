//! The command socket: who may connect, what a call means, whose turn it is, and what must not outlive its caller. One thread.

mod admission;
mod audit;
mod call_table;
mod clients;
mod command_ends;
mod connection;
mod fair_queue;
mod first_start;
pub mod jobs;
mod jog_to;
mod leases;
mod leftovers;
pub mod listener;
pub mod methods;
pub mod options;
mod panel_jogs;
mod peer_groups;
pub mod policy;
mod resets;
mod sent_stops;
mod sequences;
pub mod server;
pub mod stop_target;
mod stops;
mod time_quota;
mod tracing;
mod watches;
