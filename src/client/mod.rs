//! The thing a user holds (layer 5).

pub mod command;
