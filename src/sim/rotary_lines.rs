//! Where binary program lines go: the internal rotary buffers of the coordinate systems.
//!
//! [`Machine::rotary_remaining`], [`Machine::rotary_room`] and [`Machine::rotary_append`] are all that the transfer from the
//! DPRAM knows of them. Behind them stands a queue that keeps the lines as they came, in order, and executes nothing.

use std::collections::VecDeque;

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

    /// The oldest line, which leaves the buffer.
    pub fn take(&mut self, cs: usize) -> Option<Vec<Command>> {
        self.queues.get_mut(cs)?.as_mut()?.lines.pop_front()
    }

    /// Buffers do not outlive a reset.
    pub fn clear(&mut self) {
        *self = Self::default();
    }
}

/// Why a line does not come into a rotary buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum AppendError {
    /// There is no buffer.
    #[error("no rotary buffer is defined for the coordinate system")]
    Undefined,
    /// There is no room now.
    #[error("no room in the rotary buffer")]
    Full,
    /// Two words are no command.
    #[error(transparent)]
    Command(#[from] NoCommand),
}

/// Two words that are no command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("${word1:06X} ${word2:06X} is no program command")]
pub struct NoCommand {
    /// The first word.
    pub word1: u32,
    /// The second word.
    pub word2: u32,
}

impl Machine {
    /// Lines in the rotary buffer of the 0-based coordinate system; `None` when it has no buffer.
    #[must_use]
    pub fn rotary_remaining(&self, cs: usize) -> Option<u64> {
        let queue = self.rotary_lines.queues.get(cs)?.as_ref()?;
        Some(queue.lines.len() as u64)
    }

    /// Whether the rotary buffer of the 0-based coordinate system can take a line of `commands` commands now.
    #[must_use]
    pub fn rotary_room(&self, cs: usize, commands: usize) -> bool {
        let queue = self.rotary_lines.queues.get(cs).and_then(Option::as_ref);
        queue.is_some_and(|queue| queue.lines.iter().map(Vec::len).sum::<usize>() + commands <= queue.size)
    }

    /// Puts a line at the end of the rotary buffer of the 0-based coordinate system. Its first command has
    /// [`START_OF_LINE`] set; if not, the host's index had split a line and this is its continuation.
    ///
    /// # Errors
    /// [`AppendError`]; nothing is stored then.
    pub fn rotary_append(&mut self, cs: usize, line: &[Command]) -> Result<(), AppendError> {
        let wrong = line.iter().find(|(word1, _)| matches!(word1 >> 6 & 0x1F, 0 | 29 | 31));
        if let Some(&(word1, word2)) = wrong {
            return Err(NoCommand { word1, word2 }.into());
        }
        let room = self.rotary_room(cs, line.len());
        let queue =
            self.rotary_lines.queues.get_mut(cs).and_then(Option::as_mut).ok_or(AppendError::Undefined)?;
        if !room {
            return Err(AppendError::Full);
        }
        queue.lines.push_back(line.to_vec());
        Ok(())
    }
}
