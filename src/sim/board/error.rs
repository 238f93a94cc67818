//! The errors that a command ends in.

/// The number of an error report: 3 is printed as `ERR003` (Software Reference, I6).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, thiserror::Error)]
#[error("ERR{0:03}")]
pub struct CommandError(pub u16);

impl CommandError {
    /// ERR001: not allowed while a motion program runs.
    pub const RUNNING: Self = Self(1);
    /// ERR002: the password is missing or wrong.
    pub const PASSWORD: Self = Self(2);
    /// ERR003: a command or number that is not understood.
    pub const SYNTAX: Self = Self(3);
    /// ERR004: a character above 127.
    pub const CHARACTER: Self = Self(4);
    /// ERR005: a program command while no buffer is open.
    pub const NO_OPEN_BUFFER: Self = Self(5);
    /// ERR006: no room in the buffer.
    pub const NO_ROOM: Self = Self(6);
    /// ERR007: a buffer is open already.
    pub const BUFFER_IN_USE: Self = Self(7);
    /// ERR008: a MACRO command failed.
    pub const MACRO: Self = Self(8);
    /// ERR009: the end of a block without its begin.
    pub const STRUCTURE: Self = Self(9);
    /// ERR010: both overtravel limits of a motor are set.
    pub const BOTH_LIMITS: Self = Self(10);
    /// ERR011: the previous move is still in progress.
    pub const MOVE_IN_PROGRESS: Self = Self(11);
    /// ERR012: a motor of the coordinate system is open-loop.
    pub const OPEN_LOOP: Self = Self(12);
    /// ERR013: a motor of the coordinate system is not activated.
    pub const NOT_ACTIVATED: Self = Self(13);
    /// ERR014: the coordinate system has no motor.
    pub const NO_MOTOR: Self = Self(14);
    /// ERR015: the coordinate system does not point to a program.
    pub const NO_PROGRAM: Self = Self(15);
    /// ERR016: the program has blocks that do not end.
    pub const BAD_STRUCTURE: Self = Self(16);
    /// ERR017: motors are not where the program stopped.
    pub const NOT_AT_STOP: Self = Self(17);
}
