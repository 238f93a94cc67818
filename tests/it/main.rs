//! Integration tests.

mod map;
