//! The host's half of each automatic function, one per file (layer 3).
//!
//! Every function works in steps that never wait: a step looks at the bus, does what can be done now, and returns.
//! How often to step, and when to give up, is the caller's business. A function writes only the bits the host owns.

pub mod ascii;
pub mod background;
pub mod gather;
#[cfg(test)]
mod gather_tests;
pub mod host_port;
pub mod mailbox;
pub mod panel;
pub mod rotary;
#[cfg(test)]
mod rotary_tests;
pub mod servo;
pub mod servo_timer;
pub mod variable_read;
pub mod variable_write;
