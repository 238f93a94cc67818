//! The parameters of the methods of `io.github.pmac-dpram.Board`, one structure a method. The interface's definition
//! tells how each method uses them.

use serde::{Deserialize, Deserializer, Serialize, de};

use super::TIMEOUT_MAX_MS;
use super::board::VariableRecord;
use crate::map::HostOffset;

/// The longest note, in characters.
pub const NOTE_MAX: usize = 200;
/// The longest time-out of `WriteVariables`, in milliseconds.
pub const WRITE_TIMEOUT_MAX_MS: u64 = 600_000;
/// The longest time-out of `RotarySend`, in milliseconds.
pub const ROTARY_TIMEOUT_MAX_MS: u64 = 3_600_000;

/// A word's offset in the DPRAM, in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "u32", into = "u32")]
pub struct Offset(pub HostOffset);

impl TryFrom<u32> for Offset {
    type Error = String;

    fn try_from(bytes: u32) -> Result<Self, String> {
        HostOffset::checked(bytes).map(Self).ok_or_else(|| format!("{bytes} is odd; an offset is even"))
    }
}

impl From<Offset> for u32 {
    fn from(offset: Offset) -> Self {
        offset.0.bytes()
    }
}

/// How the daemon treats lines that an earlier program has left in the board's own rotary buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LeftLines {
    /// The daemon clears them.
    Clear,
    /// The board runs them before the lines of the stream.
    Continue,
}

/// Reads an optional time-out of 1 to `MAX` milliseconds.
fn milliseconds<'de, D: Deserializer<'de>, const MAX: u64>(deserializer: D) -> Result<Option<u64>, D::Error> {
    match Option::<u64>::deserialize(deserializer)? {
        Some(ms) if !(1..=MAX).contains(&ms) => {
            Err(de::Error::custom(format!("{ms} is not possible; it takes 1 to {MAX}")))
        }
        ms => Ok(ms),
    }
}

/// Makes the structures: each structure refuses unknown fields, and leaves out fields without a value.
macro_rules! parameters {
    ($($(#[$about:meta])* $name:ident { $($(#[$field_about:meta])* $field:ident: $type:ty,)* })*) => {$(
        $(#[$about])*
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct $name { $($(#[$field_about])* pub $field: $type,)* }
    )*};
}

parameters! {
    /// Parameters of a method without parameters.
    NoParameters {}

    /// Parameters of `GetInterfaceDescription`.
    GetInterfaceDescription {
        /// The interface's name.
        interface: String,
    }

    /// Parameters of `Send`.
    Send {
        /// The line, 1 to 200 printable ASCII characters.
        line: String,
        /// When to give up.
        #[serde(default, deserialize_with = "milliseconds::<_, TIMEOUT_MAX_MS>", skip_serializing_if = "Option::is_none")]
        timeout_ms: Option<u64>,
        /// Whether the line is a question, which must not enter an open program buffer; default: an ordinary line.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        question: Option<bool>,
        /// `true`: the line opens a program buffer or belongs into the one that its process has open; the daemon
        /// refuses the line if that buffer is closed, or another process has one open. `false`: the line enters no
        /// buffer; the daemon refuses it while one is open. Default: the line enters the buffer that its user has
        /// open, and goes as a command otherwise.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        into_buffer: Option<bool>,
        /// Whether an endless jog that the line begins ends with the connection; default: the jog goes on.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        while_connected: Option<bool>,
        /// After how long without a call over the connection the daemon also ends that jog; default: never.
        #[serde(default, deserialize_with = "milliseconds::<_, TIMEOUT_MAX_MS>", skip_serializing_if = "Option::is_none")]
        silence_ms: Option<u64>,
        /// Whether it is sent though it ends command lines for everybody (`^Z`, `I58=0`); refused when not given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        confirmed: Option<bool>,
    }

    /// Parameters of `RunLines`.
    RunLines {
        /// The name of the sequence, in lower-case letters: `download`.
        kind: String,
        /// The lines, each as in `Send`; at most [`super::RUN_LINES_MAX`].
        lines: Vec<String>,
        /// When to give up on a line.
        #[serde(default, deserialize_with = "milliseconds::<_, TIMEOUT_MAX_MS>", skip_serializing_if = "Option::is_none")]
        timeout_ms: Option<u64>,
        /// Whether to go on after a line that the board refuses; default: no.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        keep_going: Option<bool>,
        /// The lines that the daemon sends at the end, however the sequence ends; default: those of an earlier call.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        at_end: Option<Vec<String>>,
        /// Whether the sequence ends with these lines; default: yes.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        last: Option<bool>,
        /// Whether it is sent though it ends command lines for everybody (`^Z`, `I58=0`); refused when not given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        confirmed: Option<bool>,
    }

    /// Parameters of `SendControl`.
    SendControl {
        /// `^A` to `^_`, or the character itself.
        character: String,
        /// Whether the daemon keeps waiting lines after `^A` and `^K`; default: it discards them.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        keep_queue: Option<bool>,
        /// Whether it is sent though it ends command lines for everybody (`^Z`, `I58=0`); refused when not given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        confirmed: Option<bool>,
    }

    /// Parameters of `Note`.
    Note {
        /// The note, 1 to [`NOTE_MAX`] characters.
        text: String,
    }

    /// Parameters of `Read`.
    Read {
        /// The first word.
        host_offset: Offset,
        /// How many words, 1 to 64.
        words: usize,
    }

    /// Parameters of `Trace`.
    Trace {
        /// Whether the daemon stops keeping accesses; default: the trace goes on.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        end: Option<bool>,
    }

    /// Parameters of `Panel` and `PanelHold`.
    Panel {
        /// The action's name.
        action: String,
        /// Motors or coordinate systems.
        numbers: Vec<usize>,
        /// Whether to start programs although they run lines that a rotary stream left when it ended early; default:
        /// the daemon refuses.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        confirmed: Option<bool>,
        /// For `Panel`: whether home, start and step go by command line where the daemon sends lines; default: by the
        /// panel alone.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        by_line: Option<bool>,
    }

    /// Parameters of `JogTo` and `SetPosition`.
    MotorPosition {
        /// The motor, from 1 on.
        motor: usize,
        /// The position, in counts from home; rounded to 1/32.
        position: f64,
    }

    /// Parameters of `FeedOverride`.
    FeedOverride {
        /// The coordinate system.
        coordinate_system: usize,
        /// The override in 1/32768 ms; default: the board's own override.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        raw: Option<u32>,
    }

    /// Parameters of `Write`.
    Write {
        /// The first word.
        host_offset: Offset,
        /// The values, 1 to 64.
        words: Vec<u16>,
        /// One mask a value: the daemon changes only bits that are set here; default: all bits.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        masks: Option<Vec<u16>>,
        /// Whether to write words that an automatic function owns.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        anywhere: Option<bool>,
    }

    /// Parameters of `WatchVariables`.
    WatchVariables {
        /// The registers, `Y:$0003`.
        registers: Vec<String>,
    }

    /// Parameters of `WriteVariables`.
    WriteVariables {
        /// The records to write, in this order.
        records: Vec<VariableRecord>,
        /// When to give up.
        #[serde(default, deserialize_with = "milliseconds::<_, WRITE_TIMEOUT_MAX_MS>", skip_serializing_if = "Option::is_none")]
        timeout_ms: Option<u64>,
    }

    /// Parameters of `GatherStart`.
    GatherStart {
        /// The buffer's first word.
        buffer: Offset,
        /// The word with the buffer's size.
        size_word: Offset,
        /// The word with the index.
        index_word: Offset,
        /// The size given to `DEFINE GATHER`, in longs.
        size_longs: u32,
        /// The registers of a sample, in order: `Y:$D001`.
        registers: Vec<String>,
        /// Servo cycles from one sample to the next.
        period: u32,
        /// Whether gathering goes on at the buffer's end; default: yes.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        wrap: Option<bool>,
        /// The servo cycle: without a servo report the daemon counts the board's turns by the host's clock.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        servo_period_ns: Option<u64>,
    }

    /// Parameters of `GatherStop`.
    GatherStop {
        /// The user whose gather shall end; default: the caller.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        uid: Option<u32>,
    }

    /// Parameters of `RotaryFinish`, `RotaryStop` and `RotaryState`.
    Rotary {
        /// Which buffer, from 1 on.
        buffer: u8,
    }

    /// Parameters of `RotaryStart`.
    RotaryStart {
        /// Which buffer, from 1 on.
        buffer: u8,
        /// Its first word; default: where the daemon keeps room for the buffer.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        start: Option<Offset>,
        /// Its size in longs; default: all the room that the daemon keeps for the buffer.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        size_longs: Option<u32>,
        /// The coordinate system that the buffer feeds.
        coordinate_system: u8,
        /// The header's number for coordinate system 1.
        coordinate_system_base: u8,
        /// The words with which the daemon first defines the board's own rotary buffer.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        define_longs: Option<u32>,
        /// How the daemon treats lines that are left in the board's own rotary buffer; default: it refuses the stream.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        left: Option<LeftLines>,
        /// Whether the daemon starts the program when its first lines are there; default: no.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        run: Option<bool>,
        /// Whether the program has commands that stop it until a client starts it again; default: no.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        may_stand: Option<bool>,
        /// ABS, INC and FRAX, each with its axes, which the daemon sends to the coordinate system before the program.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        modes: Vec<String>,
    }

    /// The commands of a line of a rotary program, two words a command.
    RotaryLine {
        /// The words.
        words: Vec<u32>,
    }

    /// Parameters of `RotarySend`.
    RotarySend {
        /// Which buffer, from 1 on.
        buffer: u8,
        /// The lines.
        lines: Vec<RotaryLine>,
        /// The number that the first of the lines must have.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        first: Option<u64>,
        /// When to give up.
        #[serde(default, deserialize_with = "milliseconds::<_, ROTARY_TIMEOUT_MAX_MS>", skip_serializing_if = "Option::is_none")]
        timeout_ms: Option<u64>,
    }
}
