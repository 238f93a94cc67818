//! A Linux driver for the dual-ported RAM (DPRAM) of Delta Tau PMAC motion controllers.
//!
//! A PMAC board shares 8K x 16 bit of memory with its host. One privileged daemon (`pmacd`) owns the board; every
//! other process reads coherent live data from a POSIX shared-memory segment and sends commands through a socket.
//!
//! ```text
//! read      device → function → mirror → segment ⇒ client → cli / your program
//! command   cli / your program → client ⇒ daemon → function → device
//! firmware  sim ⇄ the same bytes that device::file maps                    (⇒ = process boundary)
//! ```
//!
//! Layers, lowest first; a module uses only layers below its own:
//!
//! | layer | modules |
//! |---|---|
//! | 0 | [`mod@format`]: numbers and text as DPRAM holds them |
//! | 1 | [`map`]: what lies where · [`decode`]: words to named values · [`setup`]: calculators, what to send to a board · [`rotary`]: motion programs as binary commands · [`gather`]: what is gathered and what it says · [`protocol`]: the command socket's messages |
//! | 2 | [`device`]: the bus, its kinds and decorators, the interrupt |
//! | 3 | [`function`]: the host's half of each automatic function |
//! | 4 | [`mirror`]: what to read when · [`segment`]: the shared-memory ABI |
//! | 5 | [`daemon`] · [`client`] · [`sim`] |
//! | 6 | [`cli`] and the programs |

pub mod cli;
pub mod client;
pub mod daemon;
pub mod decode;
pub mod device;
pub mod format;
pub mod function;
pub mod gather;
pub mod map;
pub mod mirror;
pub mod protocol;
pub mod rotary;
pub mod segment;
pub mod setup;
pub mod sim;
