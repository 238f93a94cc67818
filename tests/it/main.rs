//! Integration tests.

mod bench;
mod map;
mod socket;
