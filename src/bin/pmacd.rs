//! The daemon that owns the board.
fn main() {}
