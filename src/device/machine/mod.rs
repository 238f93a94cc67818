//! Which boards this machine has: candidates, their owners, and what an open board's words tell about it.

pub mod candidates;
pub mod facts;
pub mod node_owner;
pub mod probe;
pub mod recognise;
