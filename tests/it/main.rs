//! Integration tests.

mod decode;
mod map;
