//! Feeds a whole program into a binary rotary buffer: batch after batch, two under way, so that the board never waits
//! for the host.
//!
//! Line numbers count from the set-up of the buffer. A batch names the number of its first line, and the daemon takes
//! the batch only if that line is the next one. So when a batch did not go in whole, the batches behind it leave no
//! gap, and the daemon's count tells where to go on.

use std::collections::VecDeque;
use std::time::Duration;

use super::command::rotary::{RotaryLine, send_call};
use super::command::{CommandError, Connection, MARGIN};
use crate::protocol::CallError;
use crate::protocol::board::{Done, RotaryStateReply, RotaryStopReply};

/// Most commands of a batch: they fit in a call even with one command a line.
const BATCH_COMMANDS: usize = 1024;
/// Batches under way.
const UNDER_WAY: usize = 2;
/// How long a batch may wait for room. Short, so that few lines enter the buffer after a stop.
const BATCH_PATIENCE: Duration = Duration::from_millis(300);

/// Lines on their way into a rotary buffer, over the connection that has begun the stream ([`Connection::rotary_start`]).
#[derive(Debug)]
pub struct RotaryFeed<'a> {
    connection: Connection,
    buffer: u8,
    lines: &'a [RotaryLine],
    /// The line to send next.
    next: usize,
    /// How many lines are certainly in the buffer.
    inside: usize,
    /// The ends of the batches under way.
    under_way: VecDeque<usize>,
}

impl<'a> RotaryFeed<'a> {
    /// Begins with the first of `lines` in buffer `buffer` (from 1).
    #[must_use]
    pub fn new(connection: Connection, buffer: u8, lines: &'a [RotaryLine]) -> Self {
        Self { connection, buffer, lines, next: 0, inside: 0, under_way: VecDeque::with_capacity(UNDER_WAY) }
    }

    /// How many lines are certainly in the buffer, or have passed through it.
    #[must_use]
    pub const fn inside(&self) -> usize {
        self.inside
    }

    /// Whether all lines are in the buffer, or have passed through it.
    #[must_use]
    pub const fn is_done(&self) -> bool {
        self.inside == self.lines.len()
    }

    /// Sends the waiting lines and waits until a batch has gone in, or about a third of a second. `Some`: that time is
    /// over; the buffer's state.
    ///
    /// # Errors
    /// [`CommandError`]: the daemon cannot be reached, or refuses a line. [`RotaryFeed::inside`] tells how far the feed
    /// got.
    pub fn step(&mut self) -> Result<Option<RotaryStateReply>, CommandError> {
        while self.under_way.len() < UNDER_WAY && self.next < self.lines.len() {
            self.send_batch()?;
        }
        let Some(end) = self.under_way.pop_front() else { return Ok(None) };
        match self.connection.answer::<Done>(BATCH_PATIENCE + MARGIN) {
            Ok(_) => {
                self.inside = end;
                Ok(None)
            }
            Err(CommandError::Refused(CallError::TimedOut { .. })) => self.catch_up().map(Some),
            Err(error) => {
                // The daemon refuses the batches behind it, too; the caller wants to know how far the feed got.
                if matches!(error, CommandError::Refused(_)) {
                    self.catch_up()?;
                }
                Err(error)
            }
        }
    }

    /// Tells the daemon that no line follows: the program is whole when the board has taken the buffer's lines.
    ///
    /// # Errors
    /// [`CommandError`]; the daemon refuses if the stream has ended.
    pub fn finish(&mut self) -> Result<(), CommandError> {
        self.connection.rotary_finish(self.buffer)
    }

    /// Waits until no batch is under way, and returns the buffer's state.
    ///
    /// # Errors
    /// [`CommandError`] when the daemon cannot be reached.
    pub fn state(&mut self) -> Result<RotaryStateReply, CommandError> {
        self.catch_up()
    }

    /// Tells the daemon that the stream's owner is alive; needed every 5 s while no lines go out.
    ///
    /// # Errors
    /// [`CommandError`]; the daemon refuses if the stream has ended.
    pub fn renew(&mut self) -> Result<(), CommandError> {
        self.connection.sequence_renew()
    }

    /// Ends the stream, or tells how it has ended. [`RotaryFeed::inside`] is exact then.
    ///
    /// # Errors
    /// [`CommandError`] when the daemon cannot be reached.
    pub fn stop(&mut self) -> Result<RotaryStopReply, CommandError> {
        match self.catch_up() {
            // A board that was reset has no such buffer any more, and the daemon then refuses.
            Ok(_) | Err(CommandError::Refused(_)) => self.connection.rotary_stop(self.buffer),
            Err(error) => Err(error),
        }
    }

    fn send_batch(&mut self) -> Result<(), CommandError> {
        let rest = &self.lines[self.next..];
        let mut commands = 0;
        let full = rest.iter().position(|line| {
            commands += line.len();
            commands > BATCH_COMMANDS
        });
        // A line longer than a batch goes alone, so that the daemon refuses it with the reason.
        let count = full.unwrap_or(rest.len()).max(1);
        let lines = rest.get(..count).unwrap_or(rest);
        let parameters = send_call(self.buffer, self.next as u64, lines, BATCH_PATIENCE);
        self.connection.ask("RotarySend", &parameters, BATCH_PATIENCE + MARGIN)?;
        self.next += count;
        self.under_way.push_back(self.next);
        Ok(())
    }

    /// Waits for every batch under way, and learns from the daemon how many lines are in.
    fn catch_up(&mut self) -> Result<RotaryStateReply, CommandError> {
        while self.under_way.pop_front().is_some() {
            match self.connection.answer::<Done>(BATCH_PATIENCE + MARGIN) {
                Ok(_) | Err(CommandError::Refused(_)) => {}
                Err(error) => return Err(error),
            }
        }
        let state = self.connection.rotary_state(self.buffer)?;
        let inside = usize::try_from(state.sent_lines).unwrap_or(usize::MAX);
        self.inside = inside.min(self.lines.len());
        self.next = self.inside;
        Ok(state)
    }
}
