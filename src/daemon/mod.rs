//! The daemon: owns the board, mirrors it, serves commands (layer 5).
//!
//! Two threads work, one writes the log and one waits for signals. The bus thread ([`board_loop`]) owns the board; the socket's thread
//! ([`serve`]) owns the clients; between them stand two bounded queues ([`queue`]).

mod admission;
pub mod ascii_desk;
pub mod board;
pub mod board_loop;
pub mod bring_up;
mod calls;
mod connection;
mod desk_ways;
pub mod dispatch;
pub mod exit;
pub mod host_link;
pub mod identify;
pub mod info;
pub mod interrupt_link;
pub mod job;
pub mod job_desk;
pub mod jobs;
mod journal;
mod lease;
pub mod listener;
mod log_sink;
pub mod machine;
pub mod mailbox_link;
mod notify;
pub mod options;
pub mod panel_desk;
pub mod parts;
mod phase;
pub mod policy;
mod port_watch;
pub mod ports;
mod presence;
pub mod privilege;
pub mod queue;
mod refusals;
mod resets;
pub mod response_port;
pub mod room;
pub mod rotary_desk;
pub mod rounds;
pub mod serve;
pub mod settings;
mod settings_checks;
pub mod settings_place;
mod shares;
pub mod simulator;
pub mod status;
mod subscriptions;
mod telling;
mod turns;
pub mod uncertain;
mod watch;
pub mod write_desk;

pub use bring_up::{main, main_with};
