//! Integration tests: formats, the map, the segment, the command socket, the command line, whole processes.

mod bench;
mod cli;
mod decode;
mod format;
mod map;
mod rig;
mod segment_loom;
mod socket;
