//! What to read when (layer 4).

pub mod clock;
