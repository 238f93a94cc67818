//! A stream into a binary rotary buffer, which the daemon sets up and ends for this connection.

use std::time::Duration;

use super::{CommandError, Connection, DAEMON_TIMEOUT, MARGIN, milliseconds};
use crate::map::HostOffset;
use crate::protocol::board::{Done, RotaryStartReply, RotaryStateReply, RotaryStopReply};
use crate::protocol::calls::{self, LeftLines};

/// More than the daemon gives the lines of the set-up or of the end, even if the board answers all of them late.
const SET_UP_WITHIN: Duration = Duration::from_secs(60);

/// The commands of a line, two words of 24 bits each.
pub type RotaryLine = Vec<(u32, u32)>;

/// A binary rotary buffer's place, its coordinate system, and the course of the stream. Without start or size the
/// stream takes the daemon's own room.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RotaryPlace {
    /// The buffer's number, from 1.
    pub buffer: u8,
    /// Its first word.
    pub start: Option<HostOffset>,
    /// Its size in 32-bit words.
    pub size_longs: Option<u32>,
    /// The coordinate system it feeds, from 1.
    pub coordinate_system: u8,
    /// The number that the board has for coordinate system 1: 1 or 0.
    pub coordinate_system_base: u8,
    /// Define the board's own rotary buffer first, with so many words.
    pub define_longs: Option<u32>,
    /// What to do with lines left in the board's own buffer; `None`: the daemon refuses if there are any.
    pub left: Option<LeftLines>,
    /// Start the program when its first lines are there.
    pub run: bool,
    /// The program has commands that stop it until a user starts it again.
    pub may_stand: bool,
    /// ABS, INC and FRAX for the coordinate system before the program, as [`crate::rotary::compile_stream`] gives them.
    pub modes: Vec<String>,
}

/// The parameters of a batch of lines.
pub(in crate::client) fn send_call(
    buffer: u8,
    first: u64,
    lines: &[RotaryLine],
    timeout: Duration,
) -> calls::RotarySend {
    calls::RotarySend {
        buffer,
        lines: lines.iter().map(words).collect(),
        first: Some(first),
        timeout_ms: Some(milliseconds(timeout)),
    }
}

fn words(line: &RotaryLine) -> calls::RotaryLine {
    calls::RotaryLine { words: line.iter().flat_map(|&(word1, word2)| [word1, word2]).collect() }
}

impl Connection {
    /// Begins a stream of this connection; [`crate::client::RotaryFeed`] sends its lines. Returns the number of lines
    /// left in the board's own buffer. The stream ends with the connection, or after 5 s without a call.
    ///
    /// # Errors
    /// [`CommandError`]. The daemon refuses while another client streams into the buffer, if lines are left and `left`
    /// is `None`, or if the board refuses a line of the set-up.
    pub fn rotary_start(&mut self, place: RotaryPlace) -> Result<RotaryStartReply, CommandError> {
        let parameters = calls::RotaryStart {
            buffer: place.buffer,
            start: place.start.map(calls::Offset),
            size_longs: place.size_longs,
            coordinate_system: place.coordinate_system,
            coordinate_system_base: place.coordinate_system_base,
            define_longs: place.define_longs,
            left: place.left,
            run: Some(place.run),
            may_stand: Some(place.may_stand),
            modes: place.modes,
        };
        self.call_used("RotaryStart", &parameters, SET_UP_WITHIN)
    }

    /// Puts lines of this connection's stream into rotary buffer `buffer` (from 1). The first of them must be line `first`
    /// since the buffer was set up.
    ///
    /// # Errors
    /// [`CommandError`], with [`crate::protocol::CallError::TimedOut`] inside if the buffer has no room for all of them
    /// within `timeout`: [`Connection::rotary_state`] tells how many went in.
    pub fn rotary_send(
        &mut self,
        buffer: u8,
        first: u64,
        lines: &[RotaryLine],
        timeout: Duration,
    ) -> Result<(), CommandError> {
        let Done {} = self.call("RotarySend", &send_call(buffer, first, lines, timeout), timeout + MARGIN)?;
        Ok(())
    }

    /// Tells the daemon that the program is whole: no line follows in this connection's stream into rotary buffer
    /// `buffer` (from 1).
    ///
    /// # Errors
    /// [`CommandError`]; the daemon refuses without such a stream.
    pub fn rotary_finish(&mut self, buffer: u8) -> Result<(), CommandError> {
        let Done {} = self.call("RotaryFinish", &calls::Rotary { buffer }, DAEMON_TIMEOUT + MARGIN)?;
        Ok(())
    }

    /// Ends this connection's stream, and its program unless the board has the whole program. For a stream that has
    /// ended already, tells how it ended.
    ///
    /// # Errors
    /// [`CommandError`]; the daemon refuses if this connection never had such a stream.
    pub fn rotary_stop(&mut self, buffer: u8) -> Result<RotaryStopReply, CommandError> {
        self.call("RotaryStop", &calls::Rotary { buffer }, SET_UP_WITHIN)
    }

    /// The state of rotary buffer `buffer` (from 1).
    ///
    /// # Errors
    /// [`CommandError`]; the daemon refuses if no stream has set up the buffer.
    pub fn rotary_state(&mut self, buffer: u8) -> Result<RotaryStateReply, CommandError> {
        self.call("RotaryState", &calls::Rotary { buffer }, DAEMON_TIMEOUT + MARGIN)
    }
}
