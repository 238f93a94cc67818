//! The command socket: who may connect, what a call means, whose turn it is, and what must not outlive its caller. One thread.
//!
//! | place | what is in it |
//! |---|---|
//! | [`server`] | the thread: one round after the other; how calls, stops, starts, jogs and sequences go on |
//! | [`listener`], [`options`] | the socket's file, and what the server is told at its start |
//! | `admission`, `clients`, `connection` | who gets a place; every connection; one connection, its messages and its buffers |
//! | [`policy`], `peer_groups`, `peer_process` | who may do what: roles, the groups of a peer, whether its process lives |
//! | [`methods`], [`jobs`], `jog_to`, `replay` | what a call means, checked before anything reaches the bus thread; what a replay refuses |
//! | `call_table`, `call_step`, `heard` | calls that wait for the board; how far each is; what became of a command |
//! | `fair_queue`, `time_quota` | whose command is next; whose turn it is to be served |
//! | `sequences` | lines and jobs that belong together, each owned by a connection |
//! | `first_start` | what the board is asked before a start |
//! | `watches`, `tracing` | the registers that clients watch; who gets the trace of bus accesses |
//! | `audit`, `program_errors` | what the log is told, and how often |
//!
//! What moves, for whom, and how far its stop is stands in `daemon/motion`; [`server`] drives the stops. What the daemon says to the
//! board step by step stands in `daemon/scripts`.

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
