//! The internal rotary program buffers, one per coordinate system: lines come in, executed lines go out (User Manual p.
//! 213).
//!
//! Lines come as text while `OPEN ROT` is in force, or in binary from the DPRAM while `OPEN ROT` or `OPEN BINARY
//! ROTARY` is in force: the transfer calls [`room`](Programs::rotary_room) and [`append`](Programs::rotary_append). The
//! board frees a line as soon as it has executed the line.

use std::collections::VecDeque;
use std::sync::Arc;

use super::Programs;
use crate::sim::board::Board;
use crate::sim::board::error::CommandError;
use crate::sim::program::binary::{self, Command, NoCommand};
use crate::sim::program::item::{Item, Line};

/// The long words of a binary command in the internal buffer.
const WORDS_OF_A_COMMAND: usize = 1;

/// A rotary buffer.
#[derive(Debug, Clone, Default)]
pub struct Rotary {
    /// Its size in long words, as defined.
    pub size: usize,
    used: usize,
    lines: VecDeque<Arc<Line>>,
    /// The number of the first line still present; numbers count from the definition of the buffer.
    first: u64,
    /// Start of the next line: long words since the definition, modulo the size.
    offset: usize,
}

impl Rotary {
    /// An empty buffer of `size` long words.
    #[must_use]
    pub fn new(size: usize) -> Self {
        Self { size, ..Self::default() }
    }

    /// Free long words.
    #[must_use]
    pub fn free(&self) -> usize {
        self.size - self.used
    }

    /// Appends a line.
    ///
    /// # Errors
    /// ERR006 without room.
    pub fn append(&mut self, items: Vec<Item>) -> Result<(), CommandError> {
        let line = Line { items, offset: self.offset };
        let words = line.words();
        if words > self.free() {
            return Err(CommandError::NO_ROOM);
        }
        self.used += words;
        self.offset = (self.offset + words) % self.size;
        self.lines.push_back(Arc::new(line));
        Ok(())
    }

    /// Line `number`.
    #[must_use]
    pub fn line(&self, number: u64) -> Option<&Arc<Line>> {
        self.lines.get(usize::try_from(number.checked_sub(self.first)?).ok()?)
    }

    /// The number of the first line still present.
    #[must_use]
    pub fn first(&self) -> u64 {
        self.first
    }

    /// The number of the next line.
    #[must_use]
    pub fn next(&self) -> u64 {
        self.first + self.lines.len() as u64
    }

    /// Frees the lines before `number`.
    pub fn free_before(&mut self, number: u64) {
        while self.first < number {
            let Some(line) = self.lines.pop_front() else { return };
            self.used -= line.words();
            self.first += 1;
        }
    }

    /// Erases all lines.
    pub fn clear(&mut self) {
        let next = self.next();
        self.free_before(next);
    }

    /// The lines, in order.
    pub fn lines(&self) -> impl Iterator<Item = &Arc<Line>> {
        self.lines.iter()
    }
}

/// Why a rotary buffer does not accept a binary line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum AppendError {
    /// No rotary buffer is defined for the coordinate system.
    #[error("no rotary buffer is defined for the coordinate system")]
    Undefined,
    /// Not enough room now; try again when lines have been executed.
    #[error("no room in the rotary buffer")]
    Full,
    /// Two words are no command.
    #[error(transparent)]
    Command(#[from] NoCommand),
}

impl Programs {
    /// Whether the rotary buffer of the 0-based `cs` can take a line of `commands` commands now; also `false` without a
    /// defined or open buffer.
    #[must_use]
    pub fn rotary_room(&self, cs: usize, commands: usize) -> bool {
        self.store.rotary_is_open()
            && self.store.rotary(cs).is_some_and(|rotary| rotary.free() >= commands * WORDS_OF_A_COMMAND)
    }

    /// Appends one binary line to the rotary buffer of the 0-based `cs`: the 24-bit word pairs of its commands.
    ///
    /// # Errors
    /// [`AppendError`]; the buffer then stores no command of the line.
    pub fn rotary_append(
        &mut self,
        board: &mut Board,
        cs: usize,
        commands: &[Command],
    ) -> Result<(), AppendError> {
        let code2 = board.identity.readings.rotary_code2.unwrap_or(binary::CODE2);
        let items = binary::line(commands, code2, board.family().rotary.home_motors)?;
        let rotary = self.store.rotary_mut(cs).ok_or(AppendError::Undefined)?;
        if items.is_empty() {
            return Ok(());
        }
        rotary.append(items).map_err(|_| AppendError::Full)?;
        self.note_rotary(board, cs);
        Ok(())
    }

    /// Lines of the rotary buffer ahead of the calculated line: `PR`. `None` without a buffer.
    #[must_use]
    pub fn rotary_remaining(&self, cs: usize) -> Option<u64> {
        let rotary = self.store.rotary(cs)?;
        let calculated = self.systems.get(cs)?.rotary_line().max(rotary.first());
        Some(rotary.next().saturating_sub(calculated))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn executed_lines_give_their_room_back() {
        let mut rotary = Rotary::new(5);
        let line = || vec![Item::Stop, Item::Wait];
        rotary.append(line()).unwrap();
        rotary.append(line()).unwrap();
        assert_eq!(rotary.append(line()), Err(CommandError::NO_ROOM));
        assert_eq!((rotary.first(), rotary.next(), rotary.free()), (0, 2, 1));
        rotary.free_before(1);
        rotary.append(line()).unwrap();
        assert_eq!(rotary.line(2).map(|line| line.offset), Some(4));
        assert_eq!(rotary.line(0), None);
        rotary.clear();
        assert_eq!((rotary.free(), rotary.next()), (5, 3));
    }
}
