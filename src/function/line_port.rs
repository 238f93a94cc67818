//! A port for command lines: the DPRAM's ASCII buffers ([`super::ascii`]) or the VME mailboxes ([`super::mailbox`]).
//!
//! The two ports find the end of a control character's reply in different ways. Through the DPRAM the daemon sends a
//! line of its own: the board answers in order, so the answer to that line shows where the reply ended
//! ([`AsciiEvent::Taken`]). The mailboxes hold the host's group and the board's in the same sixteen registers (User
//! Manual p. 263-267): a line sent while the reply is due would overwrite the reply, or the reply the line. So there
//! an `<ACK>` or a silence ends the reply.

use std::time::Instant;

use crate::device::{Bus, BusError, ByteBusError};
use crate::format::Text;
use crate::map::functions::RESPONSE_BYTES;

/// A response line, read from the board into private memory: at most 255 characters, without the NUL (DPRAM manual p.
/// 29).
pub type ResponseText = Text<{ RESPONSE_BYTES - 1 }>;

/// The result of a poll.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AsciiEvent {
    /// A line of the reply to the command under way.
    Line(ResponseText),
    /// The command under way ended: acknowledged, or refused with an error number.
    Done(Result<(), u16>),
    /// The response to a `CMD"..."` in a PMAC program.
    ProgramResponse(ResponseText),
    /// A `SEND"..."` from a PMAC program.
    ProgramMessage(ResponseText),
    /// A dropped response, which no caller waits for any more; the value is its control word.
    Stale(u16),
    /// The board has taken the control character under way, whose reply has no end mark. The port reports later
    /// responses as part of that reply until the caller has settled with a line of its own where the reply ended
    /// ([`LinePort::settled`]).
    Taken,
    /// An error came while a line was under way: the line's own, which ends the line, or a program's. The port reports
    /// later responses as the line's until the caller has settled which error it was ([`LinePort::settled`]). 0: a
    /// control word that no manual names.
    Error(u16),
    /// A program's error, not a command's.
    ProgramError(u16),
}

/// The effect of a stop on the line under way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stopped {
    /// No line is under way, or the board has all of it.
    Nothing,
    /// The board has not got the line's end, so it does not carry the line out.
    Unsent,
    /// The board may have carried out a part of the line, or all of it.
    Uncertain,
}

/// A port cannot be reached.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PortError {
    /// The DPRAM.
    #[error(transparent)]
    Dpram(#[from] BusError),
    /// The mailboxes, or the host port.
    #[error(transparent)]
    Registers(#[from] ByteBusError),
}

/// The host's half of a port: one command line at a time. Each method that takes the `bus` fails when the port cannot
/// be reached.
pub trait LinePort {
    /// Whether the caller may begin a line.
    fn is_idle(&self) -> bool;

    /// Whether the board has taken the whole command under way, as far as polls have seen.
    fn was_taken(&self) -> bool;

    /// Whether a line of ours waits for the board. The board may read the line's flag as a control character's.
    fn line_lies(&self) -> bool {
        false
    }

    /// Whether the board did not take the last line or control character.
    fn is_unheard(&self) -> bool {
        false
    }

    /// Starts sending `line`. `Ok(false)`: the port is not idle, or the board still holds an earlier line; try later.
    /// The line must have passed [`crate::protocol::check_line`]; the port does not send a line that is longer than
    /// the board takes.
    ///
    /// # Errors
    /// [`PortError`].
    fn begin(&mut self, bus: &mut dyn Bus, line: &[u8]) -> Result<bool, PortError>;

    /// As [`LinePort::begin`], for a line whose reply the caller recognises: the port reports all replies, late ones
    /// of other lines first, until [`LinePort::finish`] or [`LinePort::give_up`].
    ///
    /// # Errors
    /// [`PortError`].
    fn begin_open_ended(&mut self, bus: &mut dyn Bus, line: &[u8]) -> Result<bool, PortError>;

    /// The reply to an open-ended line has come.
    fn finish(&mut self, now: Instant);

    /// The error was the line's, or the reply has ended: later responses belong to no command.
    fn settled(&mut self, now: Instant);

    /// Hands a control character to the board; `Ok(false)`: try later. See [`super::ascii::DpramPort::control`] and
    /// [`super::mailbox::MailboxPort::control`].
    ///
    /// # Errors
    /// [`PortError`].
    fn control(
        &mut self,
        bus: &mut dyn Bus,
        character: u8,
        has_reply: bool,
        now: Instant,
    ) -> Result<bool, PortError>;

    /// Whether a control character waits for the board to take it.
    ///
    /// # Errors
    /// [`PortError`].
    fn control_pending(&mut self, bus: &mut dyn Bus, now: Instant) -> Result<bool, PortError>;

    /// Whether the port set the flag of an empty line for the control character that waits.
    fn flag_is_characters(&self) -> bool {
        false
    }

    /// Takes back a control character that the board has not taken.
    ///
    /// # Errors
    /// [`PortError`].
    fn withdraw_control(&mut self, bus: &mut dyn Bus, now: Instant) -> Result<(), PortError>;

    /// Ends the line under way before a control character that replaces it. The port cannot take back a mailbox's
    /// line.
    ///
    /// # Errors
    /// [`PortError`].
    fn stop(&mut self, _bus: &mut dyn Bus, _character: u8, _now: Instant) -> Result<Stopped, PortError> {
        Ok(Stopped::Nothing)
    }

    /// Gives up the command under way; the board may have carried it out or may still do so. The port becomes idle
    /// only when the board has shown, as far as it can, that it is free.
    ///
    /// # Errors
    /// [`PortError`].
    fn give_up(&mut self, bus: &mut dyn Bus, now: Instant) -> Result<(), PortError>;

    /// Takes back at once every line and character of ours that the board has not taken. The port cannot take back a
    /// mailbox's.
    ///
    /// # Errors
    /// [`PortError`].
    fn withdraw(&mut self, _bus: &mut dyn Bus, _now: Instant) -> Result<(), PortError> {
        Ok(())
    }

    /// Does the work that is due and returns the next event, if any.
    ///
    /// # Errors
    /// [`PortError`].
    fn poll(&mut self, bus: &mut dyn Bus, now: Instant) -> Result<Option<AsciiEvent>, PortError>;
}
