//! Integration tests: formats, the map, the segment, the socket, the command line, the simulator, whole systems.
//!
//! None of them depends on how fast the machine is. What does lies in `tests/realtime`.

#[path = "../support/mod.rs"]
mod support;

mod architecture;
mod backup;
mod cli;
mod client;
mod decode;
mod decode_turbo;
mod dependencies;
mod dirty;
mod doctor;
mod download;
mod family;
mod fields;
mod format;
mod fuzz_corpus;
mod gather;
mod gather_owner;
mod gather_program;
mod host_port;
mod inherited;
mod jog;
mod late;
mod log;
mod mailbox;
mod man;
mod map;
mod memory;
mod motors;
mod one_board;
mod open_buffer;
mod panel;
mod pauses;
mod processes;
mod program_words;
mod readings;
mod readings_functions;
mod readme;
mod replies;
mod rotary;
mod rotary_end;
mod rotary_stream;
mod segment;
mod segment_hostile;
mod segment_life;
mod segment_loom;
mod segment_page;
mod sequences;
mod serial;
mod service;
mod simulator;
mod socket;
mod socket_jobs;
mod stops;
mod tools;
mod tools_serial;
mod tools_terminal;
mod turbo;
mod turbo_rotary;
mod two_hosts;
mod uncertain;
mod variables;
mod whole;
