//! Integration tests: formats, the map, the segment, the socket, the command line, the simulator, whole processes.

mod architecture;
mod bench;
mod cli;
mod client;
mod decode;
mod format;
mod map;
mod mixing;
mod readme;
mod replies;
mod rig;
mod rotary;
mod segment;
mod segment_cost;
mod segment_hostile;
mod segment_life;
mod segment_loom;
mod serial;
mod simulator;
mod site;
mod socket;
mod whole;
