//! Commands that only read.

pub mod coordinates;
pub mod decode;
pub mod demo;
pub mod map;
pub mod motors;
pub mod read;
pub mod screen;
pub mod status;
pub mod watch;
