//! Buses around a bus.

pub mod counted;
pub mod swapped;
