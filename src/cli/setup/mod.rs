//! `pmacctl setup` and `absolute`: the lines that set a board up, explained, and sent when told to.

pub mod absolute;
mod answer;
mod lines;
pub mod send;
