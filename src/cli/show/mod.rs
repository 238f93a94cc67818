//! Commands that only read.

pub mod coordinates;
pub mod decode;
pub mod demo;
pub mod map;
mod motor;
pub mod motors;
pub mod read;
pub mod screen;
pub mod status;
pub mod watch;
