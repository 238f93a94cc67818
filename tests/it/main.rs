//! Integration tests: formats, the map, the segment, the socket, whole processes.

mod decode;
mod format;
mod map;
mod segment_loom;
mod socket;
