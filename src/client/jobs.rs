//! Calls for the control panel, open words of the DPRAM and the binary rotary buffers.
//!
//! As every call, each is bounded: by what the daemon gives the board, and a margin for the daemon to say so.

use std::time::Duration;

use serde::Deserialize;
use serde_json::{Value, json};

use super::command::{CommandError, Connection, DAEMON_TIMEOUT, MARGIN};
use crate::map::HostOffset;
use crate::protocol::board::{NotesReply, RotaryStateReply};

/// More than the daemon gives the board for a job, the question before it included.
const JOB_TIMEOUT: Duration = Duration::from_secs(5);

/// A reply that says nothing but that it is done.
#[derive(Debug, Deserialize)]
pub(super) struct Done {}

/// Where a binary rotary buffer lies and what it feeds. Without start or size it takes the room that the daemon keeps
/// for it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RotaryPlace {
    /// Which buffer, 1 or 2.
    pub buffer: u8,
    /// Its first word.
    pub start: Option<HostOffset>,
    /// Its size in 32-bit words.
    pub size_longs: Option<u32>,
    /// The coordinate system it feeds, 1 to 8.
    pub coordinate_system: u8,
    /// The number that the board has for coordinate system 1: 1 or 0.
    pub coordinate_system_base: u8,
}

impl Connection {
    fn job(&mut self, method: &str, parameters: Value) -> Result<(), CommandError> {
        self.call::<Done>(method, parameters, JOB_TIMEOUT + MARGIN).map(|_| ())
    }

    /// Has the control panel do `action` (`jog-`, `jog+`, `jog-stop`, `pre-jog`, `home` for motors; `start`, `step`,
    /// `stop`, `hold` for coordinate systems) for `numbers`, 1 to 8, all at once. Returns when the board has taken it.
    ///
    /// # Errors
    /// [`CommandError`]; [`crate::protocol::CallError::Refused`] in it when I2 is not 3, or the board did not take it in
    /// time: it has been withdrawn then.
    pub fn panel(&mut self, action: &str, numbers: &[u8]) -> Result<(), CommandError> {
        self.job("Panel", json!({"action": action, "numbers": numbers}))
    }

    /// Begins a jog (`jog-` or `jog+`) that goes on only while [`Connection::panel_renew`] follows at least every 200 ms.
    /// [`super::HeldJog`] does that.
    ///
    /// # Errors
    /// As [`Connection::panel`].
    pub fn panel_hold(&mut self, action: &str, numbers: &[u8]) -> Result<(), CommandError> {
        self.job("PanelHold", json!({"action": action, "numbers": numbers}))
    }

    /// Says that the holder of this connection's jogs is still there.
    ///
    /// # Errors
    /// [`CommandError`]; refused when there is nothing held any more.
    pub fn panel_renew(&mut self) -> Result<(), CommandError> {
        self.call::<Done>("PanelRenew", Value::Null, DAEMON_TIMEOUT).map(|_| ())
    }

    /// Overrides the feed rate of `coordinate_system` (1 to 8) with `raw` (1/32768 ms, 0 to 32767; 14507 is 100 % at the
    /// default I10), until it is released by `None`. Returns what speaks against an effect: an Ix93 that points elsewhere, or
    /// that the board could not be asked.
    ///
    /// # Errors
    /// As [`Connection::panel`].
    pub fn feed_override(
        &mut self,
        coordinate_system: u8,
        raw: Option<u16>,
    ) -> Result<Vec<String>, CommandError> {
        let parameters = json!({"coordinate_system": coordinate_system, "raw": raw});
        self.call::<NotesReply>("FeedOverride", parameters, JOB_TIMEOUT + MARGIN).map(|reply| reply.notes)
    }

    /// Writes consecutive 16-bit words (1 to 64) from `first` on: of each, its value and the mask of the bits to change.
    /// A word with mask 0 is not touched. Unless `anywhere`, all have to be open for other use.
    ///
    /// # Errors
    /// [`CommandError`]; refused when a word belongs to a function. Nothing has been written then.
    pub fn write(
        &mut self,
        first: HostOffset,
        words: &[(u16, u16)],
        anywhere: bool,
    ) -> Result<(), CommandError> {
        let (values, masks): (Vec<u16>, Vec<u16>) = words.iter().copied().unzip();
        let parameters =
            json!({"host_offset": first.bytes(), "words": values, "masks": masks, "anywhere": anywhere});
        self.job("Write", parameters)
    }

    /// Sets a binary rotary buffer up, empty. I57 has to be 0; `I57=1` and `OPEN ROT` after it let PMAC take lines.
    ///
    /// # Errors
    /// [`CommandError`]; refused, and nothing written, when I57 is not 0 or cannot be asked, as while a program buffer is open
    /// (a daemon that uses no command lines leaves it to the caller), or when the place is not possible.
    pub fn rotary_open(&mut self, place: RotaryPlace) -> Result<(), CommandError> {
        let RotaryPlace { buffer, start, size_longs, coordinate_system, coordinate_system_base } = place;
        let parameters = json!({
            "buffer": buffer,
            "start": start.map(HostOffset::bytes),
            "size_longs": size_longs,
            "coordinate_system": coordinate_system,
            "coordinate_system_base": coordinate_system_base,
        });
        self.job("RotaryOpen", parameters)
    }

    /// No line will follow in rotary buffer `buffer` (1 or 2): its running empty is no underrun any more.
    ///
    /// # Errors
    /// [`CommandError`]; refused when the buffer has not been set up.
    pub fn rotary_finish(&mut self, buffer: u8) -> Result<(), CommandError> {
        self.job("RotaryFinish", json!({"buffer": buffer}))
    }

    /// How far rotary buffer `buffer` (1 or 2) is.
    ///
    /// # Errors
    /// [`CommandError`]; refused when the buffer has not been set up.
    pub fn rotary_state(&mut self, buffer: u8) -> Result<RotaryStateReply, CommandError> {
        self.call("RotaryState", json!({"buffer": buffer}), JOB_TIMEOUT + MARGIN)
    }
}
