//! Sequences of command lines, which the daemon runs for this connection.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use super::{CommandError, Connection, DAEMON_TIMEOUT, MARGIN, fault, milliseconds, not_taken, read_reply};
use crate::language::{Meaning, deadlines};
use crate::protocol::board::RunLinesReply;
use crate::protocol::cut_off;
use crate::protocol::message::encode;
use crate::protocol::parameters::to_map;
use crate::protocol::{BOARD, Call, CallError, calls};

/// Lines in one call: few, so that a sequence ends soon after a request.
const AT_ONCE: usize = 8;

/// How the daemon runs a sequence of lines.
#[derive(Debug, Clone, Copy)]
pub struct LinesOptions<'a> {
    /// The sequence's name for others, in lower-case letters: `download`.
    pub kind: &'a str,
    /// How long the board may take for a line.
    pub timeout: Duration,
    /// Whether to go on after a line that the board refuses.
    pub keep_going: bool,
}

/// A sequence of command lines that the daemon runs. End it by [`LineSequence::finish`]; the daemon also ends it when
/// the connection is gone, or silent for 5 s.
#[derive(Debug)]
pub struct LineSequence<'c> {
    connection: &'c mut Connection,
    options: LinesOptions<'c>,
    at_end: Option<Vec<String>>,
    over: Option<RunLinesReply>,
    stop: Option<&'c AtomicBool>,
}

impl Connection {
    /// Begins a sequence with its first lines. No other sequence runs until this one is over.
    pub fn lines<'c>(&'c mut self, options: LinesOptions<'c>) -> LineSequence<'c> {
        LineSequence { connection: self, options, at_end: None, over: None, stop: None }
    }

    /// Runs `lines` as one sequence. `told` gets each line's outcome as it happens; if it returns `false`, the sequence
    /// ends soon. Returns the last reply: the number of lines that the board has taken, and the state in which the
    /// sequence leaves the board. The daemon closes a program buffer that the lines have opened, even if this process
    /// dies.
    ///
    /// # Errors
    /// [`CommandError`]. The daemon refuses with [`crate::protocol::CallError::Refused`], with nothing sent, while
    /// another client runs a sequence of lines.
    pub fn run_lines<L: AsRef<str>>(
        &mut self,
        options: LinesOptions<'_>,
        lines: &[L],
        told: impl FnMut(&RunLinesReply) -> bool,
    ) -> Result<RunLinesReply, CommandError> {
        // The daemon refuses such a line, too, but may have sent others before it.
        let cuts_off = |line: &&str| Meaning::of(line).settings.cuts_off;
        let mut all = lines.iter().map(AsRef::as_ref).filter(|_| !self.confirms);
        if let Some(line) = all.find(|line| cuts_off(line).is_certain()) {
            return Err(cut_off::refusal(line, cuts_off(&line)).into());
        }
        let mut sequence = self.lines(options);
        sequence.run(lines, told)?;
        sequence.finish()
    }
}

impl<'c> LineSequence<'c> {
    /// Gives up the sequence when `stop` becomes true, after the line under way: closes the connection, and the daemon
    /// ends the sequence.
    pub fn stop_on(&mut self, stop: &'c AtomicBool) {
        self.stop = Some(stop);
    }

    /// The lines that the daemon sends at the end of the sequence, for whatever reason it ends: they restore the board.
    pub fn at_end(&mut self, lines: Vec<String>) {
        self.at_end = Some(lines);
    }

    /// Whether [`Self::at_end`] was given lines.
    #[must_use]
    pub fn has_end(&self) -> bool {
        self.at_end.is_some()
    }

    /// Runs `lines`. `told` gets each line's outcome; if it returns `false`, the daemon leaves out the rest. Returns
    /// whether the sequence goes on: a failed line ends it, and [`LineSequence::finish`] tells the state of the board.
    ///
    /// # Errors
    /// As [`Connection::run_lines`].
    pub fn run<L: AsRef<str>>(
        &mut self,
        lines: &[L],
        mut told: impl FnMut(&RunLinesReply) -> bool,
    ) -> Result<bool, CommandError> {
        let mut goes_on = true;
        for chunk in lines.chunks(AT_ONCE) {
            if !goes_on || self.over.is_some() {
                break;
            }
            if self.is_stopped() {
                return Err(self.give_up());
            }
            self.call(chunk, false, &mut |reply| goes_on &= told(reply))?;
        }
        Ok(goes_on && self.over.is_none())
    }

    /// Tells the daemon between two calls of `run` that the owner is alive.
    ///
    /// # Errors
    /// As [`Connection::sequence_renew`].
    pub fn renew(&mut self) -> Result<(), CommandError> {
        self.connection.sequence_renew()
    }

    /// Ends the sequence. Returns the last reply: the number of lines that the board has taken, and the state in which
    /// the sequence leaves the board.
    ///
    /// # Errors
    /// [`CommandError`].
    pub fn finish(mut self) -> Result<RunLinesReply, CommandError> {
        if self.over.is_none() {
            self.call::<&str>(&[], true, &mut |_| {})?;
        }
        Ok(self.over.unwrap_or_default())
    }

    /// Has the daemon run `lines`, the last ones if `last`.
    fn call<L: AsRef<str>>(
        &mut self,
        lines: &[L],
        last: bool,
        told: &mut impl FnMut(&RunLinesReply),
    ) -> Result<(), CommandError> {
        let LinesOptions { kind, timeout, keep_going } = self.options;
        let parameters = calls::RunLines {
            kind: kind.to_owned(),
            lines: lines.iter().map(|line| line.as_ref().to_owned()).collect(),
            timeout_ms: Some(milliseconds(timeout)),
            keep_going: Some(keep_going),
            at_end: self.at_end.clone(),
            last: Some(last),
            confirmed: self.connection.confirmed(),
        };
        let mut call = Call::new(format!("{BOARD}.RunLines"), to_map(&parameters));
        call.more = Some(true);
        let mut link = self.connection.take_link()?;
        let path = &self.connection.path;
        link.call(&encode(&call), super::after(DAEMON_TIMEOUT)).map_err(|error| not_taken(path, error))?;
        loop {
            // The last reply may have to wait for the current line, and for the lines at the end.
            let patience =
                timeout.max(deadlines::LONGEST).saturating_add(DAEMON_TIMEOUT).saturating_add(MARGIN);
            let reply = link.next_reply(super::after(patience)).map_err(|error| fault(path, error))?;
            let continues = reply.continues == Some(true);
            let reply: Result<RunLinesReply, CommandError> = read_reply(reply);
            if !continues {
                // Only after its last reply can the connection take another call.
                self.connection.link = Some(link);
                self.over = Some(reply?).filter(|reply| reply.over);
                return Ok(());
            }
            told(&reply?);
            if self.is_stopped() {
                return Err(self.give_up());
            }
        }
    }

    fn is_stopped(&self) -> bool {
        self.stop.is_some_and(|stop| stop.load(Ordering::Relaxed))
    }

    /// Closes the connection: the daemon ends the sequence.
    fn give_up(&mut self) -> CommandError {
        self.connection.link = None;
        self.over = Some(RunLinesReply::default());
        CallError::Refused { reason: "stopped by a signal".to_owned() }.into()
    }
}
