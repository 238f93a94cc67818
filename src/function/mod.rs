//! The host's half of each automatic function, one per file (layer 3).
//!
//! Every function works in steps that never wait: a step looks at the bus, does what can be done now, and returns.
//! How often to step, and when to give up, is the caller's business. A function writes only the bits the host owns.
//!
//! # What a command line costs
//! Bus accesses of a line of n characters that is answered by one line of m characters, counted by a test. The DPRAM's are
//! of 16 bits, the mailboxes' of 8:
//!
//! | | DPRAM ([`ascii`], n up to 159) | VME mailboxes ([`mailbox`]) |
//! |---|---|---|
//! | the line | n/2 + 4 | n + 1 |
//! | to see it taken | 1 | 0; an interrupt a group of 15 |
//! | the reply line | m/2 (rounded up) + 3 | m + 1, and 2 a group of 16; an interrupt a group |
//! | the acknowledgement | 3 | 3, an interrupt |
//! | all | n/2 + m/2 + 11 | n + m + 5 + 2 ceil((m+1)/16) |
//! | `P1` and 2 digits | 13 | 11 |
//! | 20 and 20 characters | 31 | 49 |
//! | 80 and 80 characters | 91 | 177 |
//! | each look in vain | 2 until it is taken, then 1 | 0 |

pub mod ascii;
pub mod background;
pub mod gather;
#[cfg(test)]
mod gather_tests;
pub mod host_port;
pub mod mailbox;
pub mod panel;
#[cfg(test)]
mod port_cost_tests;
pub mod rotary;
#[cfg(test)]
mod rotary_tests;
pub mod servo;
pub mod servo_timer;
pub mod variable_read;
pub mod variable_write;
