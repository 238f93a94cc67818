//! The simulated board.
fn main() {}
