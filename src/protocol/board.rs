//! The types of the interface `io.github.pmac-dpram.Board`.

use std::fmt;

use super::program_words::{DefinitionsRead, ProgramWords};
use crate::map::{Family, Function, UnknownFamily};
use serde::{Deserialize, Serialize};

/// Whether clients can trust the data in the segment now. The segment holds the number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u32)]
pub enum State {
    /// The daemon is identifying the board.
    #[default]
    Init = 0,
    /// The board updates its data.
    Live = 1,
    /// The board has stopped updating its data.
    Stale = 2,
    /// The daemon is gone or stopping: attach again.
    Dead = 3,
}

impl State {
    /// The state with that number; an unknown number counts as dead.
    #[must_use]
    pub const fn from_number(number: u64) -> Self {
        match number {
            0 => Self::Init,
            1 => Self::Live,
            2 => Self::Stale,
            _ => Self::Dead,
        }
    }
}

bitflags::bitflags! {
    /// The automatic functions at work.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
    pub struct Enabled: u32 {
        /// Servo fixed data (I48).
        const SERVO = 1;
        /// Background fixed data (I49).
        const BACKGROUND = 1 << 1;
        /// ASCII communication (I58).
        const ASCII = 1 << 2;
        /// The interrupt that announces a reply (I56): the host has connected it, and it comes.
        const INTERRUPT = 1 << 3;
        /// Data gathering, according to the report that has the board's global status.
        const GATHER = 1 << 4;
    }
}

impl Enabled {
    /// The functions' names as `GetInfo` gives them.
    #[must_use]
    pub fn names(self) -> Vec<String> {
        self.iter_names().map(|(name, _)| name.to_ascii_lowercase()).collect()
    }
}

/// The message about a board whose replies have no end.
pub const NO_REPLY_END: &str = "the board does not mark the end of its replies, so each command line waits out its time and is told as \
                                one that may have been carried out; send I3=2";

/// The message about a board that answers the daemon's own lines otherwise.
pub const ANSWERS_OTHERWISE: &str = "the board answers `I3 I10 I3` otherwise than it asks, so nobody could tell whose its replies are: no command \
                                     line is sent; send it over the serial port, and tell us what comes";

/// The message about a board that does not take control characters.
pub const NO_CONTROL_CHARACTERS: &str = "the board did not take ^F by the DPRAM word of control characters, so ^A and ^K may not reach \
                                         it; move nothing before step 9 of docs/first-board.md has decided it. \
                                         `pmacctl abort 1` and `&1A` go another way";

/// The board and the daemon that owns it: the reply of `GetInfo`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct BoardInfo {
    /// The board's name, as in `--name`.
    pub name: String,
    /// The version of pmacd.
    pub version: String,
    /// How the daemon reaches the board, as in `--board`.
    pub board: String,
    /// The board's family: `pmac`, `pmac2`, `turbo`, `turbo2`.
    pub family: String,
    /// The answer to `VERSION`, if known.
    pub firmware: Option<String>,
    /// The answer to `TYPE`, if known.
    pub board_type: Option<String>,
    /// How many bytes of the board's DPRAM `pmacd` uses; `None` while the family is not known.
    #[serde(default)]
    pub dpram_bytes: Option<u32>,
    /// How many motors the board reports.
    pub motors: u32,
    /// The servo cycle in nanoseconds, if known.
    pub servo_period_ns: Option<u64>,
    /// Whether clients can trust the data in the segment now.
    pub state: State,
    /// A number that differs for every start of the daemon.
    pub generation: u64,
    /// The daemon's process.
    pub pid: u32,
    /// The POSIX shared-memory object with the live data, `/pmac0`.
    pub segment: String,
    /// The automatic functions at work: `servo`, `background`, `ascii`, `interrupt`.
    pub enabled: Vec<String>,
    /// How the board takes command lines. In the message its fields stand beside the others.
    #[serde(flatten)]
    pub lines: CommandLinesInfo,
    /// The program buffer that is open, as far as known.
    #[serde(default)]
    pub open_buffer: Option<OpenBufferInfo>,
    /// The interrupt controller behind the board's host port, where the daemon serves it.
    #[serde(default)]
    pub host_port: Option<HostPortInfo>,
    /// The caller's role: observe, stop, operate or engineer.
    #[serde(default)]
    pub role: Option<String>,
    /// The work that ended sequences must still do on the board, and jogs that go on without their panel: sentences.
    #[serde(default)]
    pub unfinished: Vec<String>,
    /// The last notes of clients: sentences, the latest last.
    #[serde(default)]
    pub notes: Vec<String>,
    /// Work or changes of another host or of a program on the board.
    #[serde(default)]
    pub elsewhere: Vec<Elsewhere>,
    /// The clients' last commands that end programs, motions or gathers, the latest last.
    #[serde(default)]
    pub stops: Vec<SentStop>,
    /// How long ago the daemon sent the board a reset, or saw it come up again, in milliseconds, if known.
    #[serde(default)]
    pub reset_ago_ms: Option<u64>,
    /// Functions that the daemon does not use yet, while it asks the board where its M-variables point.
    #[serde(default)]
    pub waiting: Vec<Function>,
    /// The functions into whose words the board's M-variables point.
    #[serde(default)]
    pub program_words: Vec<ProgramWords>,
    /// The state of a replay; `None` for a board.
    #[serde(default)]
    pub replay: Option<Replay>,
}

/// How the board takes command lines: the bus thread reports it, `GetInfo` passes it on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct CommandLinesInfo {
    /// The port that command lines use now.
    pub command_port: CommandPort,
    /// Whether the board answered the last command line.
    pub command_state: CommandState,
    /// The board answers command lines through the DPRAM, but marks no end of its replies.
    pub reply_end_missing: bool,
    /// The board does not answer the daemon's own lines as expected, so the daemon sends it no other line.
    pub answers_otherwise: bool,
    /// Whether the board takes control characters by their own DPRAM word; `None`: the daemon has not tried yet.
    pub control_characters: Option<bool>,
    /// The board does not say whether another host has opened a program buffer: no report tells, and the board refuses
    /// the question.
    pub open_buffer_unsaid: bool,
    /// How far the board has told where its M-variables point.
    pub definitions: DefinitionsRead,
}

impl CommandLinesInfo {
    /// The faults of the DPRAM's command port that the board has shown: a sentence each, with the cure.
    #[must_use]
    pub fn port_faults(&self) -> Vec<&'static str> {
        let faults = [
            (self.reply_end_missing, NO_REPLY_END),
            (self.answers_otherwise, ANSWERS_OTHERWISE),
            (self.control_characters == Some(false), NO_CONTROL_CHARACTERS),
        ];
        faults.into_iter().filter_map(|(is_so, text)| is_so.then_some(text)).collect()
    }
}

impl BoardInfo {
    /// The board's family, with as much DPRAM as the board has.
    ///
    /// # Errors
    /// A family that this program or the daemon does not know.
    pub fn known_family(&self) -> Result<&'static Family, UnknownFamily> {
        Family::by_name(&self.family).map(|family| self.sized(family))
    }

    /// `family` with as much DPRAM as the board has.
    #[must_use]
    pub fn sized(&self, family: &'static Family) -> &'static Family {
        self.dpram_bytes.and_then(|bytes| family.with_length(bytes)).unwrap_or(family)
    }

    /// Whether no M-variable keeps the daemon from using `function`.
    #[must_use]
    pub fn leaves_free(&self, function: Function) -> bool {
        let is_held = |words: &ProgramWords| words.function == function && !words.used;
        !self.program_words.iter().any(is_held)
    }

    /// Whether this is a replay that has come to its end.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.replay.is_some_and(|replay| replay.over)
    }
}

/// The message about data that do not come because a replay is over.
pub const REPLAY_OVER: &str = "the recording is over; a pmacd that is started again replays it";

/// The state of a replay of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Replay {
    /// Whether the replay has ended: its data are stale.
    pub over: bool,
    /// Words and lines that the driver asked for and the recording does not know; the log names them at the end.
    pub differences: u32,
}

impl fmt::Display for Replay {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a recording, no board: nothing can be moved")?;
        if self.over {
            f.write_str("; it is over, and its data are stale")?;
        }
        match self.differences {
            0 => Ok(()),
            count => {
                write!(f, "; words and lines that were asked and are not in it: {count}, which the log names")
            }
        }
    }
}

/// Work or a change of another host or of a program on the board.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Elsewhere {
    /// The subject: an I-variable (`I2`), `program_buffer` (one is open), `gather` (the board gathers), or
    /// `command_lines` (the board lives but answers none).
    pub what: String,
    /// A variable's value before.
    pub was: Option<i64>,
    /// A variable's value now.
    pub is: Option<i64>,
    /// How long ago the daemon last saw the board as before, in milliseconds, if known.
    pub ago_ms: Option<u64>,
}

/// A client's command that ends programs, motions or a gather, and that the board may have carried out.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct SentStop {
    /// Counts up since the daemon's start.
    pub number: u64,
    /// The commands that end them: `&1Q`, `^A`, `panel stop`.
    pub what: String,
    /// The user who sent it.
    pub uid: u32,
    /// The user's process.
    pub pid: i32,
    /// Whether the command names its motors or coordinate systems, or is for all; otherwise it went to the addressed
    /// ones.
    pub named: bool,
    /// The coordinate systems whose programs the command may have ended.
    pub coordinate_systems: Vec<u32>,
    /// The motors that the command may have stopped, or sent elsewhere.
    pub motors: Vec<u32>,
    /// Whether the command may have ended a gather.
    pub gather: bool,
}

impl fmt::Display for SentStop {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { what, uid, pid, .. } = self;
        write!(f, "uid {uid} (pid {pid}) sent {what}")
    }
}

/// A port for command lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u32)]
pub enum CommandPort {
    /// The DPRAM's ASCII buffers.
    #[default]
    Dpram = 0,
    /// The VME mailboxes.
    Mailbox = 1,
}

/// Whether the board answers command lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[repr(u32)]
pub enum CommandState {
    /// The daemon has sent none since its start or the last change of the port.
    #[default]
    Unknown = 0,
    /// The board answered the last one.
    Answers = 1,
    /// The board did not answer the last one.
    Silent = 2,
}

/// An open program buffer on the board: lines become program lines.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct OpenBufferInfo {
    /// Its name, as `PROG 77`, if a client opened it through the daemon; the fields below, too.
    pub name: Option<String>,
    /// The user who opened it.
    pub uid: Option<u32>,
    /// The user's process, if known.
    pub pid: Option<i32>,
    /// A sequence of that user opened the buffer, and closes it.
    pub sequence: bool,
}

impl OpenBufferInfo {
    /// Whether lines that the user `uid` types enter the buffer.
    #[must_use]
    pub fn takes_lines_of(&self, uid: u32) -> bool {
        !self.sequence && self.uid == Some(uid)
    }

    /// Its name, or "a program buffer".
    #[must_use]
    pub fn name(&self) -> &str {
        self.name.as_deref().filter(|name| !name.is_empty()).unwrap_or("a program buffer")
    }
}

impl fmt::Display for OpenBufferInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(uid) = self.uid else {
            return f.write_str(
                "a program buffer, opened by somebody else (the serial port, another host, or before pmacd started)",
            );
        };
        let by = if self.sequence { "a sequence of " } else { "" };
        let pid = self.pid.map_or_else(String::new, |pid| format!(" (pid {pid})"));
        write!(f, "{}, opened by {by}uid {uid}{pid}", self.name())
    }
}

/// The interrupt controller behind a host port.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct HostPortInfo {
    /// `pic8259` or `pmac2`.
    pub controller: String,
    /// The line, 0 to 7.
    pub line: u32,
    /// Its interrupts since the daemon's start. In the message its fields stand beside the others.
    #[serde(flatten)]
    pub counts: HostPortCounts,
}

/// The interrupts of a host port.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct HostPortCounts {
    /// Interrupts that the daemon served.
    pub served: u32,
    /// The served interrupts that were old: no response was there any more.
    pub old: u32,
    /// Responses whose interrupt never came.
    pub unannounced: u32,
}

/// The statement of a PMAC program that caused a text.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MessageKind {
    /// The response to a `CMD"…"`.
    Cmd,
    /// A `SEND"…"`.
    Send,
    /// A `CMD"…"` that the board refused: the text is the error, `ERR003`.
    Error,
}

/// A text that a PMAC program sent by itself: one reply of `Messages`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Message {
    /// CLOCK_MONOTONIC when the daemon read the text, nanoseconds.
    pub time_ns: u64,
    /// The statement that caused it.
    pub kind: MessageKind,
    /// The text.
    pub text: String,
    /// How many texts the daemon dropped before this one because this caller read too slowly.
    pub lost: u64,
}

/// The reply of a method that returns nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Done {}

/// The reply of `Send`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SendReply {
    /// The reply, one element a line.
    pub lines: Vec<String>,
    /// The program buffer that was open when the board acknowledged the line without a reply. The line's program
    /// statements entered the buffer, if it is the user's; or no manual says whether a command of the line did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub entered: Option<OpenBufferInfo>,
}

/// The outcome of a line that failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LineOutcome {
    /// The board refused the line.
    Refused,
    /// The board may or may not have carried out the line.
    Uncertain,
    /// The daemon did not send the line.
    NotSent,
    /// The board was reset: the settings of this line and the earlier ones may be gone.
    Reset,
}

/// Why a line of `RunLines` failed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct LineFailure {
    /// The line's outcome.
    pub outcome: LineOutcome,
    /// The number of `ERRnnn`, if the board refused the line.
    pub code: Option<u16>,
    /// The reason.
    pub message: String,
}

/// The replies of `RunLines`: one a line, then a last one.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct RunLinesReply {
    /// The line's number in the sequence, counted from 0; `None` in the last reply, unless that reply says at which
    /// line the daemon noticed a reset of the board.
    pub line: Option<u64>,
    /// The board's answer, one element a line.
    pub lines: Vec<String>,
    /// Why the line failed, if it did.
    pub failure: Option<LineFailure>,
    /// How many lines of the sequence the board has taken.
    pub taken: u64,
    /// In the last reply: effects that the sequence leaves on the board and the caller should know, one sentence each.
    pub notes: Vec<String>,
    /// Whether the sequence is over.
    pub over: bool,
}

/// The reply of `GatherStop`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct GatherStopReply {
    /// Whether a gather was running.
    pub gathered: bool,
    /// The gather's user; the caller if no client began the gather through the socket.
    pub uid: u32,
    /// The gather's process.
    pub pid: i32,
    /// Why the gather ended, if its owner did not end it.
    pub reason: Option<String>,
    /// The board's present period of gathering (I19), if known.
    pub period: Option<String>,
    /// Settings that the daemon could not restore, one sentence each.
    pub notes: Vec<String>,
}

/// The reply of `RotaryStart`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RotaryStartReply {
    /// Lines that the daemon found in the board's own rotary buffer.
    pub found_lines: u64,
}

/// The reply of `RotaryStop`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RotaryStopReply {
    /// Why the stream ended, if its owner did not end it.
    pub reason: Option<String>,
    /// Lines in the DPRAM that the board has not taken, and will not take.
    pub ahead_lines: u64,
    /// Lines in the board's own rotary buffer; `None` if the daemon could not ask the board.
    pub left_lines: Option<u64>,
    /// Whether the daemon ended the program with `Q`.
    pub quit: bool,
    /// Steps of the end that failed, one sentence each.
    pub notes: Vec<String>,
}

/// The reply of `CheckReset`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct ResetsReply {
    /// How many resets the daemon has found.
    pub resets: u64,
}

/// The reply of `JogRenew`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct JogRenewReply {
    /// Whether a motor that stops with the connection may still jog.
    pub going: bool,
    /// The motors that may.
    #[serde(default)]
    pub motors: Vec<u8>,
}

/// The reply of `Read`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReadReply {
    /// CLOCK_MONOTONIC of the first read, nanoseconds.
    pub time_ns: u64,
    /// The words, ascending.
    pub words: Vec<u16>,
}

/// The reply of `Trace`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TraceReply {
    /// Four numbers an access: nanoseconds since the previous access (for the first, CLOCK_MONOTONIC), the kind (0 a
    /// word read, 1 a word written, 2 two words read at once), host offset, value.
    pub accesses: Vec<u64>,
    /// How many accesses found no place in the daemon's memory since the trace began.
    pub dropped: u64,
}

/// The reply of `FeedOverride`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct NotesReply {
    /// Remarks on the effect that the caller should know, one sentence each; none if the override acts as asked.
    pub notes: Vec<String>,
}

/// The reply of `WatchVariables`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct WatchReply {
    /// How many registers.
    pub watched: usize,
    /// The number of the first table that has all of them, as in the segment's variable region.
    pub table: u32,
}

/// A register to write: an element of `WriteVariables`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VariableRecord {
    /// `Y:$0770`, `X:$0771`, `D:$0778` or `L:$1005`.
    pub register: String,
    /// The lowest bit to write of a Y or X word; default: 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub offset: Option<u8>,
    /// How many bits to write of a Y or X word: 1, 4, 8, 12, 16, 20 or 24; default: 24.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub width: Option<u8>,
    /// The value; whole for all but `L:`.
    pub value: f64,
}

/// The reply of `RotaryState`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RotaryStateReply {
    /// Commands in the buffer that the board has not taken.
    pub ahead_commands: u32,
    /// Lines in the buffer that the board has not taken wholly.
    pub ahead_lines: u64,
    /// Lines that the daemon has put into the buffer since it set it up.
    pub sent_lines: u64,
    /// The board's internal rotary buffer is full.
    pub busy: bool,
    /// The board's error code, if it reports one.
    pub error: Option<u8>,
    /// How often the daemon found the buffer empty though more lines were to follow.
    pub underruns: u64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_parts_of_the_board_stand_beside_each_other_in_the_message_and_an_older_daemon_lacks_some() {
        let info = BoardInfo { host_port: Some(HostPortInfo::default()), ..BoardInfo::default() };
        let mut message = serde_json::to_value(&info).unwrap();
        assert_eq!((&message["command_port"], &message["control_characters"]), (&"dpram".into(), &().into()));
        assert_eq!((&message["definitions"]["of"], &message["host_port"]["served"]), (&0.into(), &0.into()));
        assert_eq!(message.as_object().unwrap().get("lines"), None);
        for name in ["command_port", "reply_end_missing", "control_characters", "definitions"] {
            assert!(message.as_object_mut().unwrap().remove(name).is_some(), "{name}");
        }
        assert_eq!(serde_json::from_value::<BoardInfo>(message).unwrap(), info);
    }

    #[test]
    fn enabled_functions_have_names() {
        assert_eq!((Enabled::SERVO | Enabled::ASCII).names(), ["servo", "ascii"]);
    }
}
