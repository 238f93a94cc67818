//! Commands that only read.

pub mod bits;
mod buffers;
pub mod coordinates;
pub mod decode;
pub mod demo;
mod elsewhere;
mod global_status;
pub mod map;
pub mod motors;
pub mod programs;
pub mod read;
pub mod screen;
mod stage;
pub mod status;
pub mod user;
pub mod watch;
