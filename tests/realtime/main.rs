//! Tests in real time: races, processes that are stopped and killed, everything at once for long, hostile clients.
//!
//! They want the machine's processors for themselves, so one at a time, and not among the others:
//!
//! ```text
//! cargo test --locked --test realtime -- --test-threads=1
//! ```

#[path = "../support/mod.rs"]
mod support;

mod board_races;
mod board_words;
mod bystander;
mod campaign;
mod campaign_uses;
mod drawn_board;
mod gather;
mod held_jogs;
mod hostile;
mod hostile_users;
mod hostile_witness;
mod misbehaviour;
mod mixing;
mod pauses;
mod processes;
mod service_manager;
mod soak;
