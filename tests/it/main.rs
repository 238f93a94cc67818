//! Integration tests: formats, the map, the segment, the socket, whole processes.

mod map;
mod segment_loom;
mod socket;
