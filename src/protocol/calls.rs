//! The parameters of the methods of `io.github.pmac-dpram.Board`, one structure a method. What a method does with them is
//! told in the interface's definition.

use serde::{Deserialize, Deserializer, Serialize, de};

use super::TIMEOUT_MAX_MS;
use super::board::VariableRecord;
use crate::map::HostOffset;

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

/// What becomes of lines that an earlier program has left in the board's own rotary buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LeftLines {
    /// They are taken away.
    Clear,
    /// They run before those of the stream.
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

/// Makes the structures: every one refuses fields that it does not have, and leaves out what is not given.
macro_rules! parameters {
    ($($(#[$about:meta])* $name:ident { $($(#[$field_about:meta])* $field:ident: $type:ty,)* })*) => {$(
        $(#[$about])*
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct $name { $($(#[$field_about])* pub $field: $type,)* }
    )*};
}

parameters! {
    /// Of a method without parameters.
    NoParameters {}

    /// Of `GetInterfaceDescription`.
    GetInterfaceDescription {
        /// The interface's name.
        interface: String,
    }

    /// Of `Send`.
    Send {
        /// The line, 1 to 200 printable ASCII characters.
        line: String,
        /// When to give up.
        #[serde(default, deserialize_with = "milliseconds::<_, TIMEOUT_MAX_MS>", skip_serializing_if = "Option::is_none")]
        timeout_ms: Option<u64>,
        /// Whether it is a question, which must not become a line of an open program buffer; it is a line when not given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        question: Option<bool>,
        /// Whether it belongs into the program buffer that its process has open, or opens one: it is refused if that is closed, or
        /// another one's is open. If not, it enters none, and is refused while one is open. When not given, it enters the one that its
        /// user has open, and goes as a command otherwise.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        into_buffer: Option<bool>,
        /// Whether a jog without an end that it begins ends with the connection; it goes on when not given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        while_connected: Option<bool>,
        /// How long nothing may be called over the connection meanwhile until such a jog ends, too; however long when not given.
        #[serde(default, deserialize_with = "milliseconds::<_, TIMEOUT_MAX_MS>", skip_serializing_if = "Option::is_none")]
        silence_ms: Option<u64>,
        /// Whether it is sent though it ends command lines for everybody (`^Z`, `I58=0`); refused when not given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        confirmed: Option<bool>,
    }

    /// Of `RunLines`.
    RunLines {
        /// What the sequence is called, in lower-case letters: `download`.
        kind: String,
        /// The lines, each as that of `Send`; at most [`super::RUN_LINES_MAX`].
        lines: Vec<String>,
        /// When to give up on a line.
        #[serde(default, deserialize_with = "milliseconds::<_, TIMEOUT_MAX_MS>", skip_serializing_if = "Option::is_none")]
        timeout_ms: Option<u64>,
        /// Whether to go on after a line that the board refuses; not when not given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        keep_going: Option<bool>,
        /// Lines for the end, whatever it is; those that an earlier call gave when not given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        at_end: Option<Vec<String>>,
        /// Whether the sequence ends with these lines; it does when not given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        last: Option<bool>,
        /// Whether it is sent though it ends command lines for everybody (`^Z`, `I58=0`); refused when not given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        confirmed: Option<bool>,
    }

    /// Of `SendControl`.
    SendControl {
        /// `^A` to `^_`, or the character itself.
        character: String,
        /// `^A` and `^K` leave the lines that wait where they are. They are not sent any more when this is not given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        keep_queue: Option<bool>,
        /// Whether it is sent though it ends command lines for everybody (`^Z`, `I58=0`); refused when not given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        confirmed: Option<bool>,
    }

    /// Of `Read`.
    Read {
        /// The first word.
        host_offset: Offset,
        /// How many words, 1 to 64.
        words: usize,
    }

    /// Of `Trace`.
    Trace {
        /// Whether to keep no more accesses; goes on when not given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        end: Option<bool>,
    }

    /// Of `Panel` and `PanelHold`.
    Panel {
        /// The action's name.
        action: String,
        /// Motors or coordinate systems.
        numbers: Vec<usize>,
        /// Whether programs are started though they run lines that a rotary stream which ended early left; refused when not given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        confirmed: Option<bool>,
    }

    /// Of `JogTo`.
    JogTo {
        /// The motor, from 1 on.
        motor: usize,
        /// Where to, in counts from home; rounded to 1/32.
        position: f64,
    }

    /// Of `FeedOverride`.
    FeedOverride {
        /// The coordinate system.
        coordinate_system: usize,
        /// The override in 1/32768 ms; the board's own when not given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        raw: Option<u32>,
    }

    /// Of `Write`.
    Write {
        /// The first word.
        host_offset: Offset,
        /// The values, 1 to 64.
        words: Vec<u16>,
        /// As many masks: only bits that are set here are changed. All when not given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        masks: Option<Vec<u16>>,
        /// Also where an automatic function owns the words.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        anywhere: Option<bool>,
    }

    /// Of `WatchVariables`.
    WatchVariables {
        /// The registers, `Y:$0003`.
        registers: Vec<String>,
    }

    /// Of `WriteVariables`.
    WriteVariables {
        /// What to write, in this order.
        records: Vec<VariableRecord>,
        /// When to give up.
        #[serde(default, deserialize_with = "milliseconds::<_, WRITE_TIMEOUT_MAX_MS>", skip_serializing_if = "Option::is_none")]
        timeout_ms: Option<u64>,
    }

    /// Of `GatherStart`.
    GatherStart {
        /// The buffer's first word.
        buffer: Offset,
        /// The word with the buffer's size.
        size_word: Offset,
        /// The word with the index.
        index_word: Offset,
        /// The size given to `DEFINE GATHER`, in longs.
        size_longs: u32,
        /// What a sample holds, in order: `Y:$D001`.
        registers: Vec<String>,
        /// Servo cycles from one sample to the next.
        period: u32,
        /// Whether gathering goes on at the buffer's end; it does when not given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        wrap: Option<bool>,
        /// The servo cycle: where no servo report runs, the host's clock counts the board's turns.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        servo_period_ns: Option<u64>,
    }

    /// Of `GatherStop`.
    GatherStop {
        /// The user whose gather is to end; the caller's own when not given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        uid: Option<u32>,
    }

    /// Of `RotaryFinish`, `RotaryStop` and `RotaryState`.
    Rotary {
        /// Which buffer, from 1 on.
        buffer: u8,
    }

    /// Of `RotaryStart`.
    RotaryStart {
        /// Which buffer, from 1 on.
        buffer: u8,
        /// Its first word; where the daemon keeps room for it when not given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        start: Option<Offset>,
        /// Its size in longs; all the room kept for it when not given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        size_longs: Option<u32>,
        /// The coordinate system it feeds.
        coordinate_system: u8,
        /// What the header calls coordinate system 1.
        coordinate_system_base: u8,
        /// Define the board's own rotary buffer first, with so many words.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        define_longs: Option<u32>,
        /// What becomes of lines that are left in the board's own rotary buffer; refused when not given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        left: Option<LeftLines>,
        /// Whether to start the program when its first lines are there; not when not given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        run: Option<bool>,
        /// Whether the program has commands that stop it until somebody starts it again; not when not given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        may_stand: Option<bool>,
        /// ABS, INC and FRAX, each with its axes, for the coordinate system before the program.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        modes: Vec<String>,
    }

    /// The commands of a line of a rotary program, two words a command.
    RotaryLine {
        /// The words.
        words: Vec<u32>,
    }

    /// Of `RotarySend`.
    RotarySend {
        /// Which buffer, from 1 on.
        buffer: u8,
        /// The lines.
        lines: Vec<RotaryLine>,
        /// The number that the first of them has to have.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        first: Option<u64>,
        /// When to give up.
        #[serde(default, deserialize_with = "milliseconds::<_, ROTARY_TIMEOUT_MAX_MS>", skip_serializing_if = "Option::is_none")]
        timeout_ms: Option<u64>,
    }
}
