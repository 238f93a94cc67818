//! A board in a browser, and its numbers for Prometheus. This program only reads, and only the daemon's shared memory.
//!
//! ```text
//! segment → feed (one thread) → state (JSON, 5 a second) ⇒ /state, /events → the page
//!                             → batches of updates       ⇒ /scope          → the page's scope
//! segment → metrics           → text                     ⇒ /metrics        → Prometheus       (⇒ = network)
//! ```
//!
//! However many clients come, and whatever they do, this program reads the segment once for all pages, and once more
//! for each scrape of `/metrics`. It never asks the board.

pub mod board;
pub mod feed;
pub mod hosts;
pub mod metrics;
pub mod options;
pub mod pages;
pub mod places;
pub mod scope;
pub mod server;
pub mod state;
