//! Integration tests: formats, the map, the segment, the socket, whole processes.

mod bench;
mod decode;
mod format;
mod map;
mod segment;
mod segment_cost;
mod segment_hostile;
mod segment_life;
mod segment_loom;
mod socket;
