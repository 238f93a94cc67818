//! Keeps a program's lines out of buffers that the program has not opened.
//!
//! By hand a user may write into any buffer of his own: he opens it in one terminal and looks at it from another. A
//! program does not know of that buffer. The program's `P1=5` would become a line of the user's motion program, and
//! count as done.

use std::time::Duration;

use super::command::{CommandError, Connection, SendAs};
use crate::language::{Effect, Meaning};
use crate::protocol::CallError;
use crate::protocol::board::SendReply;
use crate::protocol::control::{CLOSE_ROTARY, OPEN_ROTARY};

/// Whether a program's lines have opened a buffer and not closed it. This outlives the connection: over a new
/// connection the board must not execute a line for the buffer at once.
#[derive(Debug, Clone, Copy, Default)]
pub struct OwnBuffer {
    is_open: bool,
}

impl OwnBuffer {
    /// Whether these lines have a buffer open, as far as they know.
    #[must_use]
    pub const fn is_open(&self) -> bool {
        self.is_open
    }

    /// As [`Connection::send`], but the daemon refuses the line if it would enter a buffer that others have opened, or
    /// if it is meant for these lines' buffer and that buffer is closed. `CLOSE` and on-line commands always pass.
    ///
    /// # Errors
    /// As [`Connection::send`].
    pub fn send(
        &mut self,
        connection: &mut Connection,
        line: &str,
        timeout: Duration,
    ) -> Result<Vec<String>, CommandError> {
        Ok(self.send_and_see(connection, line, timeout)?.lines)
    }

    /// As [`Self::send`]. The reply also tells whether the line may have entered a buffer, as in
    /// [`Connection::send_and_see`].
    ///
    /// # Errors
    /// As [`Connection::send`].
    pub fn send_and_see(
        &mut self,
        connection: &mut Connection,
        line: &str,
        timeout: Duration,
    ) -> Result<SendReply, CommandError> {
        let meaning = Meaning::of(line);
        let effect = meaning.buffer;
        let into_buffer = Some(self.is_open || meaning.opens());
        let sent = connection.send_and_see(line, timeout, SendAs { into_buffer, ..SendAs::default() });
        match effect {
            Some(Effect::Opens(_)) => {
                self.is_open |= sent.as_ref().map_or_else(CommandError::is_uncertain, |_| true)
            }
            // After `CLOSE` these lines have no more lines for the buffer. If the buffer is open all the same, no line
            // enters it.
            Some(Effect::Closes) => {
                self.is_open &=
                    !sent.as_ref().map_or_else(|error| is_refusal(error) || error.is_uncertain(), |_| true);
            }
            Some(Effect::OpensBinary) | None => {}
        }
        match sent {
            Err(CommandError::Refused(CallError::Refused { reason })) if self.is_open && effect.is_none() => {
                let reason = format!("{reason}; CLOSE, or another OPEN, ends the lines that belong into it");
                Err(CallError::Refused { reason }.into())
            }
            sent => sent,
        }
    }

    /// As [`Connection::control`]; `^U` opens a buffer of these lines, and `^L` closes it.
    ///
    /// # Errors
    /// As [`Connection::control`].
    pub fn control(
        &mut self,
        connection: &mut Connection,
        character: u8,
    ) -> Result<Vec<String>, CommandError> {
        let sent = connection.control(character)?;
        self.is_open = match character {
            OPEN_ROTARY => true,
            CLOSE_ROTARY => false,
            _ => self.is_open,
        };
        Ok(sent)
    }
}

/// The board has refused the line.
fn is_refusal(error: &CommandError) -> bool {
    matches!(error, CommandError::Refused(CallError::Board { .. }))
}
