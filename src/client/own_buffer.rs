//! Into which program buffer a program's lines go: into one that they have opened themselves, and into no other.
//!
//! By hand a user may write into whatever buffer is his: he opens it in one terminal and looks at it from another. A program cannot
//! know of that. Its `P1=5` would become a line of the user's motion program, and count as done.

use std::time::Duration;

use super::command::{CommandError, Connection, SendAs};
use crate::protocol::CallError;
use crate::protocol::board::SendReply;
use crate::protocol::buffer_line::{Effect, effect};
use crate::protocol::control::{CLOSE_ROTARY, OPEN_ROTARY};

/// Whether a program's lines have opened a buffer that they have not closed. It outlives the connection: what belongs into a buffer
/// must not be carried out at once because the connection is another one.
#[derive(Debug, Clone, Copy, Default)]
pub struct OwnBuffer {
    is_open: bool,
}

impl OwnBuffer {
    /// Whether these lines have one open, as far as they know.
    #[must_use]
    pub const fn is_open(&self) -> bool {
        self.is_open
    }

    /// As [`Connection::send`], but that the line enters no buffer that others have opened, and that one for a buffer of these lines
    /// is not carried out where that is closed: both are refused and not sent. `CLOSE`, and what is on-line only, always goes.
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

    /// As [`Self::send`]. The reply tells, too, whether the line may have gone into a buffer, as that of [`Connection::send_and_see`].
    ///
    /// # Errors
    /// As [`Connection::send`].
    pub fn send_and_see(
        &mut self,
        connection: &mut Connection,
        line: &str,
        timeout: Duration,
    ) -> Result<SendReply, CommandError> {
        let effect = effect(line.as_bytes());
        let opens = matches!(effect, Some(Effect::Opens(_)));
        let into_buffer = Some(self.is_open || opens);
        let sent = connection.send_and_see(line, timeout, SendAs { into_buffer, ..SendAs::default() });
        match effect {
            Some(Effect::Opens(_)) => {
                self.is_open |= sent.as_ref().map_or_else(CommandError::is_uncertain, |_| true)
            }
            // Whoever has closed it has no more lines for it. If it is open all the same, nothing enters it.
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
