//! Integration tests.

mod segment;
mod segment_cost;
mod segment_hostile;
mod segment_life;
mod segment_loom;
