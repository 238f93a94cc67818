//! Where binary program lines go: the internal rotary buffers of the coordinate systems.
//!
//! [`Machine::rotary_room`] and [`Machine::rotary_append`] are all that the transfer from the DPRAM knows of them. Behind
//! them stands a queue that keeps the lines as they came, in order, and executes nothing.

use std::collections::VecDeque;

use super::language::CommandError;
use super::machine::{MOTORS, Machine};

/// A program command: the two 24-bit words of its binary form.
pub type Command = (u32, u32);

/// In a command's first word: it is the first of its line (DPRAM manual, "Internal PMAC 48-bit command format").
pub const START_OF_LINE: u32 = 1 << 11;

/// One buffer.
#[derive(Debug, Clone, Default)]
struct Queue {
    /// Commands there is room for in all.
    size: usize,
    lines: VecDeque<Vec<Command>>,
}

/// The internal rotary buffers.
#[derive(Debug, Clone, Default)]
pub struct RotaryLines {
    queues: [Option<Queue>; MOTORS],
}

impl RotaryLines {
    /// `DEFINE ROT`: an empty buffer for `size` commands for the 0-based coordinate system.
    pub fn define(&mut self, cs: usize, size: usize) {
        if let Some(queue) = self.queues.get_mut(cs) {
            *queue = Some(Queue { size, lines: VecDeque::new() });
        }
    }

    /// Whether there is any buffer that `OPEN ROT` can open.
    #[must_use]
    pub fn is_defined(&self) -> bool {
        self.queues.iter().any(Option::is_some)
    }

    /// The oldest line, which leaves the buffer.
    pub fn take(&mut self, cs: usize) -> Option<Vec<Command>> {
        self.queues.get_mut(cs)?.as_mut()?.lines.pop_front()
    }

    /// Buffers do not outlive a reset.
    pub fn clear(&mut self) {
        *self = Self::default();
    }
}

impl Machine {
    /// Commands for which the rotary buffer of the 0-based coordinate system has room; `None` when it has no buffer.
    #[must_use]
    pub fn rotary_room(&self, cs: usize) -> Option<usize> {
        let queue = self.rotary_lines.queues.get(cs)?.as_ref()?;
        let used: usize = queue.lines.iter().map(Vec::len).sum();
        Some(queue.size.saturating_sub(used))
    }

    /// Puts a line at the end of the rotary buffer of the 0-based coordinate system. Its first command has
    /// [`START_OF_LINE`] set; if not, the host's index had split a line and this is its continuation.
    ///
    /// # Errors
    /// ERR005 without a buffer, ERR006 without room, ERR003 for a command that does not exist.
    pub fn rotary_append(&mut self, cs: usize, line: &[Command]) -> Result<(), CommandError> {
        let room = self.rotary_room(cs).ok_or(CommandError::NO_OPEN_BUFFER)?;
        if room < line.len() {
            return Err(CommandError(6));
        }
        if let Some(queue) = self.rotary_lines.queues.get_mut(cs).and_then(Option::as_mut) {
            queue.lines.push_back(line.to_vec());
        }
        Ok(())
    }
}
