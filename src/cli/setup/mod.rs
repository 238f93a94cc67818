//! `pmacctl setup` and `absolute`: explains the lines that set up a board, and sends them on request; and sets a VME
//! bridge's window.

pub mod absolute;
mod answer;
mod lines;
pub mod pointers;
pub mod send;
mod user;
mod window;
