//! What the fuzzer calls with bytes of its own, and `tests/it/fuzz_corpus.rs` with those that were kept: one function a
//! target, `body`. Each uses a part of the driver as a hostile neighbour would, and asserts more than that nothing panics.

pub mod board;
mod bus;
pub mod client;
pub mod config;
pub mod daemon;
pub mod files;
pub mod replies;
pub mod rotary;
pub mod segment;
pub mod service;
pub mod sim;
pub mod socket;
pub mod sysfs;
mod tape;
