//! Sequences of command lines, which the daemon runs for this connection alone.

use std::time::Duration;

use super::{CommandError, Connection, DAEMON_TIMEOUT, MARGIN, fault, milliseconds, read_reply};
use crate::protocol::board::RunLinesReply;
use crate::protocol::message::encode;
use crate::protocol::parameters::to_map;
use crate::protocol::{BOARD, Call, calls};

/// Lines that the daemon is given at a time: few, so that whoever wants to end the sequence does not wait long.
const AT_ONCE: usize = 8;

/// How a sequence of lines is run.
#[derive(Debug, Clone, Copy)]
pub struct LinesOptions<'a> {
    /// What others are told it is, in lower-case letters: `download`.
    pub kind: &'a str,
    /// How long the board may take for a line.
    pub timeout: Duration,
    /// Whether to go on after a line that the board refuses.
    pub keep_going: bool,
}

impl Connection {
    /// Runs `lines` as one sequence. `told` is given what becomes of each, as it happens; a `false` of it ends the sequence soon.
    /// Returns the last reply: how many lines the board has taken, and what the sequence leaves on the board. A program
    /// buffer that the lines have opened is closed then; the daemon closes it too when this process dies.
    ///
    /// # Errors
    /// [`CommandError`]; [`crate::protocol::CallError::Refused`] in it, with nothing sent, while somebody else runs a
    /// sequence of lines.
    pub fn run_lines<L: AsRef<str>>(
        &mut self,
        options: LinesOptions<'_>,
        lines: &[L],
        mut told: impl FnMut(&RunLinesReply) -> bool,
    ) -> Result<RunLinesReply, CommandError> {
        let mut chunks = lines.chunks(AT_ONCE).peekable();
        let mut goes_on = true;
        loop {
            let chunk = if goes_on { chunks.next().unwrap_or_default() } else { &[] };
            let is_last = !goes_on || chunks.peek().is_none();
            let over = self.run_some(options, chunk, is_last, &mut |reply| goes_on &= told(reply))?;
            if over.over {
                return Ok(over);
            }
        }
    }

    /// Has the daemon run `lines` of a sequence, its last ones if `is_last`. The last reply to the call.
    fn run_some<L: AsRef<str>>(
        &mut self,
        options: LinesOptions<'_>,
        lines: &[L],
        is_last: bool,
        told: &mut impl FnMut(&RunLinesReply),
    ) -> Result<RunLinesReply, CommandError> {
        let LinesOptions { kind, timeout, keep_going } = options;
        let parameters = calls::RunLines {
            kind: kind.to_owned(),
            lines: lines.iter().map(|line| line.as_ref().to_owned()).collect(),
            timeout_ms: Some(milliseconds(timeout)),
            keep_going: Some(keep_going),
            last: Some(is_last),
        };
        let mut call = Call::new(format!("{BOARD}.RunLines"), to_map(&parameters));
        call.more = Some(true);
        let mut link = match self.link.take() {
            Some(link) => link,
            None => self.dial()?,
        };
        // The last reply may have to wait for the line under way, and for CLOSE after it.
        let patience = timeout.saturating_add(DAEMON_TIMEOUT).saturating_add(MARGIN);
        link.write(&encode(&call), super::after(DAEMON_TIMEOUT)).map_err(|error| fault(&self.path, error))?;
        loop {
            let reply = link.next_reply(super::after(patience)).map_err(|error| fault(&self.path, error))?;
            let continues = reply.continues == Some(true);
            let reply = read_reply(reply);
            if !continues {
                // Only a connection whose last reply has been read can be used again.
                self.link = Some(link);
                return reply;
            }
            told(&reply?);
        }
    }
}
