//! Buses that wrap another bus.

pub mod counted;
pub mod swapped;
pub mod traced;
