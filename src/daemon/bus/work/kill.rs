//! `^K`, for the control panel.

/// The progress of `^K`, which kills every motor.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Kill {
    /// A `^K` waits, or is in its word.
    pub is_under_way: bool,
    /// How many `^K` the board has taken.
    pub taken: u64,
}
