//! Integration tests.

mod decode;
mod format;
mod map;
