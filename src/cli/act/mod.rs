//! Commands that make the board do one thing.

mod address;
mod control_keys;
pub mod drive;
pub mod hold;
pub mod jog;
pub mod lines;
pub mod panel;
mod piped;
pub mod registers;
pub mod reset_watch;
pub mod send;
pub mod set_position;
pub mod stop;
pub mod terminal;
pub mod wait;
pub mod watch_values;
pub mod write;
