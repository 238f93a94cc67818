//! Integration tests.

mod bench;
mod socket;
