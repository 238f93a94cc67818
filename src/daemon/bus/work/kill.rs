//! `^K`, as the control panel has to know of it.

/// How far `^K` is, which kills every motor.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Kill {
    /// One waits, or lies in its word.
    pub is_under_way: bool,
    /// How many the board has taken.
    pub taken: u64,
}
