//! Which boards this machine has: candidates, their owners, and the facts in an open board's words.

pub mod candidates;
#[cfg(feature = "cli")]
pub mod facts;
pub mod node_owner;
pub mod probe;
pub mod recognise;
