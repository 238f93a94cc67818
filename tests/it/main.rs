//! Integration tests: formats, the map, the segment, whole processes.

mod decode;
mod format;
mod map;
mod segment_loom;
