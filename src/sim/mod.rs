//! The simulated board: PMAC's half of every handshake (layer 5).

pub mod language;
pub mod machine;
