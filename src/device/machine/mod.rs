//! What the machine provides: kernel facts, devices, inherited descriptors, scheduling.

pub mod candidates;
pub mod cpu_latency;
pub mod descriptors;
pub mod facts;
pub mod inherited;
pub mod kernel;
pub mod node_owner;
pub mod probe;
pub mod recognise;
pub mod scheduling;
pub mod system;
