//! Values that the bus thread and the socket's thread exchange, and types that both use.

pub mod caller;
pub mod definition_blocks;
pub mod function_use;
pub mod info;
pub mod job;
pub mod leases;
pub mod log_quota;
pub mod open_buffer;
pub mod origin;
pub mod parameters;
pub mod peer;
pub mod queue;
pub mod rotary_address;
pub mod status;
pub mod trouble;
pub mod writer;
