//! The command socket: checks who connects, reads calls, gives each client its turn, and ends all that must not outlive
//! its caller. One thread.
//!
//! | place | what is in it |
//! |---|---|
//! | [`server`] | the thread, round after round; the further steps of calls, stops, starts, jogs and sequences |
//! | [`listener`], [`options`] | the socket's file, and the server's options |
//! | `admission`, `clients`, `connection` | which connection gets a place; every connection; one connection, its messages and buffers |
//! | [`policy`], `peer_groups`, `peer_process` | a peer's rights: its role, its groups, whether its process lives |
//! | [`methods`], [`jobs`], `order`, `replay` | the meaning of each call, checked before the bus thread gets it; the calls that a replay refuses |
//! | `call_table`, `call_step`, `heard` | calls that wait for the board; the step of each; the outcome of a command |
//! | `fair_queue`, `time_quota` | which client's command is next; which user the server serves next |
//! | `sequences` | lines and jobs that belong together, each owned by a connection |
//! | `first_start` | the questions to the board before a start |
//! | `watches`, `tracing` | the registers that clients watch; the client that gets the trace of bus accesses |
//! | `audit`, `program_errors`, `notes` | the entries of the log, and how often they come; the notes of clients |
//!
//! `daemon/motion` keeps which motors move, for which client, and the step of each stop; [`server`] drives the stops.
//! `daemon/scripts` holds the daemon's dialogues with the board, step by step.

mod admission;
mod audit;
mod call_step;
mod call_table;
mod clients;
mod connection;
mod fair_queue;
mod first_start;
mod heard;
pub mod jobs;
pub mod listener;
pub mod methods;
mod notes;
pub mod options;
mod order;
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
