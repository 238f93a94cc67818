//! PMAC's Ethernet protocol in front of a board that has no Ethernet port: what `pmac-gateway` is made of.
//!
//! ```text
//! client ⇄ tcp, udp → packet → client → session → text, memory → board ⇒ pmacd        (⇒ = process boundary)
//!                                └ window  │         └ addressed
//!                                          └ texts ⇐ pmacd
//! ```
//!
//! The protocol is that of the UMAC Turbo CPU/Communications manual, chapter "Ethernet Protocol", as the clients in use
//! speak it. Each client has one thread and one connection to `pmacd`; the gateway opens the connection when the client
//! first needs the board. The texts that the board's programs send come over one more connection, shared by all
//! clients. Clients, buffers and waits are all bounded.
//!
//! The gateway answers with an error where the board refused a line or nothing was sent. Where the gateway does not
//! know what the board has done, it makes up no answer: it ends the client's connection.

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
