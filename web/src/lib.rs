//! A board in a browser, and its numbers for Prometheus. This program only reads.
//!
//! ```text
//! segment → feed (one thread) → state (JSON, 5 a second) ⇒ /state, /events → the page
//!                             → batches of updates       ⇒ /scope          → the page's scope
//! segment → metrics           → text                     ⇒ /metrics        → Prometheus       (⇒ = network)
//! socket  → watch             → state
//! ```
//!
//! However many clients come, and whatever they do, this program reads the segment once for all pages, and once more
//! for each scrape of `/metrics`. It asks the board only for the variables that its command line names, once a second.

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
pub mod watch;
