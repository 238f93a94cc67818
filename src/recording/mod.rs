//! A capture of a board (layer 1): a directory of plain files that `pmacctl board capture` writes.
//!
//! | file | what |
//! |---|---|
//! | `about.json` | [`About`]: which board, how the daemon worked, what is left out, whether the capture is whole |
//! | `trace.ndjson` | an [`Access`] a line: what the daemon read and wrote, in its order |
//! | `images.ndjson` | an [`ImageAt`] a line: the times of the images |
//! | `images/0000.bin` | the words of the DPRAM, little-endian |
//! | `answers.ndjson` | an [`Answer`] a line: what was asked as command lines, and the replies |
//! | `variables.pmc` | variables and definitions, as `pmacctl backup` writes them |
//! | `system.json` | the kernel, the device in sysfs, the latencies |
//!
//! Times are CLOCK_MONOTONIC in nanoseconds. A capture that was cut short holds whole lines and whole images, but for
//! its last line; its `about.json` says so.

mod error;
mod read;
mod replies;
#[cfg(test)]
pub mod testing;
#[cfg(test)]
mod tests;
mod write;

use std::fmt;

use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

use crate::map::HostOffset;
use crate::protocol::BoardSettings;

pub use error::RecordingError;
pub use read::{Accesses, Recording};
pub use replies::Replies;
pub use write::Writer;

/// The version of the format.
pub const FORMAT: u32 = 1;
/// The most accesses of a recording.
pub const MOST_ACCESSES: usize = 1 << 24;
/// The most images of a recording.
pub const MOST_IMAGES: usize = 4096;
/// The most answers of a recording.
pub const MOST_ANSWERS: usize = 1 << 20;

/// The names of the files.
pub mod files {
    /// [`super::About`].
    pub const ABOUT: &str = "about.json";
    /// The accesses.
    pub const TRACE: &str = "trace.ndjson";
    /// The times of the images.
    pub const IMAGE_TIMES: &str = "images.ndjson";
    /// The directory of the images.
    pub const IMAGES: &str = "images";
    /// The answers.
    pub const ANSWERS: &str = "answers.ndjson";
    /// The variables.
    pub const VARIABLES: &str = "variables.pmc";
    /// The machine.
    pub const SYSTEM: &str = "system.json";
}

/// The direction of an access.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Op {
    /// The daemon read.
    #[serde(rename = "r")]
    Read,
    /// The daemon wrote.
    #[serde(rename = "w")]
    Write,
}

/// One access of the daemon to the board.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Access {
    /// Its time. The words of a block have the time at which the daemon began to read the block.
    #[serde(rename = "t")]
    pub t_ns: u64,
    /// The direction.
    pub op: Op,
    /// Where.
    #[serde(serialize_with = "write_offset", deserialize_with = "read_offset")]
    pub offset: HostOffset,
    /// 16 or 32 bits.
    pub width: u8,
    /// The word; of 32 bits, the word at `offset` is the low half.
    pub value: u32,
}

impl Access {
    /// The fault of this access in a DPRAM of `length` bytes.
    fn fault(&self, length: u32) -> Option<String> {
        let bytes = match self.width {
            16 if self.value > u32::from(u16::MAX) => {
                return Some(format!("{} does not fit 16 bits", self.value));
            }
            16 => 2,
            32 => 4,
            other => return Some(format!("a width of {other} bits; there are 16 and 32")),
        };
        let is_outside = self.offset.bytes().checked_add(bytes).is_none_or(|end| end > length);
        is_outside.then(|| format!("{} is outside the DPRAM of {length} bytes", self.offset))
    }
}

fn write_offset<S: Serializer>(offset: &HostOffset, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(offset)
}

fn read_offset<'de, D: Deserializer<'de>>(deserializer: D) -> Result<HostOffset, D::Error> {
    struct Offset;
    impl de::Visitor<'_> for Offset {
        type Value = HostOffset;
        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("an even offset like \"0x0024\"")
        }
        fn visit_str<E: de::Error>(self, text: &str) -> Result<HostOffset, E> {
            let bytes = text.strip_prefix("0x").and_then(|digits| u32::from_str_radix(digits, 16).ok());
            bytes
                .and_then(HostOffset::checked)
                .ok_or_else(|| E::invalid_value(de::Unexpected::Str(text), &self))
        }
    }
    deserializer.deserialize_str(Offset)
}

/// The time of an image.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImageAt {
    /// When the daemon read its first word.
    #[serde(rename = "t")]
    pub t_ns: u64,
    /// Its file in [`files::IMAGES`].
    pub file: String,
}

/// The words of the DPRAM, as the daemon reads them. The daemon reads them piece by piece: PMAC may write meanwhile.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image {
    /// When the daemon read its first word.
    pub t_ns: u64,
    /// The words, ascending.
    pub words: Vec<u16>,
}

/// The board's answer to a command line.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Answer {
    /// The command line.
    pub line: String,
    /// The lines of the reply.
    pub reply: Vec<String>,
    /// Why the board refused the line, if it did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refused: Option<String>,
}

/// The head of a recording.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct About {
    /// The version of the format: [`FORMAT`].
    pub format: u32,
    /// The program that wrote it, with its version.
    pub program: String,
    /// The version of the daemon.
    pub pmacd: String,
    /// The time at which the recording began, UTC, RFC 3339.
    pub taken: String,
    /// The same time on the clock of the accesses.
    pub began_ns: u64,
    /// The board's name, as in `--name`.
    pub name: String,
    /// How the daemon reaches the board, as in `--board`, without paths of files and simulators.
    pub board: String,
    /// The board's family.
    pub family: String,
    /// The answer to `TYPE`, if known.
    pub board_type: Option<String>,
    /// The answer to `VERSION`, if known.
    pub firmware: Option<String>,
    /// The size of the DPRAM in bytes.
    pub dpram_bytes: u32,
    /// The servo cycle in nanoseconds, if known.
    pub servo_period_ns: Option<u64>,
    /// The settings of the daemon, with the readings.
    pub settings: BoardSettings,
    /// Servo updates that the daemon published meanwhile.
    pub updates: u64,
    /// Accesses in the trace.
    pub accesses: u64,
    /// Accesses that the trace lacks, because the daemon's buffer for them was full.
    pub dropped: u64,
    /// Why the recording ended early; `None` for a whole one. An unfinished one says that it is unfinished.
    pub cut_short: Option<String>,
    /// The parts that the capture leaves out, and why, one sentence each.
    pub left_out: Vec<String>,
}
