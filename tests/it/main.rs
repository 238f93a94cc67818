//! Integration tests.

mod bench;
mod cli;
mod map;
mod rig;
mod socket;
