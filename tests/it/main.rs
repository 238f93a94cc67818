//! Integration tests.

mod segment_loom;
