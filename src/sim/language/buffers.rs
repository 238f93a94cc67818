//! Program and table buffers: motion programs, rotary buffers, PLCs, compensation tables.
//!
//! The simulated board has none of them yet. This is the one place that says so: whatever needs such a buffer answers
//! the error that a board gives for a buffer it does not have, never a silent success.

use super::{CommandError, Outcome};

/// A command that works on buffers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BufferCommand {
    /// `OPEN PROG`, `OPEN ROT`, `OPEN PLC`.
    Open,
    /// `CLOSE`.
    Close,
    /// `CLEAR`.
    Clear,
    /// `LEARN`.
    Learn,
    /// `LIST` of any kind.
    List,
    /// `PC`, `PE`.
    ProgramLine,
    /// `PR`.
    RotaryRemaining,
    /// `ENABLE PLC`, `DISABLE PLC`.
    Plc,
    /// `DEFINE` of anything but a gather buffer.
    Define,
    /// `DELETE` of anything but a gather buffer.
    Delete,
}

/// Carries out `command` as far as a board without program buffers can.
///
/// # Errors
/// ERR005 where an open buffer is needed, ERR003 where a defined one is. `CLOSE` succeeds: it is valid with nothing open.
pub fn execute(command: BufferCommand) -> Outcome {
    match command {
        BufferCommand::Close => Ok(()),
        BufferCommand::Clear | BufferCommand::Learn => Err(CommandError::NO_OPEN_BUFFER),
        BufferCommand::Open
        | BufferCommand::List
        | BufferCommand::ProgramLine
        | BufferCommand::RotaryRemaining
        | BufferCommand::Plc
        | BufferCommand::Define
        | BufferCommand::Delete => Err(CommandError::SYNTAX),
    }
}

/// Whether program `number` (its fraction is a label, 0 the rotary buffer) exists, so that `B` can point to it.
#[must_use]
pub const fn exists(_number: f64) -> bool {
    false
}

/// Whether the 0-based coordinate system `cs` points to a program that `R` and `S` can execute.
#[must_use]
pub const fn is_pointed(_cs: usize) -> bool {
    false
}
