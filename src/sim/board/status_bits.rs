//! The bits of `?` and `???` that differ between families (Software Reference pp. 189-198, Turbo Software Reference
//! pp. 284-290). A mask of 0 is a bit that the family does not have.

/// The masks.
#[derive(Debug, Clone, Copy)]
pub struct StatusBits {
    /// In the first word of `?`: following is enabled.
    pub following: u32,
    /// There: the motor is commutated by the board.
    pub phased: u32,
    /// There: the amplifier is enabled.
    pub amplifier_in_first: u32,
    /// There: the desired velocity is zero.
    pub standing: u32,
    /// Whether an open loop counts as standing.
    pub stands_in_open_loop: bool,
    /// In the second word of `?`: the amplifier is enabled.
    pub amplifier_in_second: u32,
    /// There: the motor is assigned to a coordinate system, whose number less 1 begins at bit 20.
    pub assigned: u32,
    /// There: the kind of axis begins at bit 16.
    pub axis_codes: bool,
    /// In the second word of `???`: responses go to a port of the host.
    pub host_port: u32,
    /// There: the board is a VME board.
    pub vme_board: u32,
}

/// PMAC and PMAC2.
pub const PMAC: StatusBits = StatusBits {
    following: 1 << 20,
    phased: 1 << 19,
    amplifier_in_first: 0,
    standing: 1 << 13,
    stands_in_open_loop: true,
    amplifier_in_second: 1 << 14,
    assigned: 1 << 23,
    axis_codes: false,
    host_port: 1 << 22 | 1 << 15,
    vme_board: 0,
};

/// Turbo PMAC. A board at factory settings answers `850000000000` to `?`: activated, open loop, integration, not standing.
pub const TURBO: StatusBits = StatusBits {
    following: 1 << 4,
    phased: 1 << 6,
    amplifier_in_first: 1 << 19,
    standing: 1 << 13,
    stands_in_open_loop: false,
    amplifier_in_second: 0,
    assigned: 1 << 15,
    axis_codes: true,
    host_port: 0,
    vme_board: 1 << 22,
};
