//! Integration tests: formats, the map, the segment, whole processes.

mod map;
mod segment_loom;
