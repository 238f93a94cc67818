//! PMAC's Ethernet protocol in front of a board that has no Ethernet port: what `pmac-gateway` is made of.
//!
//! ```text
//! client ⇄ tcp, udp → packet → client → session → text, memory → board ⇒ pmacd        (⇒ = process boundary)
//!                                └ window  │         └ addressed
//!                                          └ texts ⇐ pmacd
//! ```
//!
//! The protocol is that of the UMAC Turbo CPU/Communications manual, chapter "Ethernet Protocol", as the clients in use speak it.
//! A client has one thread and one connection to `pmacd`, made when it is needed first; what the board's programs send by themselves
//! comes over one connection for all. Everything is bounded: clients, buffers, waits.
//!
//! Where the board has refused a line, or nothing was sent, the client is told an error. Where it is not known what the board
//! has done, no answer is made up: the client's connection ends.

mod addressed;
pub mod board;
pub mod client;
pub mod journal;
mod memory;
pub mod options;
pub mod packet;
mod places;
mod quota;
pub mod reply;
pub mod session;
pub mod tcp;
mod text;
pub mod texts;
pub mod udp;
mod window;
